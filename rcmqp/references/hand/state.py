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
        roll: of the handle about z [rad], counted from anywhere; positive is clockwise.

    Raises:
        InvalidCommand: a number is not finite.
    """

    position: Vector3
    velocity: Vector3 = (0.0, 0.0, 0.0)
    engaged: bool = True
    roll: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not a number."""
        if not all(map(math.isfinite, (*self.position, *self.velocity, self.roll))):
            raise InvalidCommand(f"not finite: {self}; a handle needs seven finite numbers")
