"""A Lissajous figure drawn by the tool tip: a path of CoIKS-Surg's benchmark."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rcmqp import _kernel
from rcmqp.errors import OptionError
from rcmqp.maths.options import finite, options, rule
from rcmqp.maths.smooth import check_ramp, progress
from rcmqp.references.paths.drawn import Drawn
from rcmqp.world.instrument import Vector3, vector3


@options
@dataclass(frozen=True, slots=True)
class Lissajous(Drawn):
    """A figure of eight that also goes in and out, from rest to rest.

    Seen from the trocar in the axes of x_d(0), with L the depth at the start, the tip is at

        p(u) = [a sin u, -b sin 2u, L + c (cos 2u - 1)],   u = 2 pi n s,

    for s from 0 to 1: it starts where the arm has it. These are the curves of CoIKS-Surg's
    benchmark (create6DLissajousPath), which stops at u = 10, before the curve closes, and
    leaves the sizes to its user.

    Attributes:
        size: (a, b, c) [m]; c > 0 comes out, by 2c.
        turns: n, how often the figure is drawn.
        duration: from rest to rest [s].
        ramp: how long the start and the stop take [s].
    """

    size: Vector3 = field(default=(0.02, 0.015, 0.005), metadata=rule(vector3))
    turns: float = field(default=1.0, metadata=finite())
    duration: float = 10.0
    ramp: float = 1.0

    def __post_init__(self) -> None:
        """Check the times."""
        check_ramp(self.duration, self.ramp)

    def tip(self, t: float, tip_depth: float) -> tuple[np.ndarray, np.ndarray]:
        """Tip (3,) [m] and its velocity (3,) [m/s] seen from the trocar, in x_d(0)'s axes.

        Raises:
            OptionError: the figure would come out of the trocar.
        """
        _, (a, b, c, n) = self.figure(tip_depth)
        s, s_dot = progress(t, self.duration, self.ramp)
        u, u_dot = 2.0 * math.pi * n * s, 2.0 * math.pi * n * s_dot
        cos_2u, sin_2u = math.cos(2.0 * u), math.sin(2.0 * u)
        p = np.array([a * math.sin(u), -b * sin_2u, tip_depth + c * (cos_2u - 1.0)])
        dp_du = np.array([a * math.cos(u), -2.0 * b * cos_2u, -2.0 * c * sin_2u])
        return p, u_dot * dp_du

    def figure(self, tip_depth: float) -> tuple[int, tuple[float, float, float, float]]:
        """See Drawn."""
        a, b, c = self.size
        if not tip_depth > 2.0 * c:
            raise OptionError(
                f"the tip starts {1e3 * tip_depth:.1f} mm inside; a figure that comes out by "
                f"{2e3 * c:.1f} mm needs it deeper than that"
            )
        return _kernel.LISSAJOUS, (a, b, c, self.turns)
