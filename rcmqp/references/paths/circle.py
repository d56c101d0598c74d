"""A circle drawn by the tool tip: a path of CoIKS-Surg's benchmark."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rcmqp import _kernel
from rcmqp.maths.options import finite, options
from rcmqp.maths.smooth import check_ramp, progress
from rcmqp.references.paths.drawn import Drawn


@options
@dataclass(frozen=True, slots=True)
class Circle(Drawn):
    """A circle in the plane across the shaft, from rest to rest.

    Seen from the trocar in the axes of x_d(0), with L the depth at the start, the tip is at

        p(s) = [r (cos(2 pi n s) - 1), r sin(2 pi n s), L]

    for s from 0 to 1: it starts where the arm has it. The radius is that of CoIKS-Surg's
    benchmark (launch/coiks_constrained_benchmark.launch); its time is not given there.

    Attributes:
        radius: r [m]; a negative one starts to the other side.
        turns: n.
        duration: from rest to rest [s].
        ramp: how long the start and the stop take [s].
    """

    radius: float = field(default=0.015, metadata=finite("m"))
    turns: float = field(default=1.0, metadata=finite())
    duration: float = 8.0
    ramp: float = 1.0

    def __post_init__(self) -> None:
        """Check the times."""
        check_ramp(self.duration, self.ramp)

    def tip(self, t: float, tip_depth: float) -> tuple[np.ndarray, np.ndarray]:
        """Tip (3,) [m] and its velocity (3,) [m/s] seen from the trocar, in x_d(0)'s axes."""
        s, s_dot = progress(t, self.duration, self.ramp)
        turn, turn_dot = 2.0 * math.pi * self.turns * s, 2.0 * math.pi * self.turns * s_dot
        cos, sin = math.cos(turn), math.sin(turn)
        p = np.array([self.radius * (cos - 1.0), self.radius * sin, tip_depth])
        return p, self.radius * turn_dot * np.array([-sin, cos, 0.0])

    def figure(self, tip_depth: float) -> tuple[int, tuple[float, float, float, float]]:
        """See Drawn."""
        return _kernel.CIRCLE, (self.radius, self.turns, 0.0, 0.0)
