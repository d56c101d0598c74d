"""A run's file written cycle by cycle, in the memory of one block, however long the run is."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.errors import OptionError
from rcmqp.runs.channels import PART
from rcmqp.runs.cycles import ROW, Cycles, Described
from rcmqp.runs.head import check_replaceable
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.writer import writing


class Recorder:
    """Streams the rows of cycles to a file that Run.load() reads.

        with Recorder(path, scenario, controller, versions()) as recorder:
            for ... in cycles:
                recorder.append(answer.diagnostics, answer.stop, q=..., x=..., ...)

    The file is whole when the block is left without an error, and is not written otherwise; see
    writing(). Numbers and digest are those of the Run that simulate() makes of the same cycles.

    Attributes:
        scenario: what the file says of the scenario; it may be set to another one before the end,
            if that is when it is known.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        scenario: Scenario,
        controller: Described,
        versions: Mapping[str, str],
        *,
        block: int = PART,
    ) -> None:
        """Check that the file can be written; nothing is written yet.

        Args:
            path: of the file.
            scenario: what is run; it knows how many cycles may come.
            controller: made for it.
            versions: of Python and packages, see simulate.versions().
            block: rows kept in memory.

        Raises:
            RunFileError: the file cannot be written.
        """
        check_replaceable(path)
        self.scenario = scenario
        self._cycles = Cycles(scenario, controller, versions, block)
        self._opening = writing(path, block)

    def __enter__(self) -> Self:
        """Open the part file.

        Raises:
            RunFileError: it cannot be opened.
        """
        self._writer = self._opening.__enter__()
        return self

    def append(
        self,
        diagnostics: Mapping[str, float],
        stop: str = "",
        *,
        solve_time: float,
        path_time: float | None = None,
        time: float | None = None,
        pivot: ArrayLike | None = None,
        **row: ArrayLike,
    ) -> None:
        """Record a cycle.

        Args:
            diagnostics: of the controller's answer; a number that is not there every time is
                NaN where it is not.
            stop: why the controller stopped safely; empty where it did not.
            solve_time: how long the controller took [s].
            path_time: on the path's own clock [s], see PathClock; the time, if not given.
            time: when the cycle was [s]; one period after the last, if not given.
            pivot: (3,) trocar in the world [m]; where the scenario has it, if not given.
            row: q, q_measured (nq,), angles, v, v_actual, v_measured (nv,), x, x_d (8,),
                J (6, nv); see Channels and ArmState.

        Raises:
            OptionError: a value is missing, unknown or of another shape, or the scenario has no
                more cycles.
            OSError: the disk is full, or the like; it is a RunFileError outside the block.
        """
        if wrong := sorted(row.keys() ^ set(ROW)):
            raise OptionError(f"{wrong} missing or unknown; a row has {sorted(ROW)}")
        arrays = [np.ascontiguousarray(row[name], dtype=float) for name in ROW]
        for array, (name, shape) in zip(arrays, self._cycles.shapes.items(), strict=True):
            if array.shape != shape:
                raise OptionError(f"{name} has shape {array.shape}, it must be {shape}")
        self._cycles.add(
            solve_time, diagnostics, stop, *arrays, path_time=path_time, time=time, pivot=pivot
        )
        if len(self._cycles) == self._cycles.size:
            self._flush()

    def write(self, part: Run) -> None:
        """Record some cycles of a run, the next ones.

        Raises:
            OptionError: the scenario has no more cycles.
            OSError: as append().
        """
        self._flush()
        self._writer.write(part)
        self._cycles.follow(part)

    def _flush(self) -> None:
        """Write the rows of append() that are in memory."""
        if len(self._cycles):
            self._writer.write(self._cycles.part())

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Write the rest and rename the part file; after an error, leave nothing."""
        if error is None:
            try:
                self._flush()
                self._writer.scenario = self.scenario
            except BaseException as failure:
                self._opening.__exit__(type(failure), failure, failure.__traceback__)
                raise
        self._opening.__exit__(kind, error, traceback)
