"""A haptic device like the paper's: Force Dimension's Omega.7."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from rcmqp.maths.options import from_to, options, positive
from rcmqp.references.hand import DeviceState
from rcmqp.world.instrument import Vector3

DAMPING_LIMIT = 40.0
"""Largest viscosity that the device renders [N s/m], in CHAI3D's specification of it."""

VELOCITY_WINDOW = 0.02
"""Time over which readings are differenced to get a velocity [s]: chosen here."""


@options
@dataclass(frozen=True, slots=True)
class Omega7:
    """The haptic device, as far as its holder feels it; translations only, as in the paper.

    Attributes:
        radius: of the sphere that the handle can reach, about where it starts [m]: 75 mm in
            CHAI3D's specification (cDeltaDevice).
        resolution: of the readings [m]; the data sheet says below 0.01 mm.
        viscosity: B, by which the device resists the hand [N s/m]. The paper added one, "both
            reducing hand tremor and helping slowing the users' movements", and does not say how
            much: 15 is well inside what the device renders, up to 40.
    """

    radius: float = field(default=0.075, metadata=positive("m"))
    resolution: float = field(default=1e-5, metadata=positive("m"))
    viscosity: float = field(default=15.0, metadata=from_to(0.0, DAMPING_LIMIT, "N s/m"))

    def reach(self, position: Vector3) -> Vector3:
        """The position (3,) [m], brought back to the edge of the workspace if it is outside."""
        x, y, z = position
        distance = math.sqrt(x * x + y * y + z * z)
        if distance <= self.radius:
            return position
        share = self.radius / distance
        return share * x, share * y, share * z


class Encoder:
    """Readings of a handle over a run; read() once a cycle."""

    def __init__(self, device: Omega7, period: float) -> None:
        """A reading every ``period`` [s]."""
        self._resolution, self._period = device.resolution, period
        window = max(1, round(VELOCITY_WINDOW / period))
        self._readings: deque[Vector3] = deque(maxlen=window + 1)

    def read(self, position: Vector3) -> DeviceState:
        """What the device says of a handle at ``position`` (3,) [m]."""
        r, readings = self._resolution, self._readings
        x, y, z = (
            r * round(position[0] / r),
            r * round(position[1] / r),
            r * round(position[2] / r),
        )
        readings.append((x, y, z))
        span = self._period * (len(readings) - 1)
        if span == 0.0:
            return DeviceState((x, y, z))
        a, b, c = readings[0]
        return DeviceState((x, y, z), ((x - a) / span, (y - b) / span, (z - c) / span))
