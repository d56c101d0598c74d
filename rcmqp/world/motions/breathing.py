"""A trocar in the abdominal wall of a patient who is ventilated."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import at_least, options, positive, rule, whole
from rcmqp.world.instrument import Vector3, unit_vector3


@options
@dataclass(frozen=True, slots=True)
class Breathing:
    """Breath after breath, all alike, longer near the end of expiration than of inspiration.

        position(t) = amplitude sin^(2n)(pi rate t) direction

    The profile z_0 - b cos^(2n)(pi t / tau - phi) of Lujan et al. (Medical Physics 26, 1999,
    715-720) with phi = pi / 2, so that it starts from rest at the end of an expiration. For
    n = 1 it is a sine; the larger n is, the longer the wall rests between two breaths.

    The defaults are a patient under a ventilator, 15 breaths a minute, with a port that moves
    by 1 cm, the upper end of the 2 to 10 mm that are said of abdominal ports.

    Attributes:
        amplitude: from the end of expiration to that of inspiration [m].
        rate: breaths per second [Hz].
        direction: (3,) in the world, where inspiration moves the trocar: along the normal of
            the wall, outwards; of any length but zero, kept as a unit vector.
        n: exponent, a whole number of at least 1.
    """

    amplitude: float = field(default=0.01, metadata=at_least(0.0, "m"))
    rate: float = field(default=0.25, metadata=positive("Hz"))
    direction: Vector3 = field(default=(0.0, 0.0, 1.0), metadata=rule(unit_vector3))
    n: int = field(default=3, metadata=whole(1))

    def position(self, t: float) -> Array:
        """Offset (3,) at ``t`` [s] from the pivot at 0 [m]."""
        sine = math.sin(math.pi * self.rate * max(t, 0.0))
        return self.amplitude * sine ** (2 * self.n) * np.array(self.direction)

    def velocity(self, t: float) -> Array:
        """Its derivative (3,) [m/s]."""
        omega, n = math.pi * self.rate, self.n
        sine, cosine = math.sin(omega * max(t, 0.0)), math.cos(omega * max(t, 0.0))
        rate = 2 * n * omega * sine ** (2 * n - 1) * cosine
        return self.amplitude * rate * np.array(self.direction)
