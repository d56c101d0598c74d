"""The way round an obstacle."""

from __future__ import annotations

import math

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.references.operators.camera_task import clearance
from rcmqp.world.instrument import Vector3
from rcmqp.world.obstacles import Sphere

CUT = 0.9
"""Share of the distance that start and goal have, up to which a way can keep its own."""

PARTS = np.linspace(0.0, 1.0, 33)[:, None]
"""Places of a way that are looked at, as parts of it."""


def passing(start: Vector3, goal: Vector3, obstacle: Sphere) -> Array:
    """How far (n,) [m] the shaft's axis is from the obstacle's centre along a straight way.

    From the first place to the last; the shaft is all of it that is inside, trocar to tip.

    Args:
        start: (3,) of the tip, seen from the trocar, z into the patient [m].
        goal: (3,) likewise.
        obstacle: likewise.
    """
    first = np.array(start)
    tip = first + PARTS * (np.array(goal) - first)
    return clearance(tip, np.zeros_like(tip), obstacle) + obstacle.radius


def is_clear(start: Vector3, goal: Vector3, obstacle: Sphere, distance: float) -> bool:
    """Whether the shaft keeps its distance [m] from the obstacle's centre on the straight way.

    A way cannot keep more than its ends have; the distance is cut to CUT times that. A way that
    leads away from the obstacle is clear.
    """
    away = passing(start, goal, obstacle)
    nearest = int(np.argmin(away))
    return nearest == 0 or bool(away[nearest] >= _kept(start, goal, obstacle, distance))


def via_point(start: Vector3, goal: Vector3, obstacle: Sphere, distance: float) -> Vector3 | None:
    """Where to go first so that the straight ways keep their distance; None if one way does.

    The point is off the middle between start and goal, in equal parts towards the axis through
    the trocar, on which the camera started, and back out of the patient: withdrawn, the camera
    sees more.

    Args:
        start: (3,) seen from the trocar, z into the patient [m].
        goal: (3,) likewise [m]; as far from the obstacle as the start, or nearly.
        obstacle: likewise.
        distance: wanted from the obstacle's centre [m]; cut as in is_clear().
    """
    if is_clear(start, goal, obstacle, distance):
        return None
    distance = _kept(start, goal, obstacle, distance)
    room = math.dist(start, obstacle.centre)
    aside = room * distance / math.sqrt(room**2 - distance**2)
    x, y, z = ((s + g) / 2.0 for s, g in zip(start, goal, strict=True))
    off = math.hypot(x, y)
    if off < 1e-9:
        return x, y, z - aside
    part = aside / math.sqrt(2.0)
    return x * (1.0 - part / off), y * (1.0 - part / off), z - part


def _kept(start: Vector3, goal: Vector3, obstacle: Sphere, distance: float) -> float:
    """The distance [m] that a way between two points can keep."""
    room = min(math.dist(start, obstacle.centre), math.dist(goal, obstacle.centre))
    return min(distance, CUT * room)
