"""Motions of the trocar: breathing, and anything else that moves the abdominal wall.

A motion is a frozen dataclass of plain numbers, so that a scenario can be written as JSON; a
new one is a class with ``position()`` and ``velocity()``, added to MOTIONS or by a plug-in.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import at_least, options, positive, rule, whole
from rcmqp.maths.smooth import step
from rcmqp.world.instrument import Vector3, unit_vector3, vector3
from rcmqp.world.plugins import Registry


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


LATE = 1e5
"""First time that is taken for a clock of the recording's own [s]: a day and more."""


def sample_times(name: str, values: Iterable[float]) -> tuple[float, ...]:
    """Times of samples as a tuple [s].

    Raises:
        OptionError: there are fewer than two, or they are not finite, from 0 on, and growing.
    """
    times = _times(values)
    if len(times) < 2:
        raise OptionError(f"{len(times)} {name}; a motion needs two or more")
    if times[0] < 0.0 or times[0] > LATE:
        raise OptionError(
            f"{name}[0] = {times[0]:.12g} s; times count from the run's start, at 0 s: give "
            "times - times[0] where the recording has a clock of its own"
        )
    steps = np.diff(times)
    if not (np.isfinite(times).all() and times[0] >= 0.0 and (steps > 0.0).all()):
        wrong = int(np.argmin(steps > 0.0)) + 1
        raise OptionError(
            f"{name} must be finite, from 0 on, and grow: see "
            f"{name}[{wrong}] = {times[wrong]} s after {times[wrong - 1]} s; sort the samples "
            "and drop those that were taken twice"
        )
    return times


def sample_positions(name: str, values: Iterable[ArrayLike]) -> tuple[Vector3, ...]:
    """Positions of samples as tuples [m].

    Raises:
        OptionError: one is not three finite numbers.
    """
    return tuple(vector3(f"{name}[{i}]", value) for i, value in enumerate(values))


@options
@dataclass(frozen=True, slots=True)
class Sampled:
    """A motion through measured positions, from rest to rest.

    A cubic Hermite spline: the velocity is continuous, at an inner sample that of the parabola
    through it and its two neighbours, at the first and the last one zero. Before the first
    sample the trocar is there, after the last one it stays there.

    Attributes:
        times: (n,) [s], from 0 on, each later than the one before; n >= 2.
        positions: (n, 3) in the world's axes [m], counted from anywhere: it is the way from
            the first one that counts.
    """

    times: tuple[float, ...] = field(metadata=rule(sample_times))
    positions: tuple[Vector3, ...] = field(metadata=rule(sample_positions))

    def __post_init__(self) -> None:
        if len(self.times) != len(self.positions):
            raise OptionError(
                f"{len(self.times)} times and {len(self.positions)} positions; give as many of "
                "the one as of the other"
            )

    def position(self, t: float) -> Array:
        """Offset (3,) at ``t`` [s] from the pivot at 0 [m]."""
        i, h, u = self._interval(t)
        p, q = np.array(self.positions[i]), np.array(self.positions[i + 1])
        m, n = h * self._slope(i), h * self._slope(i + 1)
        between = u**2 * (3.0 - 2.0 * u) * (q - p) + u * (1.0 - u) * ((1.0 - u) * m - u * n)
        offset: Array = p - np.array(self.positions[0]) + between
        return offset

    def velocity(self, t: float) -> Array:
        """Its derivative (3,) [m/s]."""
        i, h, u = self._interval(t)
        secant = (np.array(self.positions[i + 1]) - np.array(self.positions[i])) / h
        m, n = self._slope(i), self._slope(i + 1)
        along: Array = 6.0 * u * (1.0 - u) * secant
        return along + (1.0 - u) * (1.0 - 3.0 * u) * m - u * (2.0 - 3.0 * u) * n

    def _interval(self, t: float) -> tuple[int, float, float]:
        """The samples i and i + 1 around ``t``, their distance h [s], and where t is, 0 to 1."""
        t = min(max(t, self.times[0]), self.times[-1])
        i = min(bisect.bisect_right(self.times, t), len(self.times) - 1) - 1
        h = self.times[i + 1] - self.times[i]
        return i, h, (t - self.times[i]) / h

    def _slope(self, i: int) -> Array:
        """Velocity (3,) at sample i [m/s]."""
        if i in (0, len(self.times) - 1):
            return np.zeros(3)
        before, after = self.times[i] - self.times[i - 1], self.times[i + 1] - self.times[i]
        here = np.array(self.positions[i])
        arriving = (here - np.array(self.positions[i - 1])) / before
        leaving = (np.array(self.positions[i + 1]) - here) / after
        slope: Array = (after * arriving + before * leaving) / (before + after)
        return slope


def _times(given: object) -> tuple[float, ...]:
    """Times as plain numbers."""
    try:
        times = np.asarray(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise OptionError(f"times must be numbers in a row: {error}") from error
    if times.ndim != 1:
        raise OptionError(f"times has shape {times.shape}, it must be (n,); try times.ravel()")
    return tuple(times.tolist())


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


@dataclass(frozen=True, slots=True)
class Still:
    """Always where it was."""

    def position(self, t: float) -> Array:
        """Zero (3,) [m]."""
        return np.zeros(3)

    def velocity(self, t: float) -> Array:
        """Zero (3,) [m/s]."""
        return np.zeros(3)


@runtime_checkable
class Motion(Protocol):
    """Where the trocar is over time; at rest until 0."""

    def position(self, t: float) -> Array:
        """Offset (3,) at ``t`` [s] from the pivot at 0, in the world's axes [m]."""

    def velocity(self, t: float) -> Array:
        """Its derivative (3,) [m/s]."""


_OWN: dict[str, type[Motion]] = {
    "breathing": Breathing,
    "sampled": Sampled,
    "sinusoid": Sinusoid,
    "still": Still,
}

MOTIONS: Registry[Motion] = Registry("rcmqp.motions", _OWN)
