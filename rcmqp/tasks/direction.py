"""Where the camera looks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin

from rcmqp.references.view import Reference
from rcmqp.tasks.base import Residual, Task
from rcmqp.tasks.desired import desired
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class DirectionTask(Task):
    """Point the shaft as the desired effector points its own.

    The desired shaft axis z_d, seen from the effector, is u = R^T z_d; on target it is e_z. The
    error is u's first two coordinates, its norm the sine of the angle between the shafts:

        du/dt = [u]x omega + R^T R_d (omega_d x e_z).

    Two rows of rank 2, but where the angle is 90 degrees; beyond it the error shrinks again and
    is zero, unstably, at 180. No camera in a trocar turns that far.
    """

    name: ClassVar[str] = "direction"
    unit: ClassVar[str] = "rad"

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error (2,), no unit, in the effector's axes, x and y."""
        d = desired(reference)
        eRd = state.oMe.rotation.T @ d.R
        u = eRd[:, 2]
        jacobian = pin.skew(u) @ state.J_local[3:]
        drift = eRd @ np.array([d.omega[1], -d.omega[0], 0.0])
        return Residual(u[:2], jacobian[:2], drift[:2])
