"""The process that writes the file of a real-time loop; LoopRecorder starts it.

It reads a header, a line of JSON, and then rows (RowFormat) from stdin; it writes a
line of JSON to stdout when it is ready, and another one when the file is whole or cannot be.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import sys
from collections.abc import Mapping
from math import isnan
from typing import IO, Any, NamedTuple

import numpy as np

from rcmqp.controllers.given import Given
from rcmqp.errors import RunFileError
from rcmqp.references.paths import Foreign
from rcmqp.runs.loop_record import PATH, LoopRow, RowFormat
from rcmqp.runs.recorder import Recorder
from rcmqp.runs.scenario import Scenario
from rcmqp.world.insertion import Insertion

BLOCK = 1024
"""Rows that are written at once."""

KILLED = "the process of the real-time loop was killed; the run ends here"
"""Stands at the last row where the end of the rows was not told."""


class Known(NamedTuple):
    """The controller as the loop's process describes it."""

    name: str
    options: Mapping[str, Any]
    given: Given
    diagnostics: Mapping[str, tuple[str, str]]
    insertion: Insertion


def write(stream: IO[bytes]) -> int:
    """Write the file of the rows on the stream; return how many there were.

    Raises:
        RcmqpError: the file cannot be written, or the arm cannot be loaded here.
    """
    header = json.loads(stream.readline())
    scenario = Scenario.from_json(header["scenario"])
    insertion, about = scenario.insertion(), header["diagnostics"]
    if insertion.arm.sha256 != header["urdf_sha256"]:
        raise RunFileError(header["path"], f"the URDF of {scenario.arm} has changed meanwhile")
    known = Known(
        header["name"],
        header["options"],
        Given.from_json(header["given"]),
        {name: (unit, meaning) for name, (unit, meaning) in about.items()},
        insertion,
    )
    rows = RowFormat(insertion.arm.nq, insertion.arm.nv, list(about))
    recorder = Recorder(header["path"], scenario, known, header["versions"], block=BLOCK)
    with recorder:
        say(ready=True)
        return Keeper(recorder, insertion).keep(stream, rows)


class Keeper:
    """Appends the rows of a loop to its run."""

    def __init__(self, recorder: Recorder, insertion: Insertion) -> None:
        self._recorder, self._insertion = recorder, insertion
        self._q = insertion.q_start
        self._count, self._time, self._followed = 0, -1.0, 0.0

    def keep(self, stream: IO[bytes], rows: RowFormat) -> int:
        """Append all rows; mark the last one if the loop did not come to rest by itself."""
        waiting, reason = None, KILLED
        while (row := rows.read(stream)) is not None:
            if isnan(row.time):
                reason = row.stop
                break
            if row.time <= self._time:  # a clock that stands still
                continue
            if waiting is not None:
                self._append(waiting)
            waiting, self._time = row, row.time
        if waiting is not None:
            self._append(waiting._replace(stop=waiting.stop or reason))
        self._say_how_long()
        return self._count

    def _append(self, row: LoopRow) -> None:
        if np.isfinite(row.q).all():
            self._q = row.q
        if not row.stop:
            self._followed = row.time
        state = self._insertion.state(self._q)
        self._recorder.append(
            {name: value for name, value in row.diagnostics.items() if not isnan(value)},
            row.stop,
            solve_time=row.solve_time,
            time=row.time,
            pivot=row.pivot,
            q=self._q,
            q_measured=row.q,
            angles=state.angles,
            v=row.v,
            v_actual=row.v_measured,
            v_measured=row.v_measured,
            x=state.x,
            x_d=row.x_d,
            J=state.J_local,
        )
        self._count += 1

    def _say_how_long(self) -> None:
        """Set in the scenario how long the loop followed its references, and how long it ran."""
        scenario = self._recorder.scenario
        duration, path = max(self._time, scenario.period * max(1, self._count - 1)), scenario.path
        if isinstance(path, Foreign):
            path = Foreign(PATH, {"duration": self._followed})
        self._recorder.scenario = dataclasses.replace(scenario, path=path, duration=duration)


def say(**words: Any) -> None:
    """Send a line of JSON to the loop's process."""
    with contextlib.suppress(OSError):  # it may be gone
        print(json.dumps(words), flush=True)


def main() -> None:
    """Write the file of the rows on stdin."""
    try:
        count = write(sys.stdin.buffer)
    except Exception as error:  # noqa: BLE001  (the loop's process tells of it)
        reason = error.reason if isinstance(error, RunFileError) else str(error)
        say(error=reason or type(error).__name__)
    else:
        say(rows=count)


if __name__ == "__main__":
    main()
