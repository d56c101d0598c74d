"""The results of a real-time loop: its cycles for a recorder, and its report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from typing import NamedTuple, Protocol

import numpy as np

from rcmqp.controllers.base import Command
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.latency import Deadlines, Latency
from rcmqp.references.view import Stamped
from rcmqp.show.table import Table
from rcmqp.world.arm import Arm


class CycleRecorder(Protocol):
    """Keeps a loop's cycles; rcmqp.runs.loop_record has one that writes a run's file."""

    def start(self) -> None:
        """Get ready, before anything moves; an error that this raises is the caller's."""
        ...

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
        """Take a cycle whose command was sent; return at once and raise nothing.

        Args:
            due: when the cycle was due, from the start of the loop [s].
            began: when it began [s]; NaN in the safe stop.
            sent: when its command had been sent [s].
            reading: q (nq,) and v (nv,) [rad/s] as read; NaN where nothing could be read.
            asked: the last pose asked for, x_d (8,), as the reference has it; the trocar (3,)
                [m]; the time of the reference [s].
            v: (nv,) the velocity sent [rad/s].
            diagnostics: of the controller's answer.
            stop: why the joints braked instead of following; empty where they did not.
            solve_time: how long the controller took [s]; NaN if it was not asked.
        """
        ...

    def close(self, fault: str) -> str:
        """Finish, once the arm is at rest; return what was kept, in words for the report.

        Args:
            fault: why the loop ended before its time; empty where it did not.
        """
        ...


class Asked(NamedTuple):
    """The reference of a cycle, and the controller's answer.

    Attributes:
        newest: the reference.
        pivot: (3,) the trocar, where it was last seen [m].
        answer: of the controller.
        solve_time: how long that took [s].
    """

    newest: Stamped
    pivot: Array
    answer: Command
    solve_time: float


class Notes:
    """Holds what a loop's cycle read and asked until its command is sent, then gives it away.

    Attributes:
        asked: by the last cycle; None before the first.
        reading: q (nq,) and v (nv,) of a cycle of the safe stop; None if it could not read.
    """

    def __init__(self, record: CycleRecorder | None, arm: Arm) -> None:
        """Give the cycles to ``record``, if there is one."""
        self.asked: Asked | None = None
        self.reading: tuple[Array, Array] | None = None
        self._record = record
        self._nothing = np.full(arm.nq, nan), np.full(arm.nv, nan)

    def start(self) -> None:
        """Start the recorder, which may raise."""
        if self._record is not None:
            self._record.start()

    def sent(
        self, due: float, began: float, sent: float, reading: tuple[Array, Array], v: Array
    ) -> None:
        """Record that the loop sent ``v`` (nv,); times in [s]."""
        if self._record is not None and self.asked is not None:
            newest, pivot, answer, solve_time = self.asked
            asked = newest.reference.x_d, pivot, newest.at
            self._record.add(
                due, began, sent, reading, asked, v, answer.diagnostics, answer.stop, solve_time
            )

    def braked(self, due: float, timing: Deadlines, v: Array, fault: str) -> None:
        """Record that the safe stop sent ``v`` (nv,)."""
        if self._record is not None and self.asked is not None:
            newest, pivot = self.asked[:2]
            asked, reading = (newest.reference.x_d, pivot, newest.at), self.reading
            why = f": {fault}" if fault else ", as it ends every run"
            self._record.add(
                due,
                nan,
                timing.now(),
                reading or self._nothing,
                asked,
                v,
                {"safe_stop": 1.0},
                f"the real-time loop brought the arm to rest{why}",
                nan,
            )

    def close(self, fault: str) -> str:
        """Close the recorder; return in words what it kept, empty without a recorder."""
        record, self._record = self._record, None
        return "" if record is None else record.close(fault)


BOUNDS = (50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 2e-3, 5e-3, 10e-3)
"""Of the rows of the printed histogram [s]."""


@dataclass(frozen=True)
class Stop:
    """How a loop came to its safe stop.

    Attributes:
        at: when, from the start [s].
        fault: why; empty where the duration was over.
        error: the exception, with its traceback; None if nothing was raised.
        signal: number of the signal that came during the loop or its stop; 0 for none.
    """

    at: float
    fault: str
    error: BaseException | None = None
    signal: int = 0


@dataclass(frozen=True)
class LoopReport:
    """The report of run_realtime().

    Attributes:
        controller: its name.
        period: of the loop [s].
        cycles: run, with those of the safe stop.
        braking: those of the safe stop: slowing down, and holding zero.
        missed: cycles whose command left when the next was due, or later.
        skipped: cycles that were due and not run.
        controller_stops: cycles that the controller itself answered with its safe stop.
        unsent: commands of the safe stop that the robot did not take.
        wake: from when a cycle was due to when it began.
        answer: from when a cycle was due to when its command was sent.
        stop: how it ended.
        halted: the watch-dog called the robot's halt(), and that returned.
        recorded: what was kept of the run; empty where nothing was to be.
        waited: how long the loop's thread could have run and waited for a processor [s]; NaN
            where the system does not count it.
        off_trocar: how far the shaft was off the trocar when the loop started [m].
        priority: of the loop's process, in words; empty where the caller has set it.
    """

    controller: str
    period: float
    cycles: int
    braking: int
    missed: int
    skipped: int
    controller_stops: int
    unsent: int
    wake: Latency
    answer: Latency
    stop: Stop
    halted: bool = False
    waited: float = math.nan
    recorded: str = ""
    off_trocar: float = math.nan
    priority: str = ""

    @property
    def skipped_share(self) -> float:
        """The share of the cycles due that was skipped."""
        due = self.cycles + self.skipped
        return self.skipped / due if due else 0.0

    def rows(self) -> list[tuple[str, str]]:
        """Names and counts, one row each."""
        due = self.cycles + self.skipped
        return [
            ("controller", self.controller),
            ("period", f"{1e3 * self.period:g} ms"),
            ("cycles due", f"{due}"),
            ("cycles run", f"{self.cycles}"),
            ("deadlines missed", _share(self.missed, due)),
            ("cycles skipped", _share(self.skipped, due)),
            *_latency("began late by", self.wake),
            *_latency("answered after", self.answer),
            ("waited for a processor", _waited(self.waited)),
            *([("priority", self.priority)] if self.priority else []),
            ("shaft off the trocar at the start", f"{1e3 * self.off_trocar:.3g} mm"),
            ("controller's own stops", f"{self.controller_stops}"),
            ("commands not taken", f"{self.unsent}"),
            ("ended", f"at {self.stop.at:.3f} s, {self.stop.fault or 'as asked'}"),
            ("safe stop", self._safe_stop()),
            *([("recorded", self.recorded)] if self.recorded else []),
        ]

    def _safe_stop(self) -> str:
        if self.halted:
            return f"the robot's halt(), after {self.braking} cycles of braking"
        return f"brake, {self.braking} cycles until zero was held"

    def histogram(self) -> list[tuple[str, str, str]]:
        """Delays between bounds: how many cycles began, and how many answered, so late."""
        marks = [0.0, *BOUNDS]
        labels = [
            f"{_time(low)} to {_time(high)}" for low, high in zip(marks, BOUNDS, strict=False)
        ]
        columns = [
            [delays.total - delays.above(bound) for bound in BOUNDS]
            for delays in (self.wake, self.answer)
        ]
        rows = []
        for k, label in enumerate(labels):
            counts = [column[k] - (column[k - 1] if k else 0) for column in columns]
            rows.append((label, str(counts[0]), str(counts[1])))
        rest = [str(delays.above(BOUNDS[-1])) for delays in (self.wake, self.answer)]
        return [*rows, (f"above {_time(BOUNDS[-1])}", rest[0], rest[1])]

    def tables(self) -> list[Table]:
        """The table of counts, and the histogram."""
        return [
            Table(("real-time loop", ""), self.rows()),
            Table(("delay", "began", "answered"), self.histogram()),
        ]

    def as_markdown(self) -> str:
        """Both tables."""
        return "\n".join(table.markdown() for table in self.tables()).rstrip()

    def __rich__(self) -> Table:
        """The first table, for rich's print()."""
        return self.tables()[0]


def _latency(what: str, delays: Latency) -> list[tuple[str, str]]:
    quantiles = ", ".join(
        f"{name} {_time(delays.quantile(share))}"
        for name, share in (("median", 0.5), ("p99", 0.99), ("p99.9", 0.999))
    )
    return [
        (what, quantiles),
        ("  at worst", f"{_time(delays.worst)}, at {delays.worst_at:.3f} s"),
    ]


def _share(count: int, total: int) -> str:
    return f"{count} ({100 * count / max(total, 1):.4f} %)"


def _waited(duration: float) -> str:
    return "not counted by this system" if math.isnan(duration) else f"{_time(duration)} in all"


def _time(delay: float) -> str:
    return f"{1e6 * delay:.0f} us" if delay < 1e-3 else f"{1e3 * delay:.3g} ms"
