"""How much slower than the clock the loop of a live session has been lately."""

from __future__ import annotations

from collections import deque

from rcmqp.realtime.latency import skipped_share

RECENT = 3.0
"""Window of the skipped share that the pages show [s]."""


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
        return skipped_share(cycles - before, self._period, t - began)
