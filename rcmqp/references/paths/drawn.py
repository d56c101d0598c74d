"""Paths that the tool tip draws, from rest to rest: their views, a whole block at once."""

from __future__ import annotations

import abc
import math
from dataclasses import dataclass, field

import numpy as np

from rcmqp import _kernel
from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import at_least, finite, options, rule
from rcmqp.maths.smooth import check_ramp
from rcmqp.references.view import ViewCommand, not_inside
from rcmqp.world.instrument import Vector3, vector3


class Drawn(abc.ABC):
    """A path whose tip is drawn in compiled code: rcmqp/kernel/drawn.c.

    Attributes:
        duration: from rest to rest [s].
        ramp: how long the start and the stop take [s].
    """

    __slots__ = ()

    duration: float
    ramp: float

    @abc.abstractmethod
    def figure(self, tip_depth: float) -> tuple[int, tuple[float, float, float, float]]:
        """What compiled code needs: which figure, its sizes and turns.

        Raises:
            OptionError: the figure cannot be drawn from a tip ``tip_depth`` [m] inside.
        """

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view whose tip is on the path at ``t`` [s], without roll."""
        return ViewCommand(*self.views_at(np.array([t], dtype=float), tip_depth)[0].tolist())

    def views_at(self, times: Array, tip_depth: float) -> Array:
        """The views (n, 8) at ``times`` (n,) [s], a ViewCommand's numbers each; see command().

        Raises:
            InvalidCommand: the path leaves the trocar.
        """
        figure, numbers = self.figure(tip_depth)
        sizes = np.array(numbers, dtype=float)
        views = _kernel.views(figure, sizes, self.duration, self.ramp, times, tip_depth)
        outside = ~(abs(views[:, 0]) < math.pi / 2.0)  # atan2(x, z) with z <= 0
        if outside.any():
            alpha, beta, _, t_z = views[outside.argmax(), :4].tolist()
            raise not_inside((tip_depth + t_z) * math.cos(alpha) * math.cos(beta))
        return views


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
        check_ramp(self.duration, self.ramp)

    def figure(self, tip_depth: float) -> tuple[int, tuple[float, float, float, float]]:
        """See Drawn."""
        return _kernel.CIRCLE, (self.radius, self.turns, 0.0, 0.0)


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
        check_ramp(self.duration, self.ramp)

    def figure(self, tip_depth: float) -> tuple[int, tuple[float, float, float, float]]:
        """See Drawn."""
        if not tip_depth > self.radius_start:
            raise OptionError(
                f"the tip starts {1e3 * tip_depth:.1f} mm inside; a helix of radius "
                f"{1e3 * self.radius_start:.1f} mm needs it deeper than that"
            )
        return _kernel.HELIX, (self.radius_start, self.radius_end, self.pitch, self.turns)


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
        check_ramp(self.duration, self.ramp)

    def figure(self, tip_depth: float) -> tuple[int, tuple[float, float, float, float]]:
        """See Drawn."""
        a, b, c = self.size
        if not tip_depth > 2.0 * c:
            raise OptionError(
                f"the tip starts {1e3 * tip_depth:.1f} mm inside; a figure that comes out by "
                f"{2e3 * c:.1f} mm needs it deeper than that"
            )
        return _kernel.LISSAJOUS, (a, b, c, self.turns)
