"""A run's file written while the run goes on, in the memory of one block, however long it is."""

from __future__ import annotations

import contextlib
import dataclasses
import glob
import os
import platform
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.controllers.base import Controller
from rcmqp.errors import OptionError, RunFileError
from rcmqp.files import why
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.cycles import ROW, Cycles
from rcmqp.runs.head import CHECKED, Head, about, check_replaceable
from rcmqp.runs.run import FIXED, PART, Run, channels
from rcmqp.runs.scenario import Scenario

if TYPE_CHECKING:
    import h5py


class Recorder:
    """What each cycle leaves, streamed to a file that Run.load() reads.

        with Recorder(path, scenario, controller, versions()) as recorder:
            for ... in cycles:
                recorder.append(answer.diagnostics, answer.stop, q=..., x=..., ...)

    There is a whole file when the block is left without an error, or none, and an earlier one is
    kept until then: it is written beside it, and takes its name at the end. Numbers and digest
    are those of the Run that simulate() makes of the same cycles. Beside the block, memory holds
    the number of each cycle in which the controller stopped safely.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        scenario: Scenario,
        controller: Controller,
        versions: Mapping[str, str],
        *,
        block: int = PART,
    ) -> None:
        """Find out whether the file can be written; nothing is, yet.

        Args:
            path: of the file.
            scenario: what is run; it knows how many cycles may come.
            controller: made for it.
            versions: of Python and packages, see simulate.versions().
            block: rows kept in memory.

        Raises:
            RunFileError: the file cannot be written.
        """
        self._path = Path(path).resolve()
        check_replaceable(self._path)
        self._stem = f".{self._path.name}.{platform.node()}."  # folders are shared between hosts
        self._part = self._path.with_name(f"{self._stem}{os.getpid()}.recording")
        self._cycles = Cycles(scenario, controller, versions, block)
        self._scenario, self._size = scenario, block
        self._written = 0
        self._stops: dict[str, list[int]] = {}
        self._first: Run | None = None

    def __enter__(self) -> Self:
        """Open the file beside the one to be."""
        import h5py  # only files need it, and it takes long to import

        self._sweep()
        try:
            self._file: h5py.File = h5py.File(self._part, "w", rdcc_nbytes=0)
        except (OSError, RuntimeError) as error:  # h5py raises either
            self._part.unlink(missing_ok=True)
            raise RunFileError(self._path, f"could not be written: {why(error)}") from error
        return self

    def append(
        self,
        diagnostics: Mapping[str, float],
        stop: str = "",
        *,
        solve_time: float,
        path_time: float | None = None,
        **row: ArrayLike,
    ) -> None:
        """Record a cycle.

        Args:
            diagnostics: of the controller's answer; a number that is not there every time is
                NaN where it is not.
            stop: why the controller stopped safely; empty where it did not.
            solve_time: how long the controller took [s].
            path_time: on the path's own clock [s], see PathClock; the time, if not given.
            row: q, q_measured (nq,), angles, v, v_actual, v_measured (nv,), x, x_d (8,),
                J (6, nv); see Run and ArmState.

        Raises:
            OptionError: a value is missing, unknown or of another shape, or the scenario has no
                more cycles.
            RunFileError: the disk is full, or the like.
        """
        if wrong := sorted(row.keys() ^ set(ROW)):
            raise OptionError(f"{wrong} missing or unknown; a row has {sorted(ROW)}")
        arrays = [np.ascontiguousarray(row[name], dtype=float) for name in ROW]
        for array, (name, shape) in zip(arrays, self._cycles.shapes.items(), strict=True):
            if array.shape != shape:
                raise OptionError(f"{name} has shape {array.shape}, it must be {shape}")
        self._check_room(1)
        self._cycles.add(solve_time, diagnostics, stop, *arrays, path_time=path_time)
        if len(self._cycles) == self._size:
            self._flush()

    def write(self, part: Run) -> None:
        """Record some cycles of a run, the next ones.

        Raises:
            OptionError: the scenario has no more cycles.
            RunFileError: the disk is full, or the like.
        """
        self._check_room(len(part.time))
        self._flush()
        self._write(part)
        self._cycles.follow(part)

    def _flush(self) -> None:
        """Write what append() has kept in memory."""
        if len(self._cycles):
            self._write(self._cycles.part())

    def _write(self, part: Run) -> None:
        meanings = {item.name: item.metadata for item in channels()}
        try:
            for name, values in part.rows().items():
                self._put(name, values, meanings[name])
            for name, values in part.diagnostics.items():
                self._put(f"diagnostics/{name}", values, about(name, part.about_diagnostics))
        except (OSError, RuntimeError) as error:  # h5py raises either
            raise RunFileError(self._path, f"could not be written: {why(error)}") from error
        for reason, cycles in part.stops.items():
            self._stops.setdefault(reason, []).extend(self._written + k for k in cycles)
        self._written += len(part.time)
        self._first = self._first or next(part.parts(1))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Write what is left and give the file its name; or, after an error, leave nothing."""
        try:
            if error is None:
                self._finish()
        finally:
            with contextlib.suppress(OSError, RuntimeError):  # a full disk raises again
                self._file.close()
            self._part.unlink(missing_ok=True)

    def _sweep(self) -> None:
        """Remove what a process of this machine that was killed left of this file."""
        for left in self._path.parent.glob(f"{glob.escape(self._stem)}*.recording"):
            process = left.name[len(self._stem) : -len(".recording")]
            if process.isdecimal() and not _runs(int(process)):
                left.unlink(missing_ok=True)

    def _finish(self) -> None:
        """Write what is left, and give the file its name."""
        self._flush()
        if self._first is None:
            raise RunFileError(self._path, "not written: no cycle was recorded")
        try:
            self._write_head(dataclasses.replace(self._first.head, stops=self._stops))
            self._file.close()
            self._part.replace(self._path)
        except (OSError, RuntimeError) as error:
            raise RunFileError(self._path, f"could not be written: {why(error)}") from error

    def _check_room(self, more: int) -> None:
        if self._written + len(self._cycles) + more > self._scenario.cycles:
            raise OptionError(f"{self._scenario} has {self._scenario.cycles} cycles, not more")

    def _put(self, name: str, values: Array, about: Mapping[str, Any]) -> None:
        if name not in self._file:
            shape = (self._scenario.cycles, *values.shape[1:])
            chunk = (min(self._size, shape[0]), *shape[1:])
            made = self._file.create_dataset(
                name, shape, dtype=float, chunks=chunk, fillvalue=np.nan, **CHECKED
            )
            made.attrs.update(about)
        self._file[name][self._written : self._written + len(values)] = values

    def _write_head(self, head: Head) -> None:
        """What does not change from cycle to cycle, and the digest; as Run.save() writes them."""
        assert self._first is not None
        file, arm = self._file, self._first.arrays()
        rows = {name: file[name] for name in self._first.rows()} | dict(
            file.require_group("diagnostics")
        )
        for dataset in rows.values():
            dataset.resize(self._written, axis=0)  # a path may end the run before its time
        for item in channels():
            if item.name in FIXED:
                dataset = file.create_dataset(item.name, data=arm[item.name], **CHECKED)
                dataset.attrs.update(item.metadata)
                rows[item.name] = dataset
        del rows["solve_time"]
        head.write(file, head.digest(rows, block=self._size))


def _runs(process: int) -> bool:
    """Whether there is a process of that number on this machine."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True  # somebody else's
    return True
