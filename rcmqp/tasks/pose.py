"""The whole effector pose, by the paper's error."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

from rcmqp import _kernel
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import C8
from rcmqp.references.view import Reference
from rcmqp.tasks.base import Program, Residual, Task
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class PoseTask(Task):
    """Bring the effector to x_d by the dual-quaternion error of equation (3).

        e = vec(1 - x* x_d),   de/dt = -N v - vec(x* x_d'),   N = H-(x_d) C8 J_dq

    8 rows of rank 6 at the most. Of x_d and -x_d, one pose, the one on x's side is taken, with
    its derivative. At x_d' = 0 the least-squares v on a level of its own is the paper's law
    K N^+ e.

    The error is out of N's range in second order: 1 - cos(phi / 2) of it is left when the pose
    is phi [rad] off, so only the pose tells whether the task is done on the way.
    """

    name: ClassVar[str] = "pose"

    damping: float | None = field(default=0.005, kw_only=True)

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error (8,), no unit for the rotation and [m] for half the translation."""
        side = -1.0 if dq.P(state.x) @ dq.P(reference.x_d) < 0.0 else 1.0
        x_d, x_d_dot = side * reference.x_d, side * reference.x_d_dot
        x_conj = dq.conj(state.x)
        N = dq.H8_minus(x_d) @ C8 @ state.J_dq
        return Residual(dq.IDENTITY - dq.mul(x_conj, x_d), -N, -dq.mul(x_conj, x_d_dot))

    def program(self) -> Program:
        """For compiled code."""
        return (_kernel.POSE, math.sqrt(self.weight), self.gain, 0.0), ()
