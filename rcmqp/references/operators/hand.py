"""The hand at the device: aimed movements, tremor, and a handle like the paper's Omega.7."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths.options import from_to, options, positive
from rcmqp.maths.smooth import step
from rcmqp.references.hand import DeviceState
from rcmqp.references.operators.population import Operator
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
    """Reads a handle during a run; call read() once in each cycle."""

    def __init__(self, device: Omega7, period: float) -> None:
        """A reading every ``period`` [s]."""
        self._resolution, self._period = device.resolution, period
        window = max(1, round(VELOCITY_WINDOW / period))
        self._readings: deque[Vector3] = deque(maxlen=window + 1)

    def read(self, position: Vector3) -> DeviceState:
        """The device's reading of a handle at ``position`` (3,) [m]."""
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


PEAK = 1.875
"""Highest over mean speed of 10u^3 - 15u^4 + 6u^5: a bell."""

UNIT = 1e-3
"""Length of a submovement that is one bit [m]."""


def duration(operator: Operator, length: float) -> float:
    """How long a submovement of ``length`` [m] takes [s].

    max(shortest, a + b log2(1 + length / 1 mm), 1.875 length / speed): Fitts' law, unless that
    is quicker than the operator cares to move.
    """
    fitts = operator.fitts_intercept + operator.fitts_slope * math.log2(1.0 + length / UNIT)
    return max(operator.shortest, fitts, PEAK * length / operator.speed)


@dataclass(frozen=True, slots=True)
class Submovement:
    """Minimum jerk (Flash and Hogan 1985): start + way (10u^3 - 15u^4 + 6u^5).

    Attributes:
        start: (3,) where it begins [m].
        way: (3,) where it goes from there [m].
        begin: when [s].
        duration: [s].
    """

    start: Vector3
    way: Vector3
    begin: float
    duration: float

    def position(self, t: float) -> Vector3:
        """Where the hand (3,) [m] is meant to be at ``t`` [s]."""
        s, _ = step((t - self.begin) / self.duration)
        (a, b, c), (x, y, z) = self.start, self.way
        return a + s * x, b + s * y, c + s * z


BLOCK = 1024
"""Draws taken at a time."""

TICK = 1e-3
"""Between two values of the tremor [s], whatever the sampling period: a person's tremor does not
depend on the controller's."""


class Tremor:
    """A number for each cycle and axis, with standard deviation 1 and its peak at a frequency.

    A damped oscillator x'' + 2 zeta w x' + w^2 x driven by white noise, sampled: with
    p = exp((-zeta + i sqrt(1 - zeta^2)) w T),

        x(k) = 2 Re(p) x(k-1) - |p|^2 x(k-2) + e(k),   n(k) = s (x(k) - x(k-1)),

    s such that n has unit variance. The difference leaves nothing at low frequencies, to which
    an arm gives way more than to tremor. It starts at rest.
    """

    def __init__(
        self, frequency: float, damping: float, period: float, rng: np.random.Generator
    ) -> None:
        """At ``frequency`` [Hz] with damping ratio zeta, looked at every ``period`` [s].

        Raises:
            OptionError: the period is too long to sample the frequency.
        """
        if not frequency * period < 0.5:
            raise OptionError(
                f"a period of {period} s cannot show a tremor of {frequency} Hz; make it "
                f"shorter than {0.5 / frequency:.3g} s"
            )
        turn = 2.0 * math.pi * frequency * TICK
        size, angle = math.exp(-damping * turn), math.sqrt(1.0 - damping**2) * turn
        self._a, self._b = 2.0 * size * math.cos(angle), -(size**2)
        a, b = self._a, self._b
        variance = (1.0 - b) / ((1.0 + b) * ((1.0 - b) ** 2 - a**2))  # of x
        self._scale = 1.0 / math.sqrt(2.0 * variance * (1.0 - a / (1.0 - b)))
        self._now, self._before = [0.0] * 3, [0.0] * 3
        self._rng, self._period = rng, period
        self._steps, self._ticks = 0, 0
        self._drawn: Iterator[list[float]] = iter(())

    def step(self) -> list[float]:
        """The value of each of the three axes a period later."""
        self._steps += 1
        due = int(self._steps * self._period / TICK + 1e-6)
        while self._ticks < due:
            self._tick()
        return [now - before for now, before in zip(self._now, self._before, strict=True)]

    def _tick(self) -> None:
        """One value further."""
        drawn = next(self._drawn, None)
        if drawn is None:
            noise = self._scale * self._rng.normal(size=(BLOCK, 3))
            self._drawn = iter(noise.tolist())
            drawn = next(self._drawn)
        a, b, now, before = self._a, self._b, self._now, self._before
        after = [a * now[i] + b * before[i] + drawn[i] for i in range(3)]
        self._before, self._now = now, after
        self._ticks += 1


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
    """One period of h'' = stiffness (u - h) - damping h', exact for a constant input u.

    Returns:
        The coefficients of (h, h', u) in h, and those in h', one period later; both come from the
        matrix exponential.
    """
    from scipy.linalg import expm  # SciPy takes long to import

    A = np.array([[0.0, 1.0, 0.0], [-stiffness, -damping, stiffness], [0.0, 0.0, 0.0]])
    first, second, _ = expm(A * period).tolist()
    return tuple(first), tuple(second)
