"""The endoscope's image: a pinhole camera, and spheres as it shows them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import options, whole
from rcmqp.world.instrument import Camera
from rcmqp.world.obstacles import Sphere

AMBIENT = 0.25
"""Brightness of a surface that is seen edge-on; one that faces the camera's light has 1."""

BACKGROUND = (0.36, 0.14, 0.12)
"""Colour of the abdomen."""

NOTHING, OUTSIDE = -1, -2
"""What a pixel shows where there is no sphere, and outside of the round image."""


def camera_pose(x: ArrayLike, tip_depth: float, camera: Camera | None = None) -> Array:
    """Pose (..., 8) of the camera, at the tip, for effector poses x (..., 8).

    Args:
        x: effector poses.
        tip_depth: from the effector to the tip, along the shaft [m].
        camera: whose angle and roll count; without it, one that looks along the shaft.
    """
    at_tip = dq.mul(x, dq.from_translation([0.0, 0.0, tip_depth]))
    if camera is None:
        return at_tip
    turn = pin.SE3(camera.rotation, np.zeros(3))
    return dq.mul(at_tip, dq.from_se3(turn))


@options
@dataclass(frozen=True, slots=True)
class Pinhole:
    """A camera's round image, ``size`` pixels across.

    A point (X, Y, Z) in the camera's axes, Z > 0, is shown at

        (u, v) = (size / 2 + f X / Z, size / 2 + f Y / Z),   f = size / (2 tan(field of view / 2)),

    and the pixel in column i and row j covers u from i to i + 1 and v from j to j + 1.

    Attributes:
        camera: its field of view is the image's diameter.
        size: pixels across.
    """

    camera: Camera = field(default_factory=Camera)
    size: int = field(default=480, metadata=whole(1))

    @property
    def focal_length(self) -> float:
        """F [pixels]."""
        return self.size / (2.0 * math.tan(self.camera.field_of_view / 2.0))

    def project(self, points: ArrayLike) -> Array:
        """Where (..., 2) [pixels] the points (..., 3) [m] in the camera's axes are shown.

        NaN for points that are not in front of the camera.
        """
        points = np.asarray(points, dtype=float)
        front = points[..., 2:] > 0.0
        depth = np.where(front, points[..., 2:], np.nan)
        return self.size / 2.0 + self.focal_length * points[..., :2] / depth

    def rays(self) -> Array:
        """Unit vectors (size, size, 3) through the middles of the pixels, rows first."""
        middle = (np.arange(self.size) + 0.5 - self.size / 2.0) / self.focal_length
        x, y = np.meshgrid(middle, middle)
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    def seen(self, x_cam: ArrayLike, spheres: Sequence[Sphere]) -> tuple[NDArray[np.int_], Array]:
        """The nearest sphere on each pixel's ray.

        A ray d from the camera meets a sphere, centre c and radius r, if b = d . c > 0 and
        b^2 >= |c|^2 - r^2; the point met is at b - sqrt(b^2 - |c|^2 + r^2).

        Args:
            x_cam: (8,) pose of the camera in the world.
            spheres: in the world.

        Returns:
            Index (size, size) of the sphere, NOTHING or OUTSIDE; and how squarely (size, size)
            its surface faces the camera, from 0 to 1.
        """
        d, half = self.rays(), self.camera.field_of_view / 2.0
        index = np.where(d[..., 2] >= math.cos(half), NOTHING, OUTSIDE)
        facing, nearest = np.zeros(index.shape), np.full(index.shape, np.inf)
        for i, sphere in enumerate(spheres):
            c = in_camera(x_cam, sphere.centre)
            b = d @ c
            square = b**2 - float(c @ c) + sphere.radius**2
            root = np.sqrt(np.maximum(square, 0.0))
            along = b - root
            hit = (square >= 0.0) & (along > 0.0) & (along < nearest) & (index != OUTSIDE)
            index[hit], nearest[hit], facing[hit] = i, along[hit], root[hit] / sphere.radius
        return index, facing

    def render(
        self, x_cam: ArrayLike, spheres: Sequence[Sphere], colours: Sequence[Sequence[float]]
    ) -> Array:
        """The image (size, size, 3), red, green and blue from 0 to 1.

        A light at the camera shades the spheres; outside of the round image it is black.

        Args:
            x_cam: (8,) pose of the camera in the world.
            spheres: in the world.
            colours: of each sphere, three numbers from 0 to 1.
        """
        index, facing = self.seen(x_cam, spheres)
        palette = np.array([*colours, (0.0, 0.0, 0.0), BACKGROUND])  # OUTSIDE and NOTHING last
        light = np.where(index >= 0, AMBIENT + (1.0 - AMBIENT) * facing, 1.0)
        return np.asarray(palette[index] * light[..., None])


def in_camera(x_cam: ArrayLike, point: ArrayLike) -> Array:
    """A point (3,) of the world [m] in the camera's axes, for its pose x_cam (8,)."""
    away = np.asarray(point, dtype=float) - dq.translation(x_cam)
    return dq.rotate(dq.quaternion_conj(dq.P(x_cam)), away)
