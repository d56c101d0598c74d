"""How far the instrument may go in and out of the trocar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin

from rcmqp import _kernel
from rcmqp.limits.base import Constraint, Damper
from rcmqp.references.view import Reference
from rcmqp.tasks.base import check_finite
from rcmqp.world.arm import ArmState
from rcmqp.world.instrument import Trocar


@dataclass(frozen=True, eq=False)
class TrocarDepth(Damper):
    """Keep the insertion depth in the trocar's range.

    With the trocar seen from the effector, r = R^T (pivot - p), depth = tip_depth - r_z, and

        depth' = (nu - [r]x omega - R^T pivot_dot)_z,
        depth' <= pace(deepest - depth),   -depth' <= pace(depth - shallowest).

    Attributes:
        trocar: its depth range.
        tip_depth: from the effector to the tip, along the shaft [m].
    """

    name: ClassVar[str] = "trocar_depth"

    trocar: Trocar
    tip_depth: float

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        check_finite("tip_depth", self.tip_depth, "m")

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """Two rows [m/s]: the deepest, the shallowest."""
        r = state.oMe.actInv(reference.pivot)
        row = state.J_local[2] - (pin.skew(r) @ state.J_local[3:])[2]
        drift = -(state.oMe.rotation.T @ reference.pivot_dot)[2]
        depth = self.tip_depth - r[2]
        shallowest, deepest = self.trocar.depth_range
        return Constraint.rows(
            np.array([row, -row]),
            [self.pace(deepest - depth) - drift, self.pace(depth - shallowest) + drift],
            self.row_names,
        )

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the two rows."""
        return ("trocar depth, deepest", "trocar depth, shallowest")

    def program(self) -> tuple[float, ...]:
        """For compiled code."""
        numbers = (_kernel.TROCAR_DEPTH, self.gain, self.deceleration, self.tip_depth)
        return (*numbers, *self.trocar.depth_range)
