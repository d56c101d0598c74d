"""A sphere to stay out of."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from rcmqp._kernel import Block
from rcmqp.limits.spheres import SphereLimit, check_part
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
        _ = self.block  # made now: what was given may be written to later

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

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s]."""
        first = self.mount_depth if self.part == "shaft" else self.tip_depth
        return self.ball("keep_out", self.radius + self.instrument.radius, first)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the one row."""
        return (f"{self.label}, {self.part} out",)
