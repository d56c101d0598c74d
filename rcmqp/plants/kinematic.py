"""The ideal arm: each joint does at once what it is told, and is measured exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.plants.base import Drive
from rcmqp.world.arm import Arm


@dataclass(frozen=True, slots=True)
class Kinematic:
    """Joints that are velocity sources; v now is what was commanded last."""

    def start(self, arm: Arm, q: Array, period: float, seed: int) -> Drive:
        """See Plant.start(); nothing here is random."""
        return KinematicDrive(arm, q, period)


class KinematicDrive:
    """See Drive."""

    def __init__(self, arm: Arm, q: Array, period: float) -> None:
        """At rest at q (nq,)."""
        self.q, self.v = q, np.zeros(arm.nv)
        self._arm, self._period = arm, period

    def measure(self) -> tuple[Array, Array]:
        """Q and v themselves."""
        return self.q, self.v

    def step(self, v: Array) -> None:
        """Move by v times the period."""
        self.q, self.v = self._arm.integrate(self.q, v, self._period), np.array(v)
