"""Absolute deadlines: when each cycle is due, and what became of it."""

from __future__ import annotations

import math
from collections.abc import Callable

from rcmqp.realtime.latency import LatencyCounter


class Deadlines:
    """Cycle k is due at k periods after the start, whatever the cycles before it took.

    Attributes:
        period: [s].
        wake: from when a cycle was due to when it began.
        answer: from when a cycle was due to when its command was sent.
        cycles: that were run.
        missed: cycles whose command left when the next was due, or later.
        skipped: cycles that were over before they could begin.
        due: when the next cycle is due, from the start [s].
        slip: by how much more than a period after the last cycle an executor began this one
            [s]; 0 where the cycle's time is the clock's.
    """

    slip = 0.0

    def __init__(
        self,
        period: float,
        spin: float,
        clock: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        """Sleep but for the last ``spin`` [s] of each wait, which is spun."""
        self.period = period
        self.wake, self.answer = LatencyCounter(), LatencyCounter()
        self.cycles = self.missed = self.skipped = 0
        self._spin, self._clock, self._sleep = spin, clock, sleep
        self._next, self._begun = 0, -1
        self.begin()

    def begin(self) -> None:
        """Start a period from now."""
        self._start = self._clock() + self.period
        self.due = 0.0

    def now(self) -> float:
        """Time from the start [s]."""
        return self._clock() - self._start

    def wait(self) -> None:
        """Return when the next cycle is due; at once if it was already, or has begun."""
        due = self._start + self.due
        rest = due - self._clock() - self._spin
        if rest > 0.0:
            self._sleep(rest)
        while (woke := self._clock()) < due:
            pass
        if self._begun != self._next:
            self.wake.add(woke - due, woke - self._start)
            self._begun = self._next

    def sent(self) -> None:
        """The command of this cycle has left: count how late, and find the next cycle to run."""
        now = self.now()
        self.answer.add(now - self.due, now)
        self.cycles += 1
        self._next += 1
        if now >= self._next * self.period:
            self.missed += 1
            over = max(0, math.floor(now / self.period) - self._next)
            self.skipped += over
            self._next += over
        self.due = self._next * self.period


class Ticks(Deadlines):
    """Cycles that are due when an executor of one's own begins them.

    ``wake`` is then by how much more than a period after the last cycle each one began, and
    ``skipped`` how many whole periods went by without one.
    """

    def begin(self) -> None:
        """The clock starts with the first cycle."""
        self._start, self.due = self._clock(), 0.0

    def early(self) -> bool:
        """Whether less than half a period has gone by since the last cycle was due."""
        return self._next > 0 and self.now() < self.due - 0.5 * self.period

    def wait(self) -> None:
        """This cycle is due now, unless it has begun."""
        if self._begun == self._next:
            return
        if self._next == 0:
            self.begin()
        now = self.now()
        self.slip = max(0.0, now - self.due) if self._next else 0.0
        self.wake.add(self.slip, now)
        self.skipped += math.floor(self.slip / self.period)
        self.due, self._begun = now, self._next

    def sent(self) -> None:
        """The command of this cycle has left: count how late; the next is due a period on."""
        now = self.now()
        self.answer.add(now - self.due, now)
        self.cycles += 1
        self._next += 1
        self.missed += now - self.due >= self.period
        self.due += self.period
