"""How an operator perceives the camera's image."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.operators.camera_task import CameraTask
from rcmqp.references.operators.population import Operator
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Vector3

FRAME_TIME = 1.0 / 30.0
"""Between two images of the camera [s]."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One image: when it was taken, and from where.

    Attributes:
        t: [s].
        x: (8,) effector pose.
    """

    t: float
    x: Array


class Eyes:
    """Sees the camera's images late, and distances in them inexactly.

    From the shift and the size of what is seen, compared with how it should look, comes the
    way e to the goal in the image's axes; it is perceived as e + N(0, diag(s_x, s_y, s_z)^2),

        s_x = floor + weber |e_x|,   s_z = floor + weber |e_z| + cross |e|,

    and a further error in depth. What is not in the image is remembered, from the pictures of the
    objectives, by its place beside the nearest sphere that is. A memory is off by N(0, 1) of
    ``memory`` times the distance between the two, by the same on the whole way to an objective.
    Nothing is perceived of an image in which none of the spheres can be seen. Things do not
    hide each other.
    """

    def __init__(
        self, operator: Operator, task: CameraTask, insertion: Insertion, rng: np.random.Generator
    ) -> None:
        """See through the camera of an insertion.

        Raises:
            OptionError: a wrist moves the camera, or it looks past the spheres.
        """
        insertion.check_camera_on_shaft("a camera task")
        camera = insertion.instrument.camera
        self._camera = dq.P(dq.from_se3(pin.SE3(camera.rotation, np.zeros(3))))
        ahead = dq.rotate(self._camera, np.array([0.0, 0.0, 1.0]))
        if math.acos(min(1.0, float(ahead @ task.towards))) > camera.field_of_view / 2.0:
            raise OptionError(
                f"the camera looks along {ahead.round(3).tolist()}, and the spheres of the task "
                f"are in the direction towards = {task.towards} of its objectives, out of the "
                "image; give towards the camera's direction, as load_scenario() does"
            )
        self.operator, self._rng = operator, rng
        self._tip_depth = insertion.tip_depth
        self._pivot = dq.translation(insertion.x_rcm).tolist()
        r = dq.P(insertion.x_rcm)
        self._r_start = r
        self._rows = dq.rotate(r, np.eye(3)).tolist()  # axes of the start, in the world
        self._half = camera.field_of_view / 2.0
        self._shown = np.array([sphere.centre for sphere in (*task.spheres, task.obstacle)])
        self._frames: deque[Frame] = deque()
        self.remember()

    def remember(self) -> None:
        """Call to mind, anew, where all is that is not in the image."""
        self._slip = self._rng.normal(size=3)

    def tip(self, x: Array) -> Vector3:
        """The tip (3,) [m] of an effector pose x (8,), from the trocar in the start's axes.

        Number by number: it is wanted every cycle.
        """
        r0, r1, r2, r3, d0, d1, d2, d3 = x.tolist()
        L, (cx, cy, cz) = self._tip_depth, self._pivot
        px = 2.0 * (d1 * r0 - d0 * r1 + d3 * r2 - d2 * r3 + L * (r1 * r3 + r0 * r2)) - cx
        py = 2.0 * (d2 * r0 - d0 * r2 + d1 * r3 - d3 * r1 + L * (r2 * r3 - r0 * r1)) - cy
        pz = 2.0 * (d3 * r0 - d0 * r3 + d2 * r1 - d1 * r2 - L * (r1 * r1 + r2 * r2)) + L - cz
        (ax, ay, az), (bx, by, bz), (ex, ey, ez) = self._rows
        return (
            ax * px + ay * py + az * pz,
            bx * px + by * py + bz * pz,
            ex * px + ey * py + ez * pz,
        )

    def look(self, t: float, x: Array) -> None:
        """An image from the effector pose x (8,) at ``t`` [s], if one is due."""
        due = int(t / FRAME_TIME + 1e-6)  # the camera's clock is its own, whatever the period
        if not self._frames or due > int(self._frames[-1].t / FRAME_TIME + 1e-6):
            self._frames.append(Frame(t, x))

    def frame(self, t: float) -> Frame:
        """The image that has come to mind by ``t`` [s]: from ``delay`` ago."""
        while len(self._frames) > 1 and self._frames[1].t <= t - self.operator.delay + 1e-9:
            self._frames.popleft()
        return self._frames[0]

    def perceive(self, t: float, goal: Vector3, mark: Vector3) -> Vector3 | None:
        """The way (3,) [m] to the goal, in the image's axes, as it seems at ``t`` [s].

        Args:
            t: now; what is seen is from ``delay`` ago.
            goal: (3,) where the camera is to be, from the trocar in the start's axes [m].
            mark: (3,) centre of the sphere that the goal is known by, likewise.

        Returns:
            None if the image shows none of the spheres.
        """
        x = self.frame(t).x
        turned = self._turned(x)
        tip = np.array(self.tip(x))
        shown = dq.rotate(turned, self._shown - tip)
        across = np.hypot(shown[:, 0], shown[:, 1])
        seen = np.arctan2(across, shown[:, 2]) <= self._half
        if not seen.any():
            return None
        beside = np.linalg.norm(self._shown[seen] - np.array(mark), axis=1).min()
        slip = self.operator.memory * beside * self._slip
        return self._judge(dq.rotate(turned, np.array(goal) + slip - tip).tolist())

    def place(self, goal: Vector3, away: Vector3) -> Vector3:
        """Where (3,) the camera seems to be, if ``away`` (3,) is the perceived way to a goal.

        Of the image looked at last; all from the trocar, the way in the image's axes [m].
        """
        turned = dq.quaternion_conj(self._turned(self._frames[0].x))
        x, y, z = (np.array(goal) - dq.rotate(turned, np.array(away))).tolist()
        return x, y, z

    def _turned(self, x: Array) -> Array:
        """Rotation (4,) from the axes of the start to those of the image at x (8,)."""
        seen = dq.quaternion_mul(dq.P(x), self._camera)
        return dq.quaternion_mul(dq.quaternion_conj(seen), self._r_start)

    def _judge(self, away: list[float]) -> Vector3:
        """A way (3,) [m] with the operator's errors of sight."""
        operator = self.operator
        x, y, z = away
        lateral, floor = operator.weber_lateral, operator.floor_lateral
        s_z = operator.floor_depth + operator.weber_depth * abs(z)
        s_z += operator.weber_cross * math.hypot(x, y, z)
        e_x, e_y, e_z, bias = self._rng.normal(size=4).tolist()
        return (
            x + (floor + lateral * abs(x)) * e_x,
            y + (floor + lateral * abs(y)) * e_y,
            z + s_z * e_z + operator.depth_bias * bias,
        )
