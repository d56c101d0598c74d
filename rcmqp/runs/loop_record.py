"""Recording of a real-time loop: its cycles go to another process, which writes the file."""

from __future__ import annotations

import itertools
import json
import os
import struct
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from math import nan
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from rcmqp.controllers.base import SAFE_STOP, Controller
from rcmqp.errors import OptionError, RunFileError
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths import Foreign
from rcmqp.references.paths import Path as ViewPath
from rcmqp.runs.head import check_replaceable
from rcmqp.runs.scenario import MOST_CYCLES, Scenario
from rcmqp.runs.simulate import versions

PATH = "realtime"
"""Kind of the path of a run that a loop was asked for: only its poses are known."""

BACKLOG = 1 << 14
"""Cycles that may wait to be written: 16 s at 1 kHz, about 10 MB."""

PAUSE = 0.01
"""How often the waiting cycles are handed over [s]."""

TIMES = {
    "began_late": ("s", "(n,) from when the cycle was due to when it began"),
    "sent_after": ("s", "(n,) from when the cycle was due to when its command had been sent"),
    "reference_age": ("s", "(n,) age of the newest reference when the cycle began"),
}
"""Diagnostics that the loop adds to the controller's own."""


class LoopRow(NamedTuple):
    """One cycle, as the loop left it.

    Attributes:
        time: when it was due, from the start of the loop [s]; NaN says that the loop has ended.
        solve_time: of the controller [s]; NaN in the loop's safe stop.
        diagnostics: by the names that both ends know; NaN if the step gave none.
        q, v_measured: (nq,), (nv,) as read; NaN where nothing could be read.
        x_d: (8,) the pose asked for.
        pivot: (3,) the trocar [m].
        v: (nv,) the velocity that was sent.
        stop: why the joints braked instead of following; empty where they did not.
    """

    time: float
    solve_time: float
    diagnostics: Mapping[str, float]
    q: Array
    v_measured: Array
    x_d: Array
    pivot: Array
    v: Array
    stop: str


class RowFormat:
    """How a LoopRow is written as bytes."""

    def __init__(self, nq: int, nv: int, names: Sequence[str]) -> None:
        """``names`` are those of the diagnostics."""
        self.names = tuple(names)
        self._head = struct.Struct(f"<Q{2 + len(self.names)}d")
        self.sizes = (nq, nv, 8, 3, nv)
        ends = list(itertools.accumulate(self.sizes))
        self._parts = [slice(end - size, end) for end, size in zip(ends, self.sizes, strict=True)]

    def pack(self, row: LoopRow) -> bytes:
        """The bytes of a row."""
        text, numbers = row.stop.encode(), row.diagnostics.get
        head = self._head.pack(
            len(text), row.time, row.solve_time, *[numbers(name, nan) for name in self.names]
        )
        return b"".join([head, *[array.tobytes() for array in row[3:8]], text])

    def read(self, stream: IO[bytes]) -> LoopRow | None:
        """The next row; None at the end of the stream, or if the last row is cut off."""
        size = self._head.size + 8 * sum(self.sizes)
        if len(data := stream.read(size)) < size:
            return None
        length, time, solve_time, *values = self._head.unpack_from(data)
        numbers = np.frombuffer(data, offset=self._head.size)
        arrays = [numbers[part] for part in self._parts]
        if len(text := stream.read(length)) < length:
            return None
        diagnostics = dict(zip(self.names, values, strict=True))
        return LoopRow._make((time, solve_time, diagnostics, *arrays, text.decode()))


def _step_down() -> None:
    """Leave a real-time priority in this thread, and so in what it starts from now on."""
    real_time = {getattr(os, name, None) for name in ("SCHED_FIFO", "SCHED_RR")} - {None}
    if real_time and os.sched_getscheduler(0) in real_time:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class LoopRecorder:
    """Keeps a run of run_realtime() or RealtimeLoop in a file, beside the loop.

        record = LoopRecorder("run.h5", controller)
        report = run_realtime(robot, controller, references, duration, record=record)

    The file is a run like any other: ``rcmqp show``, ``view`` and ``report`` take it. Each cycle
    whose command was sent has a row: when it was due, q and v as read, the pose asked for, the
    trocar, the velocity sent, the controller's diagnostics, and those of TIMES. Where the truth
    is not known, the reading stands for it: ``q`` is ``q_measured``, ``v_actual`` is
    ``v_measured``. Cycles that were skipped have no row, and rates in the metrics count one
    period from a row to the next. The rows of the loop's safe stop are safe stops in the file,
    with the reason; what was asked last stays the pose asked for there.

    The loop only packs a row, after its command has left, which takes some 15 us. A thread hands
    the rows to a process of ordinary priority, which writes the file. A disk that is slow or full
    never holds up the loop. If more than BACKLOG cycles wait for the disk, recording ends there,
    and what came before is kept; if the disk is full, nothing is kept. close() says so, and so
    does the loop's report.

    The file has its name once it is whole, after the loop. If the loop's process is killed, even
    by SIGKILL, the other one ends the file with the cycles that it was given, up to 10 ms before,
    and marks the last row. If that process is killed too, its part file is left, as by simulate().

    Attributes:
        whole: whether the file has every cycle; False until close() has returned.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        controller: Controller,
        name: str = PATH,
        *,
        follows: ViewPath | None = None,
    ) -> None:
        """Prepare a record; check that the file can be written, but write nothing yet.

        Args:
            path: of the file; a run's file that is there is replaced at the end.
            controller: that the loop runs.
            name: what to call the scenario.
            follows: the path that the loop follows, for its targets and spheres; without it the
                record has only the poses that were asked for.

        Raises:
            RunFileError: the file cannot be written.
            OptionError: the insertion is not one that a scenario can name.
        """
        check_replaceable(path)
        self._path, insertion, period = Path(path), controller.insertion, controller.period
        scenario = Scenario.of(
            name,
            insertion,
            follows or Foreign(PATH, {"duration": period}),
            duration=period * (MOST_CYCLES - 1),
            period=period,
            obstacles=insertion.obstacles,
        )
        about = {**SAFE_STOP, **TIMES, **controller.diagnostics}
        self._header: dict[str, Any] = {
            "path": str(self._path.resolve()),
            "scenario": scenario.to_json(carry=True),
            "urdf_sha256": insertion.arm.sha256,
            "name": controller.name,
            "options": dict(controller.options),
            "given": controller.given.to_json(),
            "diagnostics": about,
            "versions": versions(),
        }
        self._packing = RowFormat(insertion.arm.nq, insertion.arm.nv, list(about))
        self._rows: deque[bytes] = deque()
        self._taken, self._fault, self.whole = 0, "", False
        self._closing = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._hand_over, name="rcmqp record", daemon=True)

    def start(self) -> None:
        """Start the process that writes, and wait until it can.

        Raises:
            OptionError: the recorder was started before, or a file cannot hold an option of the
                controller.
            RunFileError: the process cannot write.
        """
        if self._process is not None:
            raise OptionError(f"{self._path}: a LoopRecorder records one loop; make another one")
        header = self._header_line()
        pipe = subprocess.PIPE
        with ThreadPoolExecutor(1, initializer=_step_down) as starter:
            self._process = starter.submit(
                subprocess.Popen[bytes],
                [sys.executable, "-m", "rcmqp.runs.loop_writer"],
                stdin=pipe,
                stdout=pipe,
                bufsize=0,
                process_group=0,  # Ctrl-C is not for it
            ).result()
        self._write(header)
        if error := self._answer().get("error"):
            self._end()
            raise RunFileError(self._path, f"cannot be recorded: {error}")
        self._thread.start()

    def add(
        self,
        due: float,
        began: float,
        sent: float,
        reading: tuple[Array, Array],
        asked: tuple[object, Array, float],
        v: Array,
        diagnostics: Mapping[str, float],
        stop: str,
        solve_time: float,
    ) -> None:
        """Take a cycle; see CycleRecorder.add() for the arguments. It never raises."""
        if self._fault:
            return
        try:
            x_d, pivot, stamp = asked
            times = {"began_late": began - due, "sent_after": sent - due}
            numbers = {**diagnostics, **times, "reference_age": began - stamp}
            pose = np.asarray(x_d, dtype=float)
            if pose.shape != (8,):
                pose = np.full(8, nan)
            row = LoopRow(due, solve_time, numbers, *reading, pose, pivot, v, stop)
            self._rows.append(self._packing.pack(row))
            self._taken += 1
        except Exception as error:  # noqa: BLE001  (the arm comes first)
            self._fault = f"{type(error).__name__}: {error}"
        if len(self._rows) >= BACKLOG:
            self._fault = f"the disk is too slow, {BACKLOG} cycles waited to be written"
        elif self._taken >= MOST_CYCLES:
            self._fault = f"a run has {MOST_CYCLES} cycles at most"

    def close(self, fault: str) -> str:
        """Wait until the file is complete; say in words what it holds.

        Args:
            fault: why the loop ended before its time; empty where it did not.
        """
        if self._process is None:
            return ""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
        nothing = [np.full(size, nan) for size in self._packing.sizes]
        why = fault or (self._fault and f"recorded until here only: {self._fault}")
        end = LoopRow._make((nan, nan, {}, *nothing, why))
        self._write(self._packing.pack(end))
        answer = self._answer()
        self._end()
        self.whole = "rows" in answer and not self._fault
        if "rows" in answer:
            kept = f"{answer['rows']} cycles in {self._path}"
            return f"{kept}; it ends early: {self._fault}" if self._fault else kept
        return f"nothing: {answer['error']}"

    def _header_line(self) -> bytes:
        """The header as JSON; an OptionError names the controller's option that JSON refuses."""
        for name, value in self._header["options"].items():
            try:
                json.dumps(value)
            except (TypeError, ValueError) as error:
                kind = type(value).__name__
                raise OptionError(
                    f"{name} = {value!r:.50}, of type {kind}, cannot be kept in a run's file; "
                    f"give {self._header['name']} numbers, texts or lists of Python"
                ) from error
        return json.dumps(self._header).encode() + b"\n"

    def _hand_over(self) -> None:
        """Give the rows that wait to the process that writes, until the loop has ended."""
        while not self._closing.wait(PAUSE):
            self._flush()
        self._flush()

    def _flush(self) -> None:
        self._write(b"".join([self._rows.popleft() for _ in range(len(self._rows))]))

    def _write(self, data: bytes) -> None:
        """Write to the other process; without it, nothing more is taken."""
        assert self._process is not None
        assert self._process.stdin is not None
        left = memoryview(data)
        try:
            while left:
                left = left[self._process.stdin.write(left) :]
        except OSError:
            self._fault = self._fault or "the process that writes the file has ended"

    def _answer(self) -> dict[str, Any]:
        """The next line of the other process."""
        assert self._process is not None
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        found: dict[str, Any] = json.loads(line) if line else {}
        return found or {"error": "the process that writes the file was killed"}

    def _end(self) -> None:
        """Wait for the other process to end."""
        assert self._process is not None
        with self._process:
            pass
