"""Least, largest and mean square of numbers that come block after block."""

from __future__ import annotations

import math

import numpy as np

from rcmqp.maths.dualquaternion import Array


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
