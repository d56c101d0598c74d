"""How far the instrument is inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pinocchio as pin

from rcmqp.references.view import Reference
from rcmqp.tasks.base import Residual, Task
from rcmqp.tasks.desired import desired
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class DepthTask(Task):
    """Bring the insertion depth to that of the desired effector.

    Both are measured along a shaft, its own each, from the trocar: depth = tip_depth - r_z with
    r = R^T (pivot - p), see RcmTask. The depth of the tip below the effector is the same for
    both and drops out:

        e = r_d,z - r_z,   de/dt = ([r_d]x omega_d - nu_d + R_d^T pivot_dot)_z
                                 - ([r]x omega - nu + R^T pivot_dot)_z.
    """

    name: ClassVar[str] = "depth"
    unit: ClassVar[str] = "m"

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error (1,) [m], positive when too deep."""
        d, oMe = desired(reference), state.oMe
        r, r_d = oMe.actInv(reference.pivot), d.R.T @ (reference.pivot - d.p)
        nu, omega = state.J_local[:3], state.J_local[3:]
        jacobian = nu - pin.skew(r) @ omega
        drift = pin.skew(r_d) @ d.omega - d.nu + (d.R - oMe.rotation).T @ reference.pivot_dot
        return Residual((r_d - r)[2:], jacobian[2:], drift[2:])
