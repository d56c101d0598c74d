"""A sphere to stay out of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rcmqp.arm import ArmState
from rcmqp.limits.base import Constraint
from rcmqp.limits.spheres import CENTRE, SphereLimit, check_part, direction
from rcmqp.reference import Reference


@dataclass(frozen=True, eq=False, kw_only=True)
class KeepOut(SphereLimit):
    """Keep the tip, or the whole shaft, out of a sphere.

    delta >= radius + instrument.radius for the tip or for the nearest point of the shaft. With
    the centre right on the axis every direction is a way out, and the effector's x is taken.

    Attributes:
        part: ``"shaft"``, from mount to tip, or ``"tip"``.
    """

    name: ClassVar[str] = "keep_out"

    part: str = "shaft"

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        check_part(self.part)

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """One row [m/s]."""
        b, jacobian, drift = self.seen(state, reference)
        s = self.tip_depth if self.part == "tip" else self.nearest(b)
        delta, u = direction(b, s)
        if delta <= CENTRE:
            u = np.array([1.0, 0.0, 0.0])
        room = delta - self.radius - self.instrument.radius
        return Constraint.rows(
            [-u @ jacobian], [self.pace(room) + u @ drift], [f"{self.label}, {self.part} out"]
        )
