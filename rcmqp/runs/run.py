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
from rcmqp.errors import ArmError, InsertionError, OptionError, RunFileError
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.channels import CHANNELS, EARLIER, FIXED, NOT_IN_DIGEST, PART, ROWS, Channels
from rcmqp.runs.head import Column, Head, check_digest, opened
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.untrusted import StoredRows, reading, text
from rcmqp.runs.writer import writing
from rcmqp.world.carried import CarriedArm
from rcmqp.world.insertion import Insertion

if TYPE_CHECKING:
    import h5py

SAME_POSE = 1e-6
"""Largest difference of a dual quaternion's numbers up to which an arm is the same [1, m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(Channels):
    """A recorded run of n sampling instants; each row is taken before the step.

    Every array, see Channels, is a dataset of the file, its unit and meaning are the dataset's
    attributes.
    """

    scenario: Scenario
    controller: str
    options: Mapping[str, Any]
    versions: Mapping[str, str]
    joints: tuple[str, ...]
    urdf_sha256: str
    diagnostics: Mapping[str, Array] = field(default_factory=dict)
    about_diagnostics: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    stops: Mapping[str, Sequence[int]] = field(default_factory=dict)
    """Why the controller stopped safely, and the rows of the cycles in which it did."""
    assumed: tuple[str, ...] = ()
    """Which limits were assumed; see Arm.assumed."""
    given: Given = UNKNOWN
    """Inputs and limits of the controller; unknown in files of earlier versions."""
    arm: CarriedArm | None = None
    """The sources of the arm; None in files of earlier versions."""

    def __post_init__(self) -> None:
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
        """The same run with other cycles."""
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
        """SHA-256 of the run: equal runs have equal digests.

        Solve times and versions do not count.
        """
        arrays = {**self.arrays(), **self.diagnostics}
        del arrays[NOT_IN_DIGEST]
        return self.head.digest(arrays, block=max(1, len(self.time)))

    @property
    def head(self) -> Head:
        """The part of the run that does not change from cycle to cycle."""
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
            self.arm,
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

    def drawn_with(self, arm: str, flange: str | None = None) -> Run:
        """The run with another file of the same arm, such as one whose meshes are here.

        Args:
            arm: a name that load_arm() knows, or the path of an arm's file or of a URDF.
            flange: with a URDF, the frame that carries the instrument.

        Raises:
            ArmError: its joints, or where they bring the instrument, are not the run's.
            RcmqpError: the arm cannot be loaded.
        """
        scenario = dataclasses.replace(self.scenario, arm=arm, flange=flange, carried_arm=None)
        bare, wrist = scenario.load_arm(), scenario.instrument.wrist
        joints = (*bare.joints, *(joint.name for joint in (wrist.joints if wrist else ())))
        if joints != self.joints:
            raise ArmError(
                f"{arm} has the joints {', '.join(joints)}, the run {', '.join(self.joints)}; "
                "give the arm that it was made with"
            )
        try:
            insertion = scenario.insertion()
            apart = float(np.abs(insertion.state(self.q[0]).x - self.x[0]).max())
        except InsertionError:
            apart = np.inf
        if not apart < SAME_POSE:
            raise ArmError(
                f"{arm} brings the instrument elsewhere than in the run, with the same joint "
                "angles; give the arm that it was made with"
            )
        carried = CarriedArm.of(bare)
        if carried is not None and self.arm is not None:
            carried = dataclasses.replace(carried, meshes=self.arm.meshes)
        scenario = dataclasses.replace(scenario.portable(), carried_arm=carried)
        return dataclasses.replace(self, scenario=scenario, urdf_sha256=bare.sha256, arm=carried)

    def arrays(self) -> dict[str, Array]:
        """The arrays with a unit, by name."""
        return {name: getattr(self, name) for name in CHANNELS}

    def rows(self) -> dict[str, Array]:
        """The arrays (n, ...) with a row for each cycle, by name."""
        return {name: getattr(self, name) for name in ROWS}

    def parts(self, size: int = PART) -> Iterator[Run]:
        """The run, ``size`` rows at a time; the last part may be shorter."""
        for first in range(0, len(self.time), size):
            rows = slice(first, first + size)
            yield self.with_rows(
                {name: array[rows] for name, array in self.rows().items()},
                {name: array[rows] for name, array in self.diagnostics.items()},
                within(self.stops, rows),
            )

    def column(self, name: str) -> Column:
        """A channel with a row for each cycle."""
        return self.rows()[name]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one HDF5 file; there is a whole file afterwards or none.

        Raises:
            RunFileError: the file cannot be written.
        """
        with writing(path) as writer:
            writer.write(self)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Run:
        """Read a whole file of save(); RunFile reads a part at a time.

        Raises:
            RunFileError: the file is missing, damaged, of another format or a later version.
        """
        with opened(path) as file:
            run = cls.read(file, slice(None))
            check_digest(file, run.digest)
            return run

    @classmethod
    def read(cls, file: h5py.File, rows: slice) -> Run:
        """Read some rows of a run from an open file, with the stops of the whole run."""
        path, head = Path(file.filename), Head.read(file)
        with reading(path, "its shapes"):
            _check_shapes(path, file, head)
        arrays = {
            name: stored_channel(file, name)[() if name in FIXED else rows]
            for name in CHANNELS
            if name in file or name == "path_time"
        }
        arrays.setdefault("jerk_limit", np.full_like(arrays["lower"], np.inf))  # an earlier file
        with reading(path, "the joints' limits"):
            _check_limits(**{name: arrays[name] for name in FIXED})
        names = list(file["diagnostics"])
        about_diagnostics = {}
        for name in names:
            with reading(path, f"diagnostics/{name}"):
                attributes = file["diagnostics"][name].attrs
                unit, meaning = (text(path, name, attributes[key]) for key in ("unit", "meaning"))
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
            arm=head.arm,
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
    if missing := [name for name in CHANNELS if name not in file and name not in EARLIER]:
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
    shapes: dict[str, tuple[int, ...]] = {
        f"diagnostics/{name}": (n,) for name in file["diagnostics"]
    }
    shapes |= {
        name: channel.sizes(n=n, nq=nq, nv=nv)
        for name, channel in CHANNELS.items()
        if name in file
    }
    for name, shape in shapes.items():
        if file[name].shape != shape:
            raise RunFileError(
                path, f"damaged: {name} has shape {file[name].shape}, it must be {shape}"
            )


def within(stops: Mapping[str, Sequence[int]], rows: slice) -> dict[str, list[int]]:
    """The stops of a run in some rows, counted from the first of these rows."""
    inside = {
        reason: [k - rows.start for k in cycles if rows.start <= k < rows.stop]
        for reason, cycles in stops.items()
    }
    return {reason: cycles for reason, cycles in inside.items() if cycles}


def stored_channel(file: h5py.File, name: str) -> StoredRows:
    """A dataset in a run's file; files of before there was ``path_time`` have ``time`` for it."""
    allow = CHANNELS[name].allow if name in CHANNELS else "anything"
    return StoredRows(file["time" if name == "path_time" and name not in file else name], allow)
