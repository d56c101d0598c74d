"""Things in the patient that the instrument is to keep out of."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import options, positive, rule
from rcmqp.world.instrument import Vector3, vector3


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


def clearance(tip: Array, mount: Array, sphere: Sphere) -> Array:
    """Distance (n,) of a sphere's surface from the axis between two ends of an instrument [m].

    Negative inside the sphere. The instrument's radius is not counted.

    Args:
        tip: (n, 3) in the sphere's axes [m].
        mount: (n, 3) the axis's other end [m].
        sphere: [m].
    """
    shaft, seen = mount - tip, np.array(sphere.centre) - tip
    along = np.sum(seen * shaft, axis=-1) / np.sum(shaft * shaft, axis=-1)
    nearest = np.clip(along, 0.0, 1.0)[..., None] * shaft
    return np.asarray(np.linalg.norm(seen - nearest, axis=-1) - sphere.radius)
