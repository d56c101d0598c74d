"""Plants: what the commanded joint velocity drives, and what is measured of it.

A plant is a frozen dataclass of plain numbers, so that a scenario can be written as JSON; its
start() makes the drive of one run, which holds everything that changes. A new one is such a
pair, the plant added to PLANTS.
"""

from __future__ import annotations

from rcmqp.plants.base import Drive, Plant
from rcmqp.plants.kinematic import Kinematic
from rcmqp.plants.servo import Servo

PLANTS: dict[str, type[Plant]] = {"kinematic": Kinematic, "servo": Servo}

__all__ = ["PLANTS", "Drive", "Kinematic", "Plant", "Servo"]
