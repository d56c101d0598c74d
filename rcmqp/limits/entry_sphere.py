"""A sphere to pass through."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.limits.spheres import SphereLimit


@dataclass(frozen=True, eq=False, kw_only=True)
class EntrySphere(SphereLimit):
    """Make the shaft pass through a sphere: the trocar as a tube, not as a point.

    delta <= radius - instrument.radius for the nearest point of the shaft, which ends at the first
    joint of a wrist. The entry sphere of Marinho et al. 2019.

    Departures: the paper damps the squared distance of the shaft's whole line, without the
    shaft's radius; here it is the distance itself of the segment from mount to the shaft's end.
    """

    name: ClassVar[str] = "entry_sphere"

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        self.check_room()
        _ = self.block  # made now: what was given may be written to later

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s]."""
        return self.ball("entry_sphere", self.room, self.mount_depth)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the one row."""
        return (f"{self.label}, shaft through",)
