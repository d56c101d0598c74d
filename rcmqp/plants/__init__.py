"""Plants: what the commanded joint velocity drives, and what is measured of it.

A plant is a frozen dataclass of plain numbers, so that a scenario can be written as JSON; its
start() makes the drive of one run, which holds everything that changes. A new one is such a
pair, the plant added to PLANTS or by a plug-in.
"""

from __future__ import annotations

from rcmqp.plants.kinematic import Drive, Kinematic, Plant
from rcmqp.plants.servo import Servo
from rcmqp.world.plugins import Registry

_OWN: dict[str, type[Plant]] = {"kinematic": Kinematic, "servo": Servo}

PLANTS: Registry[Plant] = Registry("rcmqp.plants", _OWN)

__all__ = ["PLANTS", "Drive", "Kinematic", "Plant", "Servo"]
