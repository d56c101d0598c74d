"""Least, largest, mean square and percentiles of numbers that come block after block."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.head import Rows

AT_ONCE = 1 << 15
"""Numbers that percentiles() keeps in memory."""

DIGIT = 16
"""Bits of a digit in the search for the k-th number."""


class Extent:
    """How far numbers go.

    Attributes:
        count: how many there were.
        low, high: least and largest; NaN where one was.
        squares: the sum of their squares.
    """

    def __init__(self) -> None:
        """Without any number yet."""
        self.count, self.low, self.high, self.squares = 0, math.inf, -math.inf, 0.0

    def add(self, values: Array) -> None:
        """Take some more, of any shape."""
        if values.size:
            self.count += values.size
            self.low = float(np.minimum(self.low, values.min()))
            self.high = float(np.maximum(self.high, values.max()))
            self.squares += float(np.sum(np.square(values)))

    @property
    def mean_square(self) -> float:
        """Of all of them; NaN without any."""
        return self.squares / self.count if self.count else math.nan

    @property
    def rms(self) -> float:
        """Root of the mean square."""
        return math.sqrt(self.mean_square)


class FirstRows:
    """The first rows of an array or a dataset, read as they are sliced."""

    def __init__(self, values: Rows, count: int) -> None:
        """Of ``values``, no more than they have."""
        self._values, self._count = values, min(count, values.shape[0])

    @property
    def shape(self) -> tuple[int, ...]:
        """As the array's, with the rows that count."""
        return (self._count, *self._values.shape[1:])

    @property
    def dtype(self) -> Any:
        """The array's."""
        return self._values.dtype

    def __getitem__(self, rows: slice, /) -> Any:
        """Rows first to last, the step 1."""
        first, last, _ = rows.indices(self._count)
        return self._values[first:last]


def percentile(values: Rows, share: float) -> float:
    """What np.percentile() says, to the bit, of (n,) numbers, none negative, read in blocks.

    NaN where one of them is.

    Args:
        values: an array, or a dataset.
        share: from 0 to 100 [%].
    """
    n = values.shape[0]
    if n <= AT_ONCE:
        return float(np.percentile(values[0:n], share))
    place = share / 100.0 * (n - 1)
    k = math.floor(place)
    if any(np.isnan(block).any() for block in _blocks(values)):
        return math.nan
    between = [_number(values, k), _number(values, min(k + 1, n - 1))]
    return float(np.percentile(between, 100.0 * (place - k)))


def _number(values: Rows, k: int) -> float:
    """The k-th, from 0, of the numbers in order: as bits, those that are not negative keep it.

    Each round finds one more digit of it: how many of the numbers that begin as it does have
    which one next.
    """
    found = 0
    for shift in range(64 - DIGIT, -1, -DIGIT):
        counts = np.zeros(1 << DIGIT, dtype=np.int64)
        for block in _blocks(values):
            head = block.view(np.uint64) >> np.uint64(shift)
            alike = head[head >> np.uint64(DIGIT) == found]
            counts += np.bincount(
                (alike & np.uint64((1 << DIGIT) - 1)).astype(np.int64), minlength=counts.size
            )
        before = np.cumsum(counts)
        digit = int(np.searchsorted(before, k, side="right"))
        k -= int(before[digit] - counts[digit])
        found = found << DIGIT | digit
    return float(np.array(found, dtype=np.uint64).view(np.float64))


def _blocks(values: Rows) -> Iterator[Array]:
    for first in range(0, values.shape[0], AT_ONCE):
        yield np.asarray(values[first : first + AT_ONCE], dtype=float) + 0.0  # no -0.0
