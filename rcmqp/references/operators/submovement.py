"""A single aimed movement of the hand, from rest to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rcmqp.maths.smooth import step
from rcmqp.references.operators.operator import Operator
from rcmqp.world.instrument import Vector3

PEAK = 1.875
"""Highest over mean speed of 10u^3 - 15u^4 + 6u^5: a bell."""

UNIT = 1e-3
"""Length of a submovement that is one bit [m]."""


def duration(operator: Operator, length: float) -> float:
    """How long a submovement of ``length`` [m] takes [s].

    max(shortest, a + b log2(1 + length / 1 mm), 1.875 length / speed): Fitts' law, unless that
    is quicker than the operator cares to move.
    """
    fitts = operator.fitts_intercept + operator.fitts_slope * math.log2(1.0 + length / UNIT)
    return max(operator.shortest, fitts, PEAK * length / operator.speed)


@dataclass(frozen=True, slots=True)
class Submovement:
    """Minimum jerk (Flash and Hogan 1985): start + way (10u^3 - 15u^4 + 6u^5).

    Attributes:
        start: (3,) where it begins [m].
        way: (3,) where it goes from there [m].
        begin: when [s].
        duration: [s].
    """

    start: Vector3
    way: Vector3
    begin: float
    duration: float

    def position(self, t: float) -> Vector3:
        """Where the hand (3,) [m] is meant to be at ``t`` [s]."""
        s, _ = step((t - self.begin) / self.duration)
        (a, b, c), (x, y, z) = self.start, self.way
        return a + s * x, b + s * y, c + s * z
