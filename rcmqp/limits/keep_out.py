"""A sphere to stay out of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from rcmqp import _kernel
from rcmqp.limits.base import Constraint
from rcmqp.limits.spheres import CENTRE, SphereLimit, check_part, direction
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion


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

    @classmethod
    def obstacles(cls, insertion: Insertion, **options: Any) -> tuple[Self, ...]:
        """One limit for each obstacle of an insertion, for tip and shaft."""
        return tuple(
            cls(
                centre=sphere.centre,
                radius=sphere.radius,
                instrument=insertion.instrument,
                tip_depth=insertion.tip_depth,
                label=f"obstacle {i}",
                **options,
            )
            for i, sphere in enumerate(insertion.obstacles, start=1)
        )

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """One row [m/s]."""
        b, jacobian, drift = self.seen(state, reference)
        s = self.tip_depth if self.part == "tip" else self.nearest(b)
        delta, u = direction(b, s)
        if delta <= CENTRE:
            u = np.array([1.0, 0.0, 0.0])
        room = delta - self.radius - self.instrument.radius
        return Constraint.rows([-u @ jacobian], [self.pace(room) + u @ drift], self.row_names)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the one row."""
        return (f"{self.label}, {self.part} out",)

    def program(self) -> tuple[float, ...]:
        """For compiled code."""
        return (
            *(_kernel.KEEP_OUT, self.gain, self.deceleration),
            *(*self.centre, *self.velocity, float(self.on_trocar)),
            self.radius + self.instrument.radius,
            self.tip_depth if self.part == "tip" else self.mount_depth,
            self.tip_depth,
        )
