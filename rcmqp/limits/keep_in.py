"""A sphere to stay in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rcmqp.limits.base import Constraint
from rcmqp.limits.spheres import SphereLimit, check_part, direction
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False, kw_only=True)
class KeepIn(SphereLimit):
    """Keep the tip, or the whole shaft, in a sphere.

    delta <= radius - instrument.radius for the tip, or for both ends of the shaft: the farthest
    point of a segment is an end.

    Attributes:
        part: ``"tip"``, or ``"shaft"``, from mount to tip.
    """

    name: ClassVar[str] = "keep_in"

    part: str = "tip"

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        check_part(self.part)
        self.check_room()

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """One row [m/s] for the tip, a second one for the mount."""
        b, jacobian, drift = self.seen(state, reference)
        ends = {"tip": self.tip_depth}
        if self.part == "shaft":
            ends["mount"] = self.mount_depth
        C, d = [], []
        for s in ends.values():
            delta, u = direction(b, s)
            C.append(u @ jacobian)
            d.append(self.pace(self.room - delta) - u @ drift)
        return Constraint.rows(C, d, [f"{self.label}, {end} in" for end in ends])
