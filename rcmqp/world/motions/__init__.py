"""Motions of the trocar: breathing, and anything else that moves the abdominal wall.

A motion is a frozen dataclass of plain numbers, so that a scenario can be written as JSON; a
new one is a class with ``position()`` and ``velocity()``, added to MOTIONS or by a plug-in.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from rcmqp.maths.dualquaternion import Array
from rcmqp.world.motions.breathing import Breathing
from rcmqp.world.motions.sampled import Sampled
from rcmqp.world.motions.sinusoid import Sinusoid
from rcmqp.world.motions.still import Still
from rcmqp.world.plugins import Registry


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

__all__ = ["MOTIONS", "Breathing", "Motion", "Sampled", "Sinusoid", "Still"]
