"""Plants: what the commanded joint velocity drives, and what is measured of it.

A plant is a frozen dataclass of plain numbers, so that a scenario can be written as JSON. Its
start() makes the drive of one run, which holds everything that changes. A new plant is such a
pair; the plant is added to PLANTS, or by a plug-in.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
import pinocchio as pin

from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import at_least, options, or_none, whole
from rcmqp.world.arm import Arm
from rcmqp.world.plugins import Registry


class Drive(Protocol):
    """The joints of an arm during one run.

    Attributes:
        q: (nq,) where they are: Pinocchio's configuration.
        v: (nv,) how fast they move now [rad/s].
    """

    q: Array
    v: Array

    def measure(self) -> tuple[Array, Array]:
        """Measure q (nq,) and v (nv,) as the controller sees them; call it once in each cycle."""

    def step(self, v: Array) -> None:
        """Go on for one period with the commanded velocity ``v`` (nv,) [rad/s]."""


@runtime_checkable
class Plant(Protocol):
    """A model of joint drives; start() makes the drive of one run."""

    def start(self, arm: Arm, q: Array, period: float, seed: int) -> Drive:
        """The joints of ``arm``, at rest at ``q`` (nq,), commanded every ``period`` [s].

        Equal arguments give drives that do the same to the bit.
        """


@dataclass(frozen=True, slots=True)
class Kinematic:
    """Joints that are velocity sources; v now is what was commanded last."""

    def start(self, arm: Arm, q: Array, period: float, seed: int) -> Drive:
        """See Plant.start(); nothing here is random."""
        return KinematicDrive(arm, q, period)


class KinematicDrive:
    """See Drive."""

    def __init__(self, arm: Arm, q: Array, period: float) -> None:
        self.q, self.v = q, np.zeros(arm.nv)
        self._arm, self._period = arm, period

    def measure(self) -> tuple[Array, Array]:
        """Return q and v themselves."""
        return self.q, self.v

    def step(self, v: Array) -> None:
        """Move by v times the period."""
        self.q, self.v = self._arm.integrate(self.q, v, self._period), np.array(v)


@options
@dataclass(frozen=True, slots=True)
class Servo:
    """Joints under velocity servos; each option by itself is off by default.

    With u the velocity commanded ``delay`` periods ago, cut at the arm's speed limits, each
    joint obeys

        dv/dt = (u - v) / time_constant,   |dv/dt| <= the arm's acceleration limit,

    solved exactly over a period. An encoder adds noise to the joint's angle and rounds the sum
    to its nearest count; the velocity that the controller sees is the difference of the last
    two readings over the period, through a first-order filter. It is late by half a period and
    the filter's time, and as coarse as counts and noise over the period make it.

    Attributes:
        time_constant: of the velocity loop [s].
        delay: from command to effect, in whole periods.
        counts_per_turn: of an encoder on the joint's side; of a joint that slides, per 2 pi m.
            None reads without rounding.
        noise: rms of what is added to each reading [rad], Gaussian, independent between joints
            and readings.
        velocity_filter: time constant of the filter on the measured velocity [s].
        velocity_saturation: cut u at the arm's speed limits.
        acceleration_saturation: keep the arm's acceleration limits, where it has any.
    """

    time_constant: float = field(default=0.0, metadata=at_least(0.0, "s"))
    delay: int = field(default=0, metadata=whole(0))
    counts_per_turn: int | None = field(default=None, metadata=or_none(whole(1)))
    noise: float = field(default=0.0, metadata=at_least(0.0, "rad"))
    velocity_filter: float = field(default=0.0, metadata=at_least(0.0, "s"))
    velocity_saturation: bool = False
    acceleration_saturation: bool = False

    def start(self, arm: Arm, q: Array, period: float, seed: int) -> Drive:
        """See Plant.start(); ``seed`` is that of the noise."""
        return ServoDrive(self, arm, q, period, seed)


class ServoDrive:
    """See Drive."""

    def __init__(self, servo: Servo, arm: Arm, q: Array, period: float, seed: int) -> None:
        self.q, self.v = q, np.zeros(arm.nv)
        self._servo, self._arm, self._period = servo, arm, period
        self._on_the_way = deque(np.zeros(arm.nv) for _ in range(servo.delay))
        self._rng = np.random.default_rng(seed)
        self._read: Array | None = None
        self._v_read = np.zeros(arm.nv)

    def measure(self) -> tuple[Array, Array]:
        """Read the encoders for q, and derive v from two readings."""
        servo, T, before = self._servo, self._period, self._read
        self._read = self._encoded()
        if before is not None:
            v = np.asarray(pin.difference(self._arm.model, before, self._read)) / T
            kept = math.exp(-T / servo.velocity_filter) if servo.velocity_filter else 0.0
            self._v_read = kept * self._v_read + (1.0 - kept) * v
        return self._read, self._v_read

    def step(self, v: Array) -> None:
        """Servo towards the velocity that was commanded ``delay`` periods ago."""
        self._on_the_way.append(np.array(v))
        u = self._on_the_way.popleft()
        if self._servo.velocity_saturation:
            u = np.clip(u, -self._arm.velocity, self._arm.velocity)
        a = np.full(self._arm.nv, np.inf)
        if self._servo.acceleration_saturation:
            a = self._arm.acceleration
        moved, self.v = first_order(self.v, u, self._servo.time_constant, a, self._period)
        self.q = self._arm.integrate(self.q, moved, 1.0)

    def _encoded(self) -> Array:
        servo = self._servo
        if servo.noise == 0.0 and servo.counts_per_turn is None:
            return self.q
        angles = self._arm.angles(self.q)
        angles = angles + self._rng.normal(scale=servo.noise, size=angles.size)
        if servo.counts_per_turn is not None:
            count = 2.0 * math.pi / servo.counts_per_turn
            angles = count * np.round(angles / count)
        return self._arm.configuration(angles)


def first_order(
    v: Array, u: Array, time_constant: float, acceleration: Array, period: float
) -> tuple[Array, Array]:
    """Way (n,) gone in a period and velocity (n,) after it, of first-order servos.

    While |u - v| is above a tau the joint is driven at a; from there on the difference decays
    as exp(-t / tau).

    Args:
        v: (n,) velocity at the start.
        u: (n,) velocity wanted throughout.
        time_constant: tau [s]; 0 for none.
        acceleration: (n,) a; inf for no limit.
        period: [s].
    """
    tau = time_constant
    gap, limited = u - v, np.isfinite(acceleration)
    a = np.where(limited, acceleration, 1.0) * np.sign(gap)
    t = np.where(limited, np.clip(np.abs(gap / np.where(a == 0.0, 1.0, a)) - tau, 0.0, period), 0)
    moved, v = (v + 0.5 * a * t) * t, v + a * t
    gap, left = u - v, period - t
    decay = np.exp(-left / tau) if tau > 0.0 else np.where(left > 0.0, 0.0, 1.0)
    return moved + u * left - tau * gap * (1.0 - decay), u - gap * decay


PLANTS: Registry[Plant] = Registry("rcmqp.plants", {"kinematic": Kinematic, "servo": Servo})
