"""One trial's file: whole or not there, and known for whose it is."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rcmqp.errors import RunFileError
from rcmqp.experiments.study.outcome import TRACES, Outcome
from rcmqp.files import absent, whole_file
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import versions
from rcmqp.runs.untrusted import (
    MOST_TEXT,
    StoredRows,
    datasets,
    json_of,
    reading,
    text,
    text_of,
    whole_number,
)

FORMAT = "rcmqp trial"
FORMAT_VERSION = 5
SUFFIX = ".h5"


@dataclass(frozen=True, eq=False)
class TrialFile:
    """What is kept of a trial.

    Attributes:
        outcome: its numbers.
        scenario: the scenario as JSON, operator and seed in it.
        law: the controller as JSON, see Law.
        made_of: what else the trial depends on, see identity().
        traces: see TRACES; none of a trial that failed.
        versions: of what ran it, see simulate.versions(); not part of the digest.
    """

    outcome: Outcome
    scenario: str
    law: str
    made_of: str
    traces: Mapping[str, Array]
    versions: Mapping[str, str] = field(default_factory=versions)

    @property
    def digest(self) -> str:
        """SHA-256 of all of it."""
        sha = hashlib.sha256(f"{self.scenario}{self.law}{self.made_of}".encode())
        sha.update(_json(self.outcome).encode())
        for name in sorted(self.traces):
            values = np.ascontiguousarray(self.traces[name])
            sha.update(f"{name} {values.shape} {values.dtype}".encode())
            sha.update(values.tobytes())
        return sha.hexdigest()

    def save(self, path: Path) -> None:
        """Write one HDF5 file; there is a whole file afterwards or none.

        Raises:
            RunFileError: it cannot be written.
        """
        image = self._image()
        with whole_file(path) as part:
            part.write_bytes(image)

    def _image(self) -> bytes:
        """The file's bytes."""
        image = io.BytesIO()
        with h5py.File(image, "w") as file:
            file.attrs["format"] = FORMAT
            file.attrs["format_version"] = FORMAT_VERSION
            file.attrs["scenario"] = self.scenario
            file.attrs["law"] = self.law
            file.attrs["made_of"] = self.made_of
            file.attrs["outcome"] = _json(self.outcome)
            file.attrs["versions"] = json.dumps(self.versions)
            file.attrs["digest"] = self.digest
            for name, values in self.traces.items():
                dataset = file.create_dataset(name, data=values, compression="gzip")
                dataset.attrs.update(unit=TRACES[name][0], meaning=TRACES[name][1])
        return image.getvalue()

    @classmethod
    def load(cls, path: Path) -> TrialFile:
        """Read what save() wrote.

        Raises:
            RunFileError: the file is missing, damaged or no trial's.
        """
        if not path.is_file():
            raise RunFileError(path, f"{absent(path)}; give the path of a trial's .h5")
        with reading(path, "opening it"), h5py.File(path, "r") as file:
            kind = text_of(path, file, "format") if "format" in file.attrs else ""
            if kind != FORMAT:
                raise RunFileError(path, "is no trial of a study; move it elsewhere")
            version = whole_number(path, file, "format_version")
            if version != FORMAT_VERSION:
                raise RunFileError(
                    path, f"has format version {version}, this rcmqp reads {FORMAT_VERSION}"
                )
            stored = datasets(path, file, compressed=True)
            said = {
                name: text_of(path, file, name)
                for name in ("scenario", "law", "made_of", "outcome", "versions", "digest")
            }
            with reading(path, "scenario"):
                most = Scenario.from_json(said["scenario"]).cycles
            _check_shapes(path, stored, most)
            with reading(path, "outcome"):
                outcome = _outcome(json_of(path, "outcome", said["outcome"], dict))
            record = cls(
                outcome,
                said["scenario"],
                said["law"],
                said["made_of"],
                {name: StoredRows(dataset)[()] for name, dataset in stored.items()},
                _texts(path, json_of(path, "versions", said["versions"], dict)),
            )
            if record.digest != said["digest"]:
                raise RunFileError(path, "is damaged: its numbers do not fit its digest")
            return record


def _check_shapes(path: Path, stored: Mapping[str, h5py.Dataset], most: int) -> None:
    """Check that the traces are those of a trial of so many cycles at most."""
    rows = {dataset.shape[0] if dataset.shape else 0 for dataset in stored.values()}
    if stored and (set(stored) != set(TRACES) or len(rows) > 1 or max(rows) > most):
        raise RunFileError(path, f"is damaged: its traces are not those of {most} cycles")
    for name, dataset in stored.items():
        columns = (3,) if "(n, 3)" in TRACES[name][1] else ()
        if dataset.shape[1:] != columns:
            raise RunFileError(path, f"is damaged: {name} has shape {dataset.shape}")


def _outcome(data: dict[str, Any]) -> Outcome:
    """What plain() made a mapping of, with each value of the field's type."""
    data["reached_s"] = tuple(map(_number, data["reached_s"]))
    made: dict[str, Any] = {}
    for item in dataclasses.fields(Outcome):
        value = _number(data.pop(item.name)) if item.type == "float" else data.pop(item.name)
        kind = {"int": int, "str": str, "bool": bool}.get(str(item.type), object)
        if not isinstance(value, kind) or (isinstance(value, str) and len(value) > MOST_TEXT):
            raise ValueError(f"{item.name} = {value!r:.50}, it must be of type {item.type}")
        made[item.name] = value
    if data:
        raise ValueError(f"{sorted(data)[0]!r:.50} is unknown")
    return Outcome(**made)


def _texts(path: Path, versions: dict[str, Any]) -> dict[str, str]:
    return {name: text(path, "versions", value) for name, value in versions.items()}


def _json(outcome: Outcome) -> str:
    return json.dumps(plain(outcome), sort_keys=True, allow_nan=False)


def plain(outcome: Outcome) -> dict[str, Any]:
    """An outcome's numbers by name, NaN as None."""
    data = dataclasses.asdict(outcome)
    data["reached_s"] = [None if np.isnan(t) else t for t in outcome.reached_s]
    return {
        name: None if isinstance(value, float) and np.isnan(value) else value
        for name, value in data.items()
    }


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)
