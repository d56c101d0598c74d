"""The remote centre of motion: the shaft passes through the trocar."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pinocchio as pin

from rcmqp import _kernel
from rcmqp.errors import OptionError
from rcmqp.references.view import Reference
from rcmqp.tasks.base import Program, Residual, Task
from rcmqp.world.arm import ArmState, kinematic_hessian


@dataclass(frozen=True, eq=False)
class RcmTask(Task):
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

    period: float = 0.0
    damping: float | None = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        if not 0.0 <= self.period < np.inf:
            raise OptionError(f"period = {self.period} s, it must be 0 or more, and finite")

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error (2,) [m], the trocar in the effector's axes, x and y."""
        r = state.oMe.actInv(reference.pivot)
        nu, omega = state.J_local[:3], state.J_local[3:] * np.array([[1.0], [1.0], [0.0]])
        jacobian = pin.skew(r) @ omega - nu
        carried = state.oMe.rotation.T @ reference.pivot_dot
        drift = carried
        if self.period > 0.0:
            change = np.einsum("aij,i,j", kinematic_hessian(state.J_local), state.v, state.v)
            twist = state.J_local @ state.v
            spin = np.array([0.0, 0.0, twist[5]])
            nu_dot = change[:3] + np.cross(spin, twist[:3])
            omega_dot = change[3:] + np.cross(spin, twist[3:])
            omega_dot[2] = 0.0
            moving = jacobian @ state.v + 2.0 * carried
            bend = np.cross(moving, omega @ state.v) + np.cross(r, omega_dot) - nu_dot
            drift = carried + 0.5 * self.period * bend
        return Residual(r[:2], jacobian[:2], drift[:2])

    def program(self) -> Program:
        """For compiled code."""
        return (_kernel.RCM, math.sqrt(self.weight), self.gain, self.period), ()
