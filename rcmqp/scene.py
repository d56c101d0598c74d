"""Things in the patient that the instrument is to keep out of."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rcmqp.errors import OptionError
from rcmqp.instrument import Vector3, vector3


@dataclass(frozen=True, slots=True)
class Sphere:
    """A ball that stands still in the world.

    Attributes:
        centre: (3,) [m].
        radius: [m].
    """

    centre: Vector3
    radius: float

    def __post_init__(self) -> None:
        """Make the centre plain numbers and check the radius."""
        object.__setattr__(self, "centre", vector3("centre", self.centre))
        if not 0.0 < self.radius < math.inf:
            raise OptionError(f"radius = {self.radius} m, it must be positive and finite")
