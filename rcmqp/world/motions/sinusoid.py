"""A trocar that swings to and fro: the motions of the paper's follow-up."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import at_least, options, positive, rule
from rcmqp.maths.smooth import step
from rcmqp.world.instrument import Vector3, unit_vector3


@options
@dataclass(frozen=True, slots=True)
class Sinusoid:
    """A swing along a line, whose amplitude grows smoothly from zero.

        position(t) = amplitude w(t / ramp) sin(2 pi frequency t) direction

    with w(u) = 10u^3 - 15u^4 + 6u^5 up to u = 1, and 1 from there on: the trocar starts from
    rest, without a jolt. Marinho, Bernardes and Bo (Journal of Medical Robotics Research 2016)
    moved a trocar by 1 cm at 0.5 Hz, 2 cm at 0.5 Hz and 1 cm at 1 Hz.

    Attributes:
        amplitude: from the middle to the turning point [m].
        frequency: [Hz].
        direction: (3,) in the world, of any length but zero; kept as a unit vector.
        ramp: how long the amplitude grows [s].
    """

    amplitude: float = field(default=0.01, metadata=at_least(0.0, "m"))
    frequency: float = field(default=0.5, metadata=positive("Hz"))
    direction: Vector3 = field(default=(0.0, 0.0, 1.0), metadata=rule(unit_vector3))
    ramp: float = field(default=2.0, metadata=positive("s"))

    def position(self, t: float) -> Array:
        """Offset (3,) at ``t`` [s] from the pivot at 0 [m]."""
        grown, _ = step(t / self.ramp)
        swing = math.sin(2.0 * math.pi * self.frequency * t)
        return self.amplitude * grown * swing * np.array(self.direction)

    def velocity(self, t: float) -> Array:
        """Its derivative (3,) [m/s]."""
        grown, growing = step(t / self.ramp)
        omega = 2.0 * math.pi * self.frequency
        rate = growing / self.ramp * math.sin(omega * t) + grown * omega * math.cos(omega * t)
        return self.amplitude * rate * np.array(self.direction)
