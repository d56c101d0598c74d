"""When each cycle is due, and how late it was, counted in bins: the same memory for a day."""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_R20 = "1 1.12 1.25 1.4 1.6 1.8 2 2.24 2.5 2.8 3.15 3.55 4 4.5 5 5.6 6.3 7.1 8 9".split()
"""Renard's series of twenty numbers a decade (ISO 3)."""

EDGES = tuple(float(f"{number}e{power}") for power in range(-6, 1) for number in _R20)
"""Upper edges of the bins [s], from 1 us to 9 s; below the first and beyond the last is a bin
more. Neighbours differ by 13 % at most, and a quantile is known to that."""

RECENT = 3.0
"""Window of Pace [s]."""


@dataclass(frozen=True)
class Latency:
    """Delays, as a histogram.

    Attributes:
        counts: of each bin of EDGES, and of what is beyond the last.
        worst: the largest delay [s].
        worst_at: when it was, from the start of the loop [s].
    """

    counts: tuple[int, ...]
    worst: float
    worst_at: float

    @property
    def total(self) -> int:
        """Number of delays."""
        return sum(self.counts)

    def quantile(self, share: float) -> float:
        """A delay [s] that ``share`` of all do not exceed, to the width of a bin; 0 for none."""
        if not self.total:
            return 0.0
        counts = np.cumsum(self.counts)
        k = int(np.searchsorted(counts, max(share * self.total, 1)))
        return min((*EDGES, math.inf)[k], self.worst)

    def above(self, delay: float) -> int:
        """How many exceeded ``delay`` [s], one of EDGES."""
        return sum(self.counts[EDGES.index(delay) + 1 :])


class LatencyCounter:
    """Fills a Latency; nothing grows while it does."""

    def __init__(self) -> None:
        self._counts = [0] * (len(EDGES) + 1)
        self._worst = self._worst_at = 0.0

    def add(self, delay: float, at: float) -> None:
        """Count a delay [s] that was seen at ``at`` [s]."""
        self._counts[bisect.bisect_left(EDGES, delay)] += 1
        if delay > self._worst:
            self._worst, self._worst_at = delay, at

    def latency(self) -> Latency:
        """The delays counted so far."""
        return Latency(tuple(self._counts), self._worst, self._worst_at)


class Pace:
    """The share of the cycles of the last RECENT seconds that was skipped."""

    def __init__(self, period: float) -> None:
        """Nothing has been run yet."""
        self._period, self._marks = period, deque[tuple[float, int]]()

    def skipped(self, t: float, cycles: int) -> float:
        """The share that is missing at ``t`` [s], of those due since RECENT; 0 at the start.

        Args:
            t: by the clock, not before the last one.
            cycles: that were run until then.
        """
        self._marks.append((t, cycles))
        while len(self._marks) > 1 and self._marks[1][0] <= t - RECENT:
            self._marks.popleft()
        began, before = self._marks[0]
        if t - began < 0.5 * RECENT:
            return 0.0
        return max(0.0, 1.0 - (cycles - before) * self._period / (t - began))


class Deadlines:
    """Cycle k is due at k periods after the start, whatever the cycles before it took.

    Attributes:
        period: [s].
        wake: from when a cycle was due to when it began.
        answer: from when a cycle was due to when its command was sent.
        cycles: that were run.
        missed: cycles whose command left when the next was due, or later.
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
        """Spin, instead of sleeping, in the last ``spin`` [s] of each wait."""
        self.period = period
        self.wake, self.answer = LatencyCounter(), LatencyCounter()
        self.cycles = self.missed = self._over = 0
        self._spin, self._clock, self._sleep = spin, clock, sleep
        self._next, self._begun = 0, -1
        self.begin()

    def begin(self) -> None:
        """Start a period from now."""
        self._start = self._clock() + self.period
        self.due = 0.0

    @property
    def skipped(self) -> int:
        """Cycles that were over before they could begin."""
        return self._over

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
            self._over += over
            self._next += over
        self.due = self._next * self.period


class Ticks(Deadlines):
    """Cycles that are due when an executor of one's own begins them.

    ``wake`` is then by how much more than a period after the last cycle each one began.
    """

    @property
    def skipped(self) -> int:
        """How many cycles are missing: the whole periods that went by, less the cycles.

        The delays of many cycles that are a little late add up to whole periods, too.
        """
        return max(0, math.floor(self.due / self.period + 1e-6) - self.cycles)

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
        self.due, self._begun = now, self._next

    def sent(self) -> None:
        """The command of this cycle has left: count how late; the next is due a period on."""
        now = self.now()
        self.answer.add(now - self.due, now)
        self.cycles += 1
        self._next += 1
        self.missed += now - self.due >= self.period
        self.due += self.period
