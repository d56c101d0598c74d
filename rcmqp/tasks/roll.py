"""The roll of the camera about the shaft."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rcmqp import _kernel
from rcmqp.maths import dualquaternion as dq
from rcmqp.references.view import Reference
from rcmqp.tasks.base import Program, Residual, Task
from rcmqp.tasks.desired import desired
from rcmqp.world.arm import ArmState

OPPOSITE = 1e-12
"""Below this w^2 + z^2 the shafts point apart and there is no roll between them."""


@dataclass(frozen=True, eq=False)
class RollTask(Task):
    """Take the twist about the shaft out of the rotation from the desired effector to the own.

    With s = r_d* r = [w, x, y, z], of the two signs the one with w >= 0, the twist (of the
    swing-twist split) is phi = 2 atan2(z, w), in [-pi, pi]: the short way. From
    s' = (1/2) (s omega - omega_d s),

        phi' = 2 (w z' - z w') / (w^2 + z^2)
             = omega_z + ((x z - w y) omega_x + (w x + y z) omega_y) / (w^2 + z^2)
             - omega_d,z - ((x z + w y) omega_d,x + (y z - w x) omega_d,y) / (w^2 + z^2).

    Where the shafts point apart, w = z = 0, no roll is defined and nothing is asked.
    """

    name: ClassVar[str] = "roll"
    unit: ClassVar[str] = "rad"

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error (1,) [rad]; positive when turned too far about the shaft's z."""
        s = dq.quaternion_mul(dq.quaternion_conj(dq.P(reference.x_d)), dq.P(state.x))
        w, x, y, z = (float(value) for value in (s if s[0] >= 0.0 else -s))
        n = w * w + z * z
        if n < OPPOSITE:
            return Residual(np.zeros(1), np.zeros((1, state.J_local.shape[1])), np.zeros(1))
        own = np.array([(x * z - w * y) / n, (w * x + y * z) / n, 1.0])
        other = np.array([(x * z + w * y) / n, (y * z - w * x) / n, 1.0])
        return Residual(
            np.array([2.0 * math.atan2(z, w)]),
            own[None] @ state.J_local[3:],
            np.array([-other @ desired(reference).omega]),
        )

    def program(self) -> Program:
        """For compiled code."""
        return (_kernel.ROLL, math.sqrt(self.weight), self.gain, 0.0), ()
