"""The one way in which a run gets into a file: part after part, atomically."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rcmqp.errors import OptionError, RunFileError
from rcmqp.files import whole_file
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.channels import CHANNELS, FIXED, NOT_IN_DIGEST, PART, about_diagnostic
from rcmqp.runs.head import CHECKED, Head, check_replaceable
from rcmqp.runs.scenario import Scenario

if TYPE_CHECKING:
    import h5py

    from rcmqp.runs.run import Run


class RunWriter:
    """Writes the parts of a run into an open file; see writing().

    Attributes:
        scenario: what the file is to say of the scenario, if that is known only at the end; None
            for what the first part says.
    """

    def __init__(self, file: h5py.File, path: Path, block: int) -> None:
        self.scenario: Scenario | None = None
        self._file, self._path, self._block = file, path, block
        self._written = 0
        self._stops: dict[str, list[int]] = {}
        self._head: Head | None = None
        self._arm: dict[str, Array] = {}

    def write(self, part: Run) -> None:
        """Write some cycles of the run, the next ones.

        Raises:
            OptionError: the scenario has no more cycles.
            OSError: the disk is full, or the like; h5py raises RuntimeError at times.
        """
        first, last, most = self._written, self._written + len(part.time), part.scenario.cycles
        if last > most:
            raise OptionError(f"{part.scenario} has {most} cycles, not more")
        for name, values in part.rows().items():
            self._put(name, values, CHANNELS[name].about, min(self._block, most))
        for name, values in part.diagnostics.items():
            about = about_diagnostic(name, part.about_diagnostics)
            self._put(f"diagnostics/{name}", values, about, min(self._block, most))
        for reason, cycles in part.stops.items():
            self._stops.setdefault(reason, []).extend(first + k for k in cycles)
        self._written = last
        if self._head is None:
            self._head = part.head
            self._arm = {name: getattr(part, name) for name in FIXED}

    def _put(self, name: str, values: Array, about: Mapping[str, str], chunk: int) -> None:
        rows = slice(self._written, self._written + len(values))
        if name not in self._file:
            made = self._file.create_dataset(
                name,
                (rows.stop, *values.shape[1:]),
                dtype=float,
                chunks=(chunk, *values.shape[1:]),
                maxshape=(None, *values.shape[1:]),
                fillvalue=np.nan,
                **CHECKED,
            )
            made.attrs.update(about)
        self._file[name].resize(rows.stop, axis=0)
        self._file[name][rows] = values

    def finish(self) -> None:
        """Write the head of the run and its digest.

        Raises:
            RunFileError: no cycle was written.
            OSError: as write().
        """
        if self._head is None:
            raise RunFileError(self._path, "not written: no cycle was recorded")
        file = self._file
        rows = {name: file[name] for name in file if name in CHANNELS}
        rows |= dict(file.require_group("diagnostics"))
        for dataset in rows.values():
            dataset.resize(self._written, axis=0)  # a diagnostic may have ended before
        for name, values in self._arm.items():
            rows[name] = file.create_dataset(name, data=values, **CHECKED)
            rows[name].attrs.update(CHANNELS[name].about)
        del rows[NOT_IN_DIGEST]
        scenario = self.scenario or self._head.scenario
        head = dataclasses.replace(self._head, scenario=scenario, stops=self._stops)
        head.write(file, head.digest(rows, block=self._block))


@contextmanager
def writing(path: str | os.PathLike[str], block: int = PART) -> Iterator[RunWriter]:
    """Write a run's file atomically: it is there when the block ends, and not if it raises.

    An earlier file of that name stays until then. Memory does not grow with the run,
    except for the numbers of the cycles in which the controller stopped safely.

    Args:
        path: of the file.
        block: rows of a chunk of the file.

    Raises:
        RunFileError: the file cannot be written.
    """
    import h5py  # only files need it, and it takes long to import

    check_replaceable(path)
    # no cache of chunks: HDF5 2.0 dies flushing it on a full disk
    with whole_file(path) as part, h5py.File(part, "w", rdcc_nbytes=0) as file:
        writer = RunWriter(file, Path(path), block)
        yield writer
        writer.finish()
