"""Things in the patient that the instrument is to keep out of."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import options, positive, rule
from rcmqp.world.instrument import Instrument, Vector3, vector3


@options
@dataclass(frozen=True, slots=True)
class Sphere:
    """A ball that stands still in the world.

    Attributes:
        centre: (3,) [m].
        radius: [m].
    """

    centre: Vector3 = field(metadata=rule(vector3))
    radius: float = field(metadata=positive("m"))


def clearance(
    obstacles: Iterable[Sphere], instrument: Instrument, tip: ArrayLike, axis: ArrayLike
) -> Array:
    """How far (...) the instrument, from mount to tip, is from the nearest obstacle [m].

    From surface to surface; negative inside an obstacle, inf without obstacles.

    Args:
        obstacles: any number.
        instrument: a capsule.
        tip: (..., 3) in the world [m].
        axis: (..., 3) unit vector along the shaft, into the patient, in the world.
    """
    tip, axis = np.asarray(tip, dtype=float), np.asarray(axis, dtype=float)
    least = np.full(tip.shape[:-1], np.inf)
    for obstacle in obstacles:
        seen = np.array(obstacle.centre) - tip
        along = np.clip(np.sum(seen * axis, axis=-1), -instrument.length, 0.0)
        distance = np.linalg.norm(seen - along[..., None] * axis, axis=-1)
        least = np.minimum(least, distance - obstacle.radius - instrument.radius)
    return least
