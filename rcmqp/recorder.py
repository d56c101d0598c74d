"""A run's file written while the run goes on, in the memory of one block, however long it is."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.controllers.base import SAFE_STOP, Controller
from rcmqp.derived import Derived
from rcmqp.dualquaternion import Array
from rcmqp.errors import OptionError, RunFileError
from rcmqp.head import CHECKED, Head, about
from rcmqp.run import channels, check_writable
from rcmqp.scenario import Scenario

if TYPE_CHECKING:
    import h5py

BLOCK = 4096
"""Rows that are kept in memory: some four seconds at 1 kHz, four megabytes."""


class Recorder:
    """What each cycle leaves, streamed to a file that Run.load() reads.

        with Recorder(path, scenario, controller, versions()) as recorder:
            for ... in cycles:
                recorder.append(answer.diagnostics, answer.stop, q=..., x=..., ...)

    There is a whole file when the block is left, or none, and an earlier one is kept until then:
    it is written beside it, and takes its name when every cycle of the scenario is there.
    Numbers and digest are those of the Run that simulate() makes of the same cycles. Beside the
    block, memory holds the number of each cycle in which the controller stopped safely.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        scenario: Scenario,
        controller: Controller,
        versions: Mapping[str, str],
        *,
        block: int = BLOCK,
    ) -> None:
        """Find out whether the file can be written; nothing is, yet.

        Args:
            path: of the file.
            scenario: what is run; it knows how many cycles come.
            controller: made for it.
            versions: of Python and packages, see simulate.versions().
            block: rows kept in memory.

        Raises:
            RunFileError: the file cannot be written.
        """
        self._path = Path(path).resolve()
        check_writable(self._path)
        self._part = self._path.with_name(f".{self._path.name}.{os.getpid()}.recording")
        self._scenario, self._controller, self._versions = scenario, controller, dict(versions)
        arm = controller.insertion.arm
        shapes: dict[str, tuple[int, ...]] = {
            **dict.fromkeys(("q", "q_measured"), (arm.nq,)),
            **dict.fromkeys(("angles", "v", "v_actual", "v_measured"), (arm.nv,)),
            **dict.fromkeys(("x", "x_d"), (8,)),
            "J": (6, arm.nv),
            "solve_time": (),
        }
        self._rows = {name: np.empty((block, *shape)) for name, shape in shapes.items()}
        self._diagnostics: dict[str, Array] = {}
        self._stops: dict[str, list[int]] = {}
        self._derived = Derived(scenario, controller.insertion)
        self._written = self._filled = 0
        self._size = block

    def __enter__(self) -> Self:
        """Open the file beside the one to be."""
        import h5py  # only files need it, and it takes long to import

        try:
            self._file: h5py.File = h5py.File(self._part, "w", rdcc_nbytes=0)
        except OSError as error:
            raise RunFileError(self._path, f"could not be written: {error}") from error
        self._file.create_group("diagnostics")
        return self

    def append(self, diagnostics: Mapping[str, float], stop: str = "", **row: ArrayLike) -> None:
        """Record a cycle.

        Args:
            diagnostics: of the controller's answer; a number that is not there every time is
                NaN where it is not.
            stop: why the controller stopped safely; empty where it did not.
            row: q, q_measured (nq,), angles, v, v_actual, v_measured (nv,), x, x_d (8,),
                J (6, nv), solve_time; see Run and ArmState.

        Raises:
            OptionError: a value is missing or unknown, or the scenario has no more cycles.
            RunFileError: the disk is full, or the like.
        """
        if row.keys() != self._rows.keys():
            wrong = sorted(row.keys() ^ self._rows.keys())
            raise OptionError(f"{wrong} missing or unknown; a row has {sorted(self._rows)}")
        if self._written + self._filled == self._scenario.cycles:
            raise OptionError(f"{self._scenario} has {self._scenario.cycles} cycles, not more")
        k = self._filled
        for name, values in row.items():
            self._rows[name][k] = values
        for name, value in diagnostics.items():
            if name not in self._diagnostics:
                self._diagnostics[name] = np.full(self._size, np.nan)
            self._diagnostics[name][k] = value
        if stop:
            self._stops.setdefault(stop, []).append(self._written + k)
        self._filled += 1
        if self._filled == self._size:
            self._flush()

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

    def _finish(self) -> None:
        """Write what is left, and give the file its name."""
        self._flush()
        if self._written != self._scenario.cycles:
            raise RunFileError(
                self._path,
                f"not written: {self._written} of {self._scenario.cycles} cycles recorded",
            )
        try:
            self._write_head()
            self._file.close()
            self._part.replace(self._path)
        except (OSError, RuntimeError) as error:
            raise RunFileError(self._path, f"could not be written: {error}") from error

    def _flush(self) -> None:
        """Write the rows in memory, and what follows from them."""
        n = self._filled
        if n == 0:
            return
        rows = {name: values[:n] for name, values in self._rows.items()}
        arrays = {**rows, **self._derived.of(rows)}
        meanings = {item.name: item.metadata for item in channels()}
        numbers = {**SAFE_STOP, **self._controller.diagnostics}
        try:
            for name in arrays.keys() & meanings.keys():
                self._put(name, arrays[name], meanings[name])
            for name, values in self._diagnostics.items():
                self._put(f"diagnostics/{name}", values[:n], about(name, numbers))
                values[:] = np.nan
        except (OSError, RuntimeError) as error:  # h5py raises either
            raise RunFileError(self._path, f"could not be written: {error}") from error
        self._written, self._filled = self._written + n, 0

    def _put(self, name: str, values: Array, about: Mapping[str, Any]) -> None:
        if name not in self._file:
            shape = (self._scenario.cycles, *values.shape[1:])
            chunk = (min(self._size, shape[0]), *shape[1:])
            made = self._file.create_dataset(
                name, shape, dtype=float, chunks=chunk, fillvalue=np.nan, **CHECKED
            )
            made.attrs.update(about)
        self._file[name][self._written : self._written + len(values)] = values

    def _write_head(self) -> None:
        """What does not change from cycle to cycle, and the digest; as Run.save() writes them."""
        file, controller, scenario = self._file, self._controller, self._scenario
        arm = controller.insertion.arm
        fixed = {
            "lower": arm.lower,
            "upper": arm.upper,
            "velocity_limit": arm.velocity,
            "acceleration_limit": arm.acceleration,
        }
        for item in channels():
            if item.name in fixed:
                dataset = file.create_dataset(item.name, data=fixed[item.name], **CHECKED)
                dataset.attrs.update(item.metadata)
        head = Head(
            scenario,
            controller.name,
            controller.options,
            self._versions,
            arm.joints,
            arm.sha256,
            self._stops,
        )
        arrays = {item.name: file[item.name] for item in channels()} | dict(file["diagnostics"])
        del arrays["solve_time"]
        head.write(file, head.digest(arrays, block=self._size))
