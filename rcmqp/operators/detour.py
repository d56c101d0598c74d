"""The way round an obstacle."""

from __future__ import annotations

import math

from rcmqp.instrument import Vector3
from rcmqp.scene import Sphere

CUT = 0.9
"""Share of the distance that start and goal have, up to which a way can keep its own."""


def is_clear(start: Vector3, goal: Vector3, obstacle: Sphere, distance: float) -> bool:
    """Whether the straight way keeps its distance [m] from the obstacle's centre.

    A way cannot keep more than its ends have; the distance is cut to CUT times that.
    """
    way = [g - s for s, g in zip(start, goal, strict=True)]
    seen = [c - s for s, c in zip(start, obstacle.centre, strict=True)]
    length = math.hypot(*way)
    along = sum(w * c for w, c in zip(way, seen, strict=True)) / max(length, 1e-12)
    if not 0.0 < along < length:
        return True
    off = math.sqrt(max(math.hypot(*seen) ** 2 - along**2, 0.0))
    return off >= _kept(start, goal, obstacle, distance)


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
