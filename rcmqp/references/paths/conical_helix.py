"""The conical helix of the paper's experiment A, drawn by the tool tip."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from rcmqp import _kernel
from rcmqp.errors import OptionError
from rcmqp.maths.options import at_least, finite, options
from rcmqp.maths.smooth import check_ramp, progress
from rcmqp.references.paths.drawn import Drawn
from rcmqp.world.instrument import Vector3


@options
@dataclass(frozen=True, slots=True)
class ConicalHelix(Drawn):
    """A helix on a cone about an axis through the trocar, from rest to rest.

    Seen from the trocar in axes whose z is the helix's axis, the tip is at

        p(s) = [r cos(2 pi n s), r sin(2 pi n s), L + n h s],   r = r_0 + (r_1 - r_0) s,

    for s from 0 to 1. The tip starts at p(0), where the arm has it, so the axis is tilted by
    asin(r_0 / depth) from the shaft at the start. The paper names the path and gives no sizes;
    the defaults are 20 s at about 20 mm/s rms, 10 to 14 cm deep.

    Attributes:
        radius_start, radius_end: r_0 and r_1 [m].
        pitch: h, how much deeper the tip gets in one turn [m]; negative comes out.
        turns: n.
        duration: from rest to rest [s].
        ramp: how long the start and the stop take [s]; s' rises as 10u^3 - 15u^4 + 6u^5,
            is constant in between, and falls likewise.
    """

    radius_start: float = field(default=0.010, metadata=at_least(0.0, "m"))
    radius_end: float = field(default=0.030, metadata=at_least(0.0, "m"))
    pitch: float = field(default=0.04 / 3, metadata=finite("m"))
    turns: float = field(default=3.0, metadata=finite())
    duration: float = 20.0
    ramp: float = 1.0

    def __post_init__(self) -> None:
        """Check the times."""
        check_ramp(self.duration, self.ramp)

    def progress(self, t: float) -> tuple[float, float]:
        """How far the helix has come at ``t`` [s], s in [0, 1], and s' [1/s]."""
        return progress(t, self.duration, self.ramp)

    def tip(self, t: float, tip_depth: float) -> tuple[Vector3, Vector3]:
        """Tip (3,) [m] and its velocity (3,) [m/s] seen from the trocar, in x_d(0)'s axes.

        Raises:
            OptionError: the tip starts less deep than the helix is wide.
        """
        _, (r_0, r_1, pitch, n) = self.figure(tip_depth)
        s, s_dot = self.progress(t)
        turn, r = 2.0 * math.pi * n * s, r_0 + (r_1 - r_0) * s
        cos, sin, swing = math.cos(turn), math.sin(turn), 2.0 * math.pi * n * r
        L = math.sqrt(tip_depth**2 - r_0**2)
        x, y, z = r * cos, r * sin, L + n * pitch * s
        u, v = (r_1 - r_0) * cos - swing * sin, (r_1 - r_0) * sin + swing * cos  # dp/ds
        w = n * pitch
        c, d = L / tip_depth, -r_0 / tip_depth  # of the tilt, -asin(r_0 / tip_depth) about y
        velocity = (s_dot * (c * u + d * w), s_dot * v, s_dot * (c * w - d * u))
        return (c * x + d * z, y, c * z - d * x), velocity

    def figure(self, tip_depth: float) -> tuple[int, tuple[float, float, float, float]]:
        """See Drawn."""
        if not tip_depth > self.radius_start:
            raise OptionError(
                f"the tip starts {1e3 * tip_depth:.1f} mm inside; a helix of radius "
                f"{1e3 * self.radius_start:.1f} mm needs it deeper than that"
            )
        return _kernel.HELIX, (self.radius_start, self.radius_end, self.pitch, self.turns)
