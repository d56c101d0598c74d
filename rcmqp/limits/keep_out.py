"""A sphere to stay out of."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from rcmqp._kernel import Block
from rcmqp.limits.spheres import SphereLimit, bends, check_part
from rcmqp.tasks.base import filled_in
from rcmqp.world.insertion import Insertion


@dataclass(frozen=True, eq=False, kw_only=True)
class KeepOut(SphereLimit):
    """Keep the tip, or the whole instrument, out of a sphere.

    delta >= radius + instrument.radius for the tip, or for the nearest point of the shaft and of
    each piece of a wrist. With the centre right on the axis every direction is a way out, and the
    effector's x is taken.

    Attributes:
        part: ``"shaft"``, from mount to tip, with a wrist's pieces; or ``"tip"``.
    """

    name: ClassVar[str] = "keep_out"

    part: str = "shaft"

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        check_part(self.part)
        _ = self.block  # made now: what was given may be written to later

    @classmethod
    def obstacles(cls, insertion: Insertion, **options: Any) -> tuple[Self, ...]:
        """One limit for each obstacle of an insertion, for tip and shaft."""
        made = []
        for i, sphere in enumerate(insertion.obstacles, start=1):
            given = {"centre": sphere.centre, "radius": sphere.radius, "label": f"obstacle {i}"}
            made.append(cls(**filled_in(cls, insertion, given | options)))
        return tuple(made)

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s]; with a wrist, one more for each of its pieces."""
        first = self.mount_depth if self.part == "shaft" else self.shaft_depth
        reach = self.radius + self.instrument.radius
        return self.ball("keep_out", reach, first, **bends(self.instrument.wrist))

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the tip; or of the shaft and a wrist's pieces, by the joint that each begins at."""
        pieces = self.pieces() if self.part == "shaft" else ()
        return tuple(f"{self.label}, {part} out" for part in (self.part, *pieces))
