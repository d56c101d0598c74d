"""What a haptic device says of its handle."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rcmqp.errors import InvalidCommand
from rcmqp.world.instrument import Vector3


@dataclass(frozen=True, slots=True)
class DeviceState:
    """The handle, now.

    Its axes are those of the camera's image as the hand feels them: x to the right, y down,
    z into the patient.

    Attributes:
        position: (3,) of the handle [m], counted from anywhere.
        velocity: (3,) [m/s].
        engaged: whether the handle drives the camera; without, the camera stays.

    Raises:
        InvalidCommand: a number is not finite.
    """

    position: Vector3
    velocity: Vector3 = (0.0, 0.0, 0.0)
    engaged: bool = True

    def __post_init__(self) -> None:
        """Refuse what is not a number."""
        if not all(map(math.isfinite, (*self.position, *self.velocity))):
            raise InvalidCommand(f"not finite: {self}; a handle needs six finite numbers")
