"""The remote centre of motion: the shaft passes through the trocar."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.maths.options import at_least
from rcmqp.tasks.base import CompiledTask


@dataclass(frozen=True, eq=False)
class RcmTask(CompiledTask):
    """Keep the shaft on the trocar.

    With (R, p) the effector's placement and (nu, omega) its twist in its own axes, the trocar
    seen from the effector is r = R^T (pivot - p). The shaft is the effector's z axis: its distance
    to the trocar is the norm of r's first two coordinates, the error.

    The error is counted in axes that go along with the shaft and do not spin about it: a spin
    changes no distance, but in axes that spin it would turn the error, and so give a joint that
    only rolls the shaft an entry of the size of the RCM error, and a strict hierarchy would spend
    that joint on it. With omega_s = (omega_x, omega_y, 0),

        dr/dt = [r]x omega_s - nu + R^T pivot_dot.

    Two rows of rank 2 (Azimian, Patel and Naish 2010, in spirit) leave depth and the three
    rotations about the trocar to other tasks.

    A joint velocity that is held for T takes the trocar along a curve, T^2/2 d^2r/dt^2 off the
    tangent: an error of T/(2 K) d^2r/dt^2 that stays. With ``period`` the second derivative is
    taken into account, as it is while the joints go on at state.v:

        d^2r/dt^2 = [dr/dt + R^T pivot_dot]x omega_s + [r]x omega_s' - nu',

    with (nu', omega') the twist's change by the joints' motion alone, see kinematic_hessian(), in
    the same axes: nu' + omega_z e_z x nu, and likewise for omega. What is left is of third order.

    Attributes:
        period: sampling period T [s]; 0 for the first order only.
    """

    name: ClassVar[str] = "rcm"
    unit: ClassVar[str] = "m"

    period: float = field(default=0.0, metadata=at_least(0.0, "s"))
    damping: float | None = field(default=0.0, kw_only=True)

    @functools.cached_property
    def block(self) -> Block:
        """Error (2,) [m], the trocar in the effector's axes, x and y."""
        return Block("rcm", period=self.period)
