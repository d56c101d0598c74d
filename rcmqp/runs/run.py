"""A recorded run: named arrays with units, and where they come from; one HDF5 file."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rcmqp.controllers.given import UNKNOWN, Given
from rcmqp.errors import ArmError, OptionError, RunFileError
from rcmqp.files import whole
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.head import CHECKED, Head, Rows, about, check_digest, check_replaceable, opened
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.untrusted import StoredRows, reading, text
from rcmqp.world.insertion import Insertion

if TYPE_CHECKING:
    import h5py

PART = 4096
"""Rows of a part of a run: some four seconds at 1 kHz, four megabytes."""

FIXED = ("lower", "upper", "velocity_limit", "acceleration_limit", "jerk_limit")
"""Channels that are the arm's, without a row for each cycle."""

_ALLOWED = {"time": "rising", "q": "numbers", "pivot": "numbers", "path_time": "numbers"}
"""What numbers a channel has; the others may be NaN, where a controller was told NaN."""


def _channel(unit: str, meaning: str, **options: Any) -> Any:
    return field(metadata={"unit": unit, "meaning": meaning}, **options)


@dataclass(frozen=True, eq=False)
class Run:
    """What happened, at n sampling instants; each row is taken before the step.

    Every array is a dataset of the file, its unit and meaning are the dataset's attributes.
    """

    scenario: Scenario
    controller: str
    options: Mapping[str, Any]
    versions: Mapping[str, str]
    joints: tuple[str, ...]
    urdf_sha256: str
    lower: Array = _channel(
        "rad", "(nv,) lower position limits; -inf for continuous joints; m if prismatic"
    )
    upper: Array = _channel("rad", "(nv,) upper position limits; inf for continuous joints")
    velocity_limit: Array = _channel("rad/s", "(nv,) joint speed limits")
    acceleration_limit: Array = _channel(
        "rad/s^2", "(nv,) joint acceleration limits; inf where there is none"
    )
    jerk_limit: Array = _channel("rad/s^3", "(nv,) joint jerk limits; inf where there is none")
    time: Array = _channel("s", "(n,) sampling instants")
    q: Array = _channel("rad", "(n, nq) Pinocchio's configuration")
    q_measured: Array = _channel("rad", "(n, nq) the configuration that the controller saw")
    angles: Array = _channel("rad", "(n, nv) joint angles; m if prismatic")
    v: Array = _channel("rad/s", "(n, nv) joint velocity commanded, until the next instant")
    v_actual: Array = _channel("rad/s", "(n, nv) joint velocity at the instant")
    v_measured: Array = _channel("rad/s", "(n, nv) joint velocity as the plant measured it")
    pivot: Array = _channel("m", "(n, 3) trocar in the world")
    x: Array = _channel(
        "1, m",
        "(n, 8) effector pose in the world, a unit dual quaternion r + "
        "eps t r / 2: r w first, then t r / 2; its sign is continuous in time",
    )
    x_d: Array = _channel("1, m", "(n, 8) desired effector pose, its sign that of x")
    tip: Array = _channel("m", "(n, 3) tip in the world")
    tip_d: Array = _channel("m", "(n, 3) desired tip")
    tip_error: Array = _channel("m", "(n,) distance of the tip from the desired one")
    effector_error: Array = _channel("m", "(n,) distance of the effector from the desired one")
    orientation_error: Array = _channel("rad", "(n,) angle from the desired orientation")
    rcm_error: Array = _channel("m", "(n,) distance of the trocar from the shaft's axis")
    depth: Array = _channel("m", "(n,) insertion depth of the tip beyond the trocar")
    tilt: Array = _channel("rad", "(n,) angle of the shaft from the trocar's axis")
    singular_value: Array = _channel(
        "m, rad", "(n,) least singular value of the effector's geometric Jacobian"
    )
    solve_time: Array = _channel("s", "(n,) time the controller took for the step")
    path_time: Array = _channel(
        "s", "(n,) time on the path's own clock, which a governor slows down", default=None
    )
    diagnostics: Mapping[str, Array] = field(default_factory=dict)
    about_diagnostics: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    stops: Mapping[str, Sequence[int]] = field(default_factory=dict)
    """Why the controller stopped safely, and the rows of the cycles in which it did."""
    assumed: tuple[str, ...] = ()
    """Which limits, of "acceleration" and "jerk", were assumed; see Arm.assumed."""
    given: Given = UNKNOWN
    """What the controller was given; a file of an earlier version does not say."""

    def __post_init__(self) -> None:
        """Protect the arrays; without a time of its own, the path is in time."""
        if self.path_time is None:
            object.__setattr__(self, "path_time", self.time)
        for array in [*self.arrays().values(), *self.diagnostics.values()]:
            array.setflags(write=False)

    @classmethod
    def joined(cls, parts: Iterable[Run], cycles: int) -> Run:
        """The run that parts make, one after the other, ``cycles`` in all at most.

        Raises:
            OptionError: there is no part.
        """
        rows: dict[str, Array] = {}
        diagnostics: dict[str, Array] = {}
        stops: dict[str, list[int]] = {}
        first, n = None, 0
        for part in parts:
            first = first or part
            now = slice(n, n + len(part.time))
            for name, values in part.rows().items():
                if name not in rows:
                    rows[name] = np.empty((cycles, *values.shape[1:]))
                rows[name][now] = values
            for name, values in part.diagnostics.items():
                if name not in diagnostics:
                    diagnostics[name] = np.full(cycles, np.nan)
                diagnostics[name][now] = values
            for reason, found in part.stops.items():
                stops.setdefault(reason, []).extend(n + k for k in found)
            n = now.stop
        if first is None:
            raise OptionError("a run without a cycle; the path ended before it began")
        return first.with_rows(
            {name: values[:n] for name, values in rows.items()},
            {name: values[:n] for name, values in diagnostics.items()},
            stops,
        )

    def with_rows(
        self,
        rows: Mapping[str, Array],
        diagnostics: Mapping[str, Array],
        stops: Mapping[str, Sequence[int]],
    ) -> Run:
        """The same run of other cycles: what rows() and so on are to be."""
        channels: dict[str, Any] = dict(rows)
        return dataclasses.replace(self, **channels, diagnostics=diagnostics, stops=stops)

    @property
    def period(self) -> float:
        """Sampling period T [s]."""
        return self.scenario.period

    @property
    def title(self) -> str:
        """Scenario, arm and controller in one line."""
        return f"{self.scenario}, {self.controller}"

    @property
    def digest(self) -> str:
        """SHA-256 of all that the run is: equal runs, equal digests.

        Solve times and versions, which say how it was made, do not count.
        """
        arrays = {**self.arrays(), **self.diagnostics}
        del arrays["solve_time"]
        return self.head.digest(arrays, block=max(1, len(self.time)))

    @property
    def head(self) -> Head:
        """What does not change from cycle to cycle."""
        return Head(
            self.scenario,
            self.controller,
            self.options,
            self.versions,
            self.joints,
            self.urdf_sha256,
            self.stops,
            self.assumed,
            self.given,
        )

    def __eq__(self, other: object) -> bool:
        """Whether every number, name and version is the same, solve times too."""
        if not isinstance(other, Run):
            return NotImplemented
        return (
            self.digest == other.digest
            and dict(self.versions) == dict(other.versions)
            and np.array_equal(self.solve_time, other.solve_time)
        )

    __hash__ = None  # type: ignore[assignment]

    def insertion(self) -> Insertion:
        """The arm with the instrument in the trocar, as the run had them.

        Raises:
            ArmError: the URDF is not the one that the run was made with.
            RcmqpError: the arm cannot be loaded here.
        """
        insertion = self.scenario.insertion()
        if insertion.arm.sha256 != self.urdf_sha256:
            raise ArmError(
                f"{insertion.arm.urdf} has changed since the run was made; make the run again"
            )
        return insertion

    def arrays(self) -> dict[str, Array]:
        """The arrays with a unit, by name."""
        return {item.name: getattr(self, item.name) for item in channels()}

    def rows(self) -> dict[str, Array]:
        """The arrays (n, ...) with a row for each cycle, by name."""
        return {name: array for name, array in self.arrays().items() if name not in FIXED}

    def parts(self, size: int = PART) -> Iterator[Run]:
        """The run, ``size`` rows at a time; the last part may be shorter."""
        for first in range(0, len(self.time), size):
            rows = slice(first, first + size)
            yield self.with_rows(
                {name: array[rows] for name, array in self.rows().items()},
                {name: array[rows] for name, array in self.diagnostics.items()},
                within(self.stops, rows),
            )

    def column(self, name: str) -> Rows:
        """A channel with a row for each cycle."""
        return self.rows()[name]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one HDF5 file; there is a whole file afterwards or none.

        Raises:
            RunFileError: the file cannot be written.
        """
        import h5py  # only files need it, and it takes long to import

        check_replaceable(path)
        with whole(path) as part, h5py.File(part, "w", rdcc_nbytes=0) as file:
            self._write(file)  # no cache of chunks: HDF5 2.0 dies flushing it on a full disk

    def _write(self, file: h5py.File) -> None:
        self.head.write(file, self.digest)
        for item in channels():
            dataset = file.create_dataset(item.name, data=getattr(self, item.name), **CHECKED)
            dataset.attrs.update(item.metadata)
        group = file.create_group("diagnostics")
        for name, values in self.diagnostics.items():
            dataset = group.create_dataset(name, data=values, **CHECKED)
            dataset.attrs.update(about(name, self.about_diagnostics))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Run:
        """Read what save() wrote, all of it; RunFile reads a part at a time.

        Raises:
            RunFileError: the file is missing, damaged, of another format or a later version.
        """
        with opened(path) as file:
            run = cls.read(file, slice(None))
            check_digest(file, run.digest)
            return run

    @classmethod
    def read(cls, file: h5py.File, rows: slice) -> Run:
        """The part of a run in an open file that these rows are; its stops are all of them."""
        path, head = Path(file.filename), Head.read(file)
        with reading(path, "its shapes"):
            _check_shapes(path, file, head)
        arrays = {
            item.name: stored_channel(file, item.name)[() if item.name in FIXED else rows]
            for item in channels()
            if item.name in file or item.name == "path_time"
        }
        arrays.setdefault("jerk_limit", np.full_like(arrays["lower"], np.inf))  # an earlier file
        with reading(path, "the joints' limits"):
            _check_limits(**{name: arrays[name] for name in FIXED})
        names = list(file["diagnostics"])
        about_diagnostics = {}
        for name in names:
            with reading(path, f"diagnostics/{name}"):
                said = file["diagnostics"][name].attrs
                unit, meaning = (text(path, name, said[key]) for key in ("unit", "meaning"))
                about_diagnostics[name] = (unit, meaning)
        return cls(
            scenario=head.scenario,
            controller=head.controller,
            options=head.options,
            versions=head.versions,
            joints=tuple(head.joints),
            urdf_sha256=head.urdf_sha256,
            stops=head.stops,
            given=head.given,
            assumed=tuple(head.assumed),
            diagnostics={
                name: stored_channel(file, f"diagnostics/{name}")[rows] for name in names
            },
            about_diagnostics=about_diagnostics,
            **arrays,
        )


def _check_limits(lower: Array, upper: Array, **most: Array) -> None:
    if not (lower < upper).all():
        raise ValueError("a lower position limit is not below the upper one")
    for name, limit in most.items():
        if not (limit > 0.0).all():
            raise ValueError(f"{name} must be positive")


def _check_shapes(path: Path, file: h5py.File, head: Head) -> None:
    """Check that every dataset has the shape that its channel says, before any is read.

    Raises:
        RunFileError: one has not, or has more rows than the scenario has cycles.
    """
    missing = [item.name for item in channels() if item.name not in file]
    if missing := [name for name in missing if name not in ("path_time", "jerk_limit")]:
        raise RunFileError(path, f"damaged: {missing[0]} is missing")
    if "diagnostics" not in file:
        raise RunFileError(path, "damaged: the group diagnostics is missing")
    nv, n = len(head.joints), (*file["time"].shape, 0)[0]
    if not 1 <= n <= head.scenario.cycles:
        raise RunFileError(
            path, f"damaged: time has {n} rows, the scenario {head.scenario.cycles} cycles"
        )
    nq = (*file["q"].shape, 0, 0)[1]
    if not nv <= nq <= 2 * nv:
        raise RunFileError(path, f"damaged: q has {nq} columns for {nv} joints")
    sizes = {"n": n, "nv": nv, "nq": nq, "3": 3, "8": 8}
    shapes = {f"diagnostics/{name}": (n,) for name in file["diagnostics"]}
    for item in channels():
        if item.name in file:
            said = item.metadata["meaning"].partition(")")[0].strip("(").split(",")
            shapes[item.name] = tuple(sizes[size.strip()] for size in said if size)
    for name, shape in shapes.items():
        if file[name].shape != shape:
            raise RunFileError(
                path, f"damaged: {name} has shape {file[name].shape}, it must be {shape}"
            )


def within(stops: Mapping[str, Sequence[int]], rows: slice) -> dict[str, list[int]]:
    """Of a run's stops those in some rows, counted from the first of them."""
    found = {
        reason: [k - rows.start for k in cycles if rows.start <= k < rows.stop]
        for reason, cycles in stops.items()
    }
    return {reason: cycles for reason, cycles in found.items() if cycles}


def stored_channel(file: h5py.File, name: str) -> StoredRows:
    """A dataset in a run's file; files of before there was ``path_time`` have ``time`` for it."""
    allow = _ALLOWED.get(name, "nan")
    if name in FIXED or name.startswith("diagnostics/"):
        allow = "anything"
    return StoredRows(file["time" if name == "path_time" and name not in file else name], allow)


def channels() -> list[dataclasses.Field[Any]]:
    """The fields of Run that are arrays; unit and meaning are their metadata."""
    return [item for item in dataclasses.fields(Run) if "unit" in item.metadata]
