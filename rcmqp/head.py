"""What a run's file says once: scenario, controller, versions; and the digest over all of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rcmqp.scenario import Scenario

if TYPE_CHECKING:
    import h5py

FORMAT = "rcmqp run"
FORMAT_VERSION = 2
CHECKED = {"fletcher32": True}  # each dataset carries checksums, verified on reading


class Rows(Protocol):
    """An array, or a dataset of a file, which is read as it is sliced."""

    @property
    def shape(self) -> tuple[int, ...]: ...  # noqa: D102

    @property
    def dtype(self) -> Any: ...  # noqa: D102

    def __getitem__(self, rows: slice, /) -> Any: ...


@dataclass(frozen=True, slots=True)
class Head:
    """What does not change from cycle to cycle; see Run for the meanings."""

    scenario: Scenario
    controller: str
    options: Mapping[str, Any]
    versions: Mapping[str, str]
    joints: Sequence[str]
    urdf_sha256: str
    stops: Mapping[str, Sequence[int]]

    def digest(self, arrays: Mapping[str, Rows], block: int) -> str:
        """SHA-256 over arrays, read ``block`` rows at a time, and head; versions do not count."""
        sha = hashlib.sha256()
        for name in sorted(arrays):
            array = arrays[name]
            sha.update(f"{name} {array.shape} {array.dtype}".encode())
            for first in range(0, array.shape[0], block):
                sha.update(np.ascontiguousarray(array[first : first + block]).tobytes())
        sha.update(json.dumps(tuple(self.joints)).encode())
        sha.update(self.scenario.to_json().encode())
        sha.update(self.urdf_sha256.encode())
        sha.update(json.dumps([self.controller, dict(self.options)], sort_keys=True).encode())
        if self.stops:
            sha.update(json.dumps(self.stops).encode())
        return sha.hexdigest()

    def write(self, file: h5py.File, digest: str) -> None:
        """Put it into a file."""
        file.create_dataset("stops", data=json.dumps(self.stops))
        file.attrs["format"] = FORMAT
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["scenario"] = self.scenario.to_json()
        file.attrs["controller"] = self.controller
        file.attrs["options"] = json.dumps(dict(self.options))
        file.attrs["versions"] = json.dumps(dict(self.versions))
        file.attrs["joints"] = json.dumps(tuple(self.joints))
        file.attrs["urdf_sha256"] = self.urdf_sha256
        file.attrs["seed"] = self.scenario.seed
        file.attrs["digest"] = digest


def about(name: str, known: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    """Unit and meaning of one of a controller's diagnostics, as its dataset has them."""
    unit, meaning = known.get(name, ("", "(n,) see the controller"))
    return {"unit": unit, "meaning": meaning}
