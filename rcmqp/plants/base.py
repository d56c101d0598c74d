"""What every plant is."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

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
