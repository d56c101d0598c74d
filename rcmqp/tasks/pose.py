"""The whole effector pose, by the paper's error."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.tasks.base import CompiledTask


@dataclass(frozen=True, eq=False)
class PoseTask(CompiledTask):
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

    @functools.cached_property
    def block(self) -> Block:
        """Error (8,), no unit for the rotation and [m] for half the translation."""
        return Block("pose")
