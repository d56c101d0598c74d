"""The remote centre of motion: the shaft passes through the trocar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pinocchio as pin

from rcmqp.arm import ArmState
from rcmqp.reference import Reference
from rcmqp.tasks.base import Residual, Task


@dataclass(frozen=True, eq=False)
class RcmTask(Task):
    """Keep the shaft on the trocar.

    With (R, p) the effector's placement and (nu, omega) its twist in its own axes, the trocar
    seen from the effector is r = R^T (pivot - p), so

        dr/dt = [r]x omega - nu + R^T pivot_dot.

    The shaft is the effector's z axis: its distance to the trocar is the norm of r's first two
    coordinates, the error. Two rows of rank 2 (Azimian, Patel and Naish 2010, in spirit) leave
    depth and the three rotations about the trocar to other tasks.
    """

    name: ClassVar[str] = "rcm"

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error (2,) [m], the trocar in the effector's axes, x and y."""
        r = state.oMe.actInv(reference.pivot)
        nu, omega = state.J_local[:3], state.J_local[3:]
        jacobian = pin.skew(r) @ omega - nu
        drift = state.oMe.rotation.T @ reference.pivot_dot
        return Residual(r[:2], jacobian[:2], drift[:2])
