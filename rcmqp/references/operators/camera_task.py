"""The task of experiment B: four views to be found with the camera, past an obstacle."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import options, positive, rule
from rcmqp.references.paths import Search
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Vector3, unit_vector3
from rcmqp.world.obstacles import Sphere

AHEAD = (0.0, 0.0, 1.0)
"""Along the shaft."""

CORNERS = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
"""Of the square, in the order of the objectives: left or right, above or below in the image."""


@options
@dataclass(frozen=True, slots=True)
class CameraTask:
    """Coloured spheres, the camera positions that show them as asked for, and an obstacle.

    Everything is seen from the trocar in the axes of x_d(0), x to the right and y down in the
    first image of a camera that looks along the shaft, z into the patient. The views have no
    roll, so where the camera is decides what it shows. The paper gives the square's side, the
    tolerance, that the spheres are of one radius and the obstacle is big and between objectives
    2 and 3; the rest is chosen here.

    Attributes:
        side: of the square of spheres [m]; the paper's 5 cm.
        target_depth: distance of the objectives' plane from the trocar [m]: as deep as the helix
            of experiment A goes, where the corners need a tilt of 14.2 deg.
        standoff: from that plane to the spheres' [m]: a close-up in which the sphere fills a
            sixth of the image's width and the others are out of sight, so that each view is a
            view of one sphere.
        sphere_radius: [m]; seen from the start it is as wide as a fingertip at arm's length.
        obstacle_radius: of the big sphere, mid-way between objectives 2 and 3 [m]: twice that of
            the others. Its surface is 17 mm from the camera at either, and that is the most that
            the least distance of a trial can be; the paper's was 12.52 mm with a deviation of 5.
        tolerance: distance from an objective at which it counts as reached [m]; the paper's 1 mm.
        towards: (3,) unit vector from each objective to its sphere: where the camera looks at the
            start. load_scenario() sets it for a camera that looks to the side.
    """

    side: float = field(default=0.05, metadata=positive("m"))
    target_depth: float = field(default=0.14, metadata=positive("m"))
    standoff: float = field(default=0.035, metadata=positive("m"))
    sphere_radius: float = field(default=0.004, metadata=positive("m"))
    obstacle_radius: float = field(default=0.008, metadata=positive("m"))
    tolerance: float = field(default=1e-3, metadata=positive("m"))
    towards: Vector3 = field(default=AHEAD, metadata=rule(unit_vector3))

    def __post_init__(self) -> None:
        if not self.obstacle_radius < self.side / 2.0 - self.tolerance:
            raise OptionError(
                f"obstacle_radius = {self.obstacle_radius} m reaches the objectives beside it, "
                f"{self.side / 2.0} m from its centre; make it smaller"
            )

    @property
    def targets(self) -> tuple[Vector3, ...]:
        """Where the camera is to be, (4, 3) [m], in the order asked for."""
        half = self.side / 2.0
        return tuple((x * half, y * half, self.target_depth) for x, y in CORNERS)

    @property
    def spheres(self) -> tuple[Sphere, ...]:
        """The coloured spheres, each beyond its target."""
        a, b, c = (self.standoff * share for share in self.towards)
        return tuple(Sphere((x + a, y + b, z + c), self.sphere_radius) for x, y, z in self.targets)

    @property
    def obstacle(self) -> Sphere:
        """The big sphere between the second and the third objective."""
        (_, second, third, _) = self.targets
        x, y, z = ((a + b) / 2.0 for a, b in zip(second, third, strict=True))
        return Sphere((x, y, z), self.obstacle_radius)


def reached(times: Array, tip: Array, targets: Array, tolerance: float) -> Array:
    """When each target was reached, in their order, (m,) [s]; NaN for those that were not.

    One sampling instant counts for one target at most.

    Args:
        times: (n,) [s].
        tip: (n, 3) [m].
        targets: (m, 3), in the same axes [m].
        tolerance: [m].
    """
    found, start = np.full(len(targets), np.nan), 0
    for i, target in enumerate(targets):
        near = np.linalg.norm(tip[start:] - target, axis=-1) <= tolerance
        if not near.any():
            break
        start += int(np.argmax(near)) + 1
        found[i] = times[start - 1]
    return found


class Goals:
    """Which places were reached, and when, noted while the tip moves; see reached().

    Attributes:
        places: (m, 3) in the world [m].
        reached: when each was, as far as they were [s].
    """

    def __init__(self, places: Array, tolerance: float) -> None:
        """Start with no goal reached; a goal counts as reached within ``tolerance`` [m] of it."""
        self.places, self.reached = places, list[float]()
        self._tolerance = tolerance

    @classmethod
    def of(cls, task: Search, insertion: Insertion) -> Self:
        """Those of a task, for a trocar that stands still."""
        ways = np.array([insertion.from_start(place) for place in task.places])
        return cls(ways + np.array(insertion.trocar.pivot), task.tolerance)

    @property
    def done(self) -> bool:
        """Whether there were any, and all are reached."""
        return 0 < len(self.places) == len(self.reached)

    @property
    def left(self) -> bool:
        """Whether there is one that is not reached."""
        return len(self.reached) < len(self.places)

    def see(self, t: float, tip: Array) -> None:
        """The tip (3,) is in the world [m] at ``t`` [s]; one place at most is reached then."""
        k = len(self.reached)
        if k < len(self.places) and np.linalg.norm(tip - self.places[k]) <= self._tolerance:
            self.reached.append(t)
