"""The hand on the handle: arm, tremor and the device's viscosity."""

from __future__ import annotations

import math

import numpy as np

from rcmqp.references.operators.omega7 import Omega7
from rcmqp.references.operators.operator import Operator
from rcmqp.references.operators.tremor import Tremor
from rcmqp.world.instrument import Vector3


class Hand:
    """Follows where it is meant to be, as an arm does, shaking.

    With c where it is meant to be, n the tremor and B the device's viscosity, each axis obeys

        m h'' = K (c + n - h) - (D + B) h',

    solved exactly over a period with c + n held. The tremor is such that the free hand, B = 0,
    shakes with the operator's rms at the tremor's frequency: a viscous device damps it.
    """

    def __init__(
        self, operator: Operator, device: Omega7, period: float, rng: np.random.Generator
    ) -> None:
        """At rest where the device has its handle."""
        m, K, D = operator.mass, operator.stiffness, operator.damping
        self._steps = _discrete(K / m, (D + device.viscosity) / m, period)
        w = 2.0 * math.pi * operator.tremor_frequency
        self._shake = operator.tremor * abs(complex(K - m * w**2, D * w)) / K
        self._tremor = Tremor(operator.tremor_frequency, operator.tremor_damping, period, rng)
        self._device = device
        self.position: Vector3 = (0.0, 0.0, 0.0)
        self.velocity: Vector3 = (0.0, 0.0, 0.0)

    def step(self, meant: Vector3) -> Vector3:
        """Where the hand (3,) [m] is a period later; ``meant`` (3,) [m] is c until then."""
        (a, b, c), (d, e, f) = self._steps
        shake, tremor = self._shake, self._tremor.step()
        position, velocity = [], []
        for i in range(3):
            h, v, u = self.position[i], self.velocity[i], meant[i] + shake * tremor[i]
            position.append(a * h + b * v + c * u)
            velocity.append(d * h + e * v + f * u)
        free = (position[0], position[1], position[2])
        self.position = self._device.reach(free)
        self.velocity = (velocity[0], velocity[1], velocity[2])
        if self.position is not free:
            self.velocity = _inwards(self.velocity, self.position)
        return self.position


def _inwards(velocity: Vector3, position: Vector3) -> Vector3:
    """A velocity (3,) at the workspace's edge, without its part beyond the edge."""
    distance = math.hypot(*position)
    x, y, z = (p / distance for p in position)
    out = max(0.0, x * velocity[0] + y * velocity[1] + z * velocity[2])
    return velocity[0] - out * x, velocity[1] - out * y, velocity[2] - out * z


def _discrete(stiffness: float, damping: float, period: float) -> tuple[Vector3, Vector3]:
    """Coefficients of position, velocity and input in position and velocity a period later.

    Of h'' = stiffness (u - h) - damping h', by the exponential of its matrix.
    """
    from scipy.linalg import expm  # SciPy takes long to import

    A = np.array([[0.0, 1.0, 0.0], [-stiffness, -damping, stiffness], [0.0, 0.0, 0.0]])
    first, second, _ = expm(A * period).tolist()
    return tuple(first), tuple(second)
