"""From the way of a hand to a view."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from rcmqp.maths.options import options, positive
from rcmqp.references.view import ViewCommand, view_of_tip
from rcmqp.world.instrument import Vector3

SHALLOWEST = 0.01
"""The least depth of the tip that a hand may ask for [m]: a view must stay inside."""


@options
@dataclass(frozen=True, slots=True)
class HandMapping:
    """Section IV-B: the hand's way from its start becomes (t_z, alpha, beta) of equation (5).

    With h the way, L the depth of the tip at the start and d = L + s h_z,

        t_z = s h_z,   alpha = atan2(s h_x, d),   beta = -atan2(s h_y, sqrt(d^2 + s^2 h_x^2)),

    so that the tip looks along (s h_x, s h_y, d) and, for a small tilt, moves s times as far as
    the hand, to the same side of the image, at any depth. The paper gives neither the formula nor
    the scale; with s = 1 its square of 5 cm fits into the device.

    Attributes:
        scale: s, tip over hand.
    """

    scale: float = field(default=1.0, metadata=positive())

    def view(self, way: Vector3, velocity: Vector3, tip_depth: float) -> ViewCommand:
        """The view of a hand that has gone ``way`` (3,) [m] and moves with ``velocity`` (3,).

        A hand that pulls the tip to within 1 cm of the trocar gets no further.
        """
        s = self.scale
        x, y, d = s * way[0], s * way[1], tip_depth + s * way[2]
        u, v, w = s * velocity[0], s * velocity[1], s * velocity[2]
        if d < SHALLOWEST:
            d, w = SHALLOWEST, 0.0
        towards = view_of_tip((x, y, d), (u, v, w), tip_depth)
        return ViewCommand(
            alpha=towards.alpha,
            beta=towards.beta,
            t_z=d - tip_depth,
            alpha_dot=towards.alpha_dot,
            beta_dot=towards.beta_dot,
            t_z_dot=w,
        )

    def way(self, p: Vector3, tip_depth: float) -> Vector3:
        """The hand's way (3,) [m] that brings the tip to ``p``; inverse of view().

        Args:
            p: (3,) tip seen from the trocar, in the axes of x_d(0) [m]; p[2] > 0.
            tip_depth: of the tip at the start [m].
        """
        d = math.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
        return (
            d * p[0] / p[2] / self.scale,
            d * p[1] / p[2] / self.scale,
            (d - tip_depth) / self.scale,
        )
