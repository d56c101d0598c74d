"""The head of a run's file: format, scenario, controller, versions; and the digest."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rcmqp.controllers.given import UNKNOWN, Given
from rcmqp.errors import RunFileError
from rcmqp.files import absent, check_writable
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.untrusted import DAMAGED, datasets, json_of, reading, text, text_of, whole_number
from rcmqp.world.carried import CarriedArm
from rcmqp.world.limited import ASSUMED

if TYPE_CHECKING:
    import h5py

SIGNATURE = b"\x89HDF\r\n\x1a\n"
FORMAT = "rcmqp run"
FORMAT_VERSION = 2
CHECKED = {"fletcher32": True}  # each dataset carries checksums, verified on reading

MOST_NAME = 500
"""Letters of a name in a file."""

MOST_REASON = 10_000
"""Letters of the reason of a safe stop."""


OTHER = "give another name or folder, or remove it first"


class Named(Protocol):
    """Name and options, which distinguish controllers; a Controller has them."""

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def options(self) -> Mapping[str, Any]: ...  # noqa: D102


class Column(Protocol):
    """An array, or a dataset of a file, which is read as it is sliced."""

    @property
    def shape(self) -> tuple[int, ...]: ...  # noqa: D102

    @property
    def dtype(self) -> Any: ...  # noqa: D102

    def __getitem__(self, rows: slice, /) -> Any: ...


@dataclass(frozen=True, slots=True)
class Head:
    """The part of a run that does not change from cycle to cycle; see Run for the meanings."""

    scenario: Scenario
    controller: str
    options: Mapping[str, Any]
    versions: Mapping[str, str]
    joints: Sequence[str]
    urdf_sha256: str
    stops: Mapping[str, Sequence[int]]
    assumed: Sequence[str] = ()
    given: Given = UNKNOWN
    arm: CarriedArm | None = None

    @property
    def _portable(self) -> Scenario:
        """The scenario as the file has it; files without an arm name it by its path."""
        return self.scenario if self.arm is None else self.scenario.portable()

    def digest(self, arrays: Mapping[str, Column], block: int) -> str:
        """SHA-256 over arrays, read ``block`` rows at a time, and head; versions do not count.

        Neither does ``path_time`` if it is ``time``, nor jerk limits that are all infinite: files
        of earlier versions, which have neither, have the same digest. So do files of versions that
        did not say what the controller was given.
        """
        sha = hashlib.sha256()
        for name in sorted(arrays):
            if name == "path_time" and _equal(arrays[name], arrays["time"], block):
                continue
            array = arrays[name]
            if name == "jerk_limit" and np.isinf(array[:]).all():
                continue
            sha.update(f"{name} {array.shape} {array.dtype}".encode())
            for first in range(0, array.shape[0], block):
                sha.update(np.ascontiguousarray(array[first : first + block]).tobytes())
        sha.update(json.dumps(tuple(self.joints)).encode())
        sha.update(self._portable.to_json().encode())
        sha.update(self.urdf_sha256.encode())
        sha.update(json.dumps([self.controller, dict(self.options)], sort_keys=True).encode())
        if self.stops:
            sha.update(json.dumps(self.stops).encode())
        if self.assumed:
            sha.update(json.dumps(tuple(self.assumed)).encode())
        if self.given != UNKNOWN:
            given = json.loads(self.given.to_json())
            for name in ("roll", "objective", "file"):  # of which earlier versions did not speak
                del given[name]
            sha.update(json.dumps(given).encode())
        return sha.hexdigest()

    def is_of(self, scenario: Scenario, controller: Named) -> bool:
        """Whether the same command made the run: same scenario, controller and options."""
        plain = (
            json.dumps(dict(options), sort_keys=True, default=str)
            for options in (self.options, controller.options)
        )
        return (
            self.scenario.to_json() == scenario.portable().to_json()
            and self.controller == controller.name
            and len(set(plain)) == 1
        )

    @classmethod
    def read(cls, file: h5py.File) -> Head:
        """Read it from a file and check every part.

        Raises:
            RunFileError: a part is missing or is not what it has to be.
        """
        path = Path(file.filename)

        def said(name: str, kind: type, default: str = "") -> Any:
            if default and name not in file.attrs:
                return json.loads(default)
            return json_of(path, name, text_of(path, file, name), kind)

        with reading(path, "scenario"):
            scenario = Scenario.from_json(text_of(path, file, "scenario"))
        with reading(path, "given"):
            known = "given" in file.attrs
            given = Given.from_json(text_of(path, file, "given")) if known else UNKNOWN
        arm = None
        if "arm" in file:
            with reading(path, "arm"):
                said_of_it = text(path, "arm", file["arm"][()])
                arm = CarriedArm.from_json(said_of_it, path.absolute().parent)
                if arm.name != scenario.arm:
                    raise ValueError(f"{arm.name!r:.50} is not the scenario's, {scenario.arm:.50}")
                scenario = dataclasses.replace(scenario, carried_arm=arm)
        stops = {}
        if "stops" in file:
            with reading(path, "stops"):
                stops = json_of(path, "stops", text(path, "stops", file["stops"][()]), dict)
        head = cls(
            scenario=scenario,
            controller=text_of(path, file, "controller"),
            options=said("options", dict),
            versions=said("versions", dict),
            joints=tuple(said("joints", list)),
            urdf_sha256=text_of(path, file, "urdf_sha256"),
            stops=stops,
            assumed=tuple(said("assumed", list, "[]")),
            given=given,
            arm=arm,
        )
        with reading(path, "its names"):
            head._check(path)
        return head

    def _check(self, path: Path) -> None:
        """Check that names are texts and that cycles are the scenario's."""
        parts = {
            "controller": [self.controller],
            "versions": [*self.versions, *self.versions.values()],
            "joints": self.joints,
            "assumed": self.assumed,
            "options": self.options,
            "stops": self.stops,
        }
        for part, names in parts.items():
            most = MOST_REASON if part == "stops" else MOST_NAME
            if any(not isinstance(name, str) or len(name) > most for name in names):
                raise RunFileError(
                    path, f"damaged: {part}: names must be texts of at most {most} letters"
                )
        if len(self.joints) != len(self.scenario.angles_start):
            raise RunFileError(
                path,
                f"damaged: joints: {len(self.joints)}, the scenario starts at "
                f"{len(self.scenario.angles_start)} angles",
            )
        if wrong := set(self.assumed) - set(ASSUMED):
            raise RunFileError(path, f"damaged: assumed: {sorted(wrong)[0]!r}")
        gain = self.options.get("gain", 0.0)
        if isinstance(gain, bool) or not isinstance(gain, int | float) or not abs(gain) < 1e300:
            raise RunFileError(path, f"damaged: options: gain = {gain!r:.50} must be a number")
        last = self.scenario.cycles
        for reason, cycles in self.stops.items():
            if not isinstance(cycles, list) or not cycles:
                raise RunFileError(path, f"damaged: stops: no cycles of {reason[:50]!r}")
            if any(type(k) is not int or not 0 <= k < last for k in cycles):
                raise RunFileError(path, f"damaged: stops: cycles of {reason[:50]!r}")

    def write(self, file: h5py.File, digest: str) -> None:
        """Write it into a file."""
        file.create_dataset("stops", data=json.dumps(self.stops))
        file.attrs["format"] = FORMAT
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["scenario"] = self._portable.to_json()
        if self.arm is not None:
            file.create_dataset("arm", data=self.arm.to_json())
        file.attrs["controller"] = self.controller
        file.attrs["options"] = json.dumps(dict(self.options))
        file.attrs["versions"] = json.dumps(dict(self.versions))
        file.attrs["joints"] = json.dumps(tuple(self.joints))
        file.attrs["urdf_sha256"] = self.urdf_sha256
        file.attrs["given"] = self.given.to_json()
        file.attrs["assumed"] = json.dumps(tuple(self.assumed))
        file.attrs["seed"] = self.scenario.seed
        file.attrs["digest"] = digest


def _equal(a: Column, b: Column, block: int) -> bool:
    """Whether all rows are the same, read ``block`` of them at a time."""
    return a.shape == b.shape and all(
        np.array_equal(a[first : first + block], b[first : first + block])
        for first in range(0, a.shape[0], block)
    )


@contextlib.contextmanager
def opened(path: str | os.PathLike[str]) -> Iterator[h5py.File]:
    """Open a run's file for reading; any error in the block becomes one of the file.

    Raises:
        RunFileError: the file is missing, damaged, of another format or a later version.
    """
    import h5py  # only files need it, and it takes long to import

    path = Path(path)
    if not path.is_file():
        raise RunFileError(path, f"{absent(path)}; give the path of a run's .h5")
    with reading(path, "opening it"):
        with path.open("rb") as stream:
            if stream.read(len(SIGNATURE)) != SIGNATURE:
                raise RunFileError(path, "not an HDF5 file; rcmqp run --out writes one")
        with h5py.File(path, "r", rdcc_nbytes=0) as file:  # a chunk is read when it is asked for
            kind = text_of(path, file, "format") if "format" in file.attrs else ""
            if kind == "rcmqp trial":
                raise RunFileError(
                    path,
                    "a study's trial, which holds numbers and no run; simulate it again: "
                    f"rcmqp study {path} --out again",
                )
            if kind != FORMAT:
                raise RunFileError(path, "an HDF5 file, but not a run of rcmqp")
            version = whole_number(path, file, "format_version")
            if version != FORMAT_VERSION:
                raise RunFileError(
                    path, f"has format version {version}, this rcmqp reads {FORMAT_VERSION}"
                )
            datasets(path, file, ("diagnostics",), ("stops", "arm"))
            yield file


def check_replaceable(path: str | os.PathLike[str]) -> None:
    """Check before a run that its file can be written.

    Raises:
        RunFileError: it cannot, or the file that is there is not a run.
    """
    check_writable(path)
    path = Path(path)
    if path.is_file() and path.stat().st_size:
        with path.open("rb") as stream:
            if stream.read(len(SIGNATURE)) != SIGNATURE:
                raise RunFileError(
                    path, "is there already, and is no run; give another name, or remove it first"
                )


def check_own(
    path: str | os.PathLike[str],
    scenario: Scenario | None = None,
    controller: Named | None = None,
) -> None:
    """Check before a run that its file may be written: another run is not overwritten.

    What the same command made before, or a damaged file, may be replaced.

    Args:
        path: of the file.
        scenario: what is to be run; None for a recording, which no command makes again.
        controller: that is to run it.

    Raises:
        RunFileError: the file cannot be written; or it holds another run, or no run.
    """
    check_replaceable(path)
    path = Path(path)
    if not path.is_file() or not path.stat().st_size:
        return
    try:
        with opened(path) as file:
            head = Head.read(file)
    except RunFileError as error:
        if error.reason.startswith(DAMAGED):
            return
        raise RunFileError(path, f"is there already, and is no run; {OTHER}") from error
    if scenario is None or controller is None or not head.is_of(scenario, controller):
        there = f"{head.scenario}, {head.controller}"
        raise RunFileError(path, f"holds another run, {there}; {OTHER}")


def check_digest(file: h5py.File, digest: str) -> None:
    """Check the digest of what was read.

    Raises:
        RunFileError: the file says another digest.
    """
    path = Path(file.filename)
    if digest != text_of(path, file, "digest"):
        raise RunFileError(path, "damaged: its numbers do not fit its digest")
