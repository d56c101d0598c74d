"""How late things were, counted in bins: the same memory for a second and for a day."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass

import numpy as np

_R20 = "1 1.12 1.25 1.4 1.6 1.8 2 2.24 2.5 2.8 3.15 3.55 4 4.5 5 5.6 6.3 7.1 8 9".split()
"""Renard's series of twenty numbers a decade (ISO 3)."""

EDGES = tuple(float(f"{number}e{power}") for power in range(-6, 1) for number in _R20)
"""Upper edges of the bins [s], from 1 us to 9 s; below the first and beyond the last is a bin
more. Neighbours differ by 13 % at most, and a quantile is known to that."""


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
        """What was counted so far."""
        return Latency(tuple(self._counts), self._worst, self._worst_at)
