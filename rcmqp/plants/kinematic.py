"""What every plant is, and the ideal one: each joint does at once what it is told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm


class Drive(Protocol):
    """The joints of one run.

    Attributes:
        q: (nq,) where they are: Pinocchio's configuration.
        v: (nv,) how fast they move now [rad/s].
    """

    q: Array
    v: Array

    def measure(self) -> tuple[Array, Array]:
        """What the controller sees of q (nq,) and v (nv,); to be called once a cycle."""

    def step(self, v: Array) -> None:
        """Go on for one period with the commanded velocity ``v`` (nv,) [rad/s]."""


@runtime_checkable
class Plant(Protocol):
    """A kind of joint drives."""

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
        """Q and v themselves."""
        return self.q, self.v

    def step(self, v: Array) -> None:
        """Move by v times the period."""
        self.q, self.v = self._arm.integrate(self.q, v, self._period), np.array(v)
