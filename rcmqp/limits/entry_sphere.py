"""A sphere to pass through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rcmqp.limits.base import Constraint
from rcmqp.limits.spheres import SphereLimit, direction
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False, kw_only=True)
class EntrySphere(SphereLimit):
    """Make the shaft pass through a sphere: the trocar as a tube, not as a point.

    delta <= radius - instrument.radius for the nearest point of the shaft. The entry sphere of
    Marinho et al. 2019.

    Departures: the paper damps the squared distance of the shaft's whole line, without the
    shaft's radius; here it is the distance itself of the segment from mount to tip.
    """

    name: ClassVar[str] = "entry_sphere"

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        self.check_room()

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """One row [m/s]."""
        b, jacobian, drift = self.seen(state, reference)
        delta, u = direction(b, self.nearest(b))
        d = self.pace(self.room - delta) - u @ drift
        return Constraint.rows([u @ jacobian], [d], [f"{self.label}, shaft through"])
