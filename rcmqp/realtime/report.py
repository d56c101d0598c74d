"""What a real-time loop did: how punctual it was, and how it ended."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rcmqp.realtime.latency import Latency
from rcmqp.show.table import Table

BOUNDS = (50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 2e-3, 5e-3, 10e-3)
"""Of the rows of the printed histogram [s]."""


@dataclass(frozen=True)
class Stop:
    """How a loop came to its safe stop.

    Attributes:
        at: when, from the start [s].
        fault: why; empty where the duration was over.
        error: what was raised, for who wants its traceback; None where nothing was.
        signal: number of the signal that came during the loop or its stop; 0 for none.
    """

    at: float
    fault: str
    error: BaseException | None = None
    signal: int = 0


@dataclass(frozen=True)
class LoopReport:
    """What run_realtime() did.

    Attributes:
        controller: its name.
        period: of the loop [s].
        cycles: run, with those of the safe stop.
        braking: those of the safe stop: slowing down, and holding zero.
        missed: cycles whose command left when the next was due, or later.
        skipped: cycles not run, for they were over before they could begin.
        controller_stops: cycles that the controller itself answered with its safe stop.
        unsent: commands of the safe stop that the robot did not take.
        wake: from when a cycle was due to when it began.
        answer: from when a cycle was due to when its command was sent.
        stop: how it ended.
        halted: the watch-dog called the robot's halt(), and that returned.
        recorded: what was kept of the run; empty where nothing was to be.
        waited: how long the loop's thread could have run and waited for a processor [s]; NaN
            where the system does not count it.
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

    def rows(self) -> list[tuple[str, str]]:
        """What was counted, and how much of it."""
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
        found = []
        for k, label in enumerate(labels):
            counts = [column[k] - (column[k - 1] if k else 0) for column in columns]
            found.append((label, str(counts[0]), str(counts[1])))
        rest = [str(delays.above(BOUNDS[-1])) for delays in (self.wake, self.answer)]
        return [*found, (f"above {_time(BOUNDS[-1])}", rest[0], rest[1])]

    def tables(self) -> list[Table]:
        """What was counted, and the histogram."""
        return [
            Table(("real-time loop", ""), self.rows()),
            Table(("delay", "began", "answered"), self.histogram()),
        ]

    def as_markdown(self) -> str:
        """Both tables."""
        return "\n".join(table.markdown() for table in self.tables()).rstrip()

    def __rich__(self) -> Table:
        """For rich's print()."""
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
