"""A sphere to stay in."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.limits.spheres import SphereLimit, bends, check_part


@dataclass(frozen=True, eq=False, kw_only=True)
class KeepIn(SphereLimit):
    """Keep the tip, or the whole instrument, in a sphere.

    delta <= radius - instrument.radius for the tip, or for both ends of the shaft and of each
    piece of a wrist: the farthest point of a segment is an end.

    Attributes:
        part: ``"tip"``, or ``"shaft"``, from mount to tip, with a wrist's pieces.
    """

    name: ClassVar[str] = "keep_in"

    part: str = "tip"

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        check_part(self.part)
        self.check_room()
        _ = self.block  # made now: what was given may be written to later

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s] for the tip; others for where the pieces of a wrist begin, the mount."""
        first = self.mount_depth if self.part == "shaft" else self.shaft_depth
        return self.ball("keep_in", self.room, first, **bends(self.instrument.wrist))

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the tip, of the joints of a wrist, and of the mount."""
        ends = ("tip", *self.pieces(), "mount") if self.part == "shaft" else ("tip",)
        return tuple(f"{self.label}, {end} in" for end in ends)
