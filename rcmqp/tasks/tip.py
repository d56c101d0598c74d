"""The tip of the instrument in the world."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin

from rcmqp import _kernel
from rcmqp.references.view import Reference
from rcmqp.tasks.base import Program, Residual, Task, check_finite
from rcmqp.tasks.desired import desired
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class TipTask(Task):
    """Bring the tip to where the desired effector has it.

    With a = tip_depth e_z the tip in the effector's axes, the tip is p + R a, so

        e = (p + R a) - (p_d + R_d a),
        de/dt = R (nu - [a]x omega) - R_d (nu_d + omega_d x a).

    Attributes:
        tip_depth: from the effector to the tip, along the shaft [m].
    """

    name: ClassVar[str] = "tip"
    unit: ClassVar[str] = "m"

    tip_depth: float

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        check_finite("tip_depth", self.tip_depth, "m")

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error (3,) [m], in the world's axes."""
        d, R = desired(reference), state.oMe.rotation
        nu, omega = state.J_local[:3], state.J_local[3:]
        a = np.array([0.0, 0.0, self.tip_depth])
        jacobian = R @ (nu - pin.skew(a) @ omega)
        error = state.oMe.translation - d.p + (R - d.R) @ a
        return Residual(error, jacobian, -d.R @ (d.nu + pin.skew(d.omega) @ a))

    def program(self) -> Program:
        """For compiled code."""
        return (_kernel.TIP, math.sqrt(self.weight), self.gain, self.tip_depth), ()
