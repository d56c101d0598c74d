"""The endoscope on the arm, and the trocar that it passes through."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import (
    at_least,
    between,
    finite,
    options,
    or_none,
    part,
    positive,
    refused,
    rule,
)

STEEPEST_VIEW = math.radians(70.0)
"""The most that a camera may look away from the shaft [rad]."""

MOST_JOINTS = 6
"""Of a wrist; MOST_BENDS of the kernel."""

LONGEST = 2.0
"""Length above which an instrument is taken to be in millimetres [m]."""

Vector3: TypeAlias = tuple[float, float, float]


def vector3(name: str, values: ArrayLike) -> Vector3:
    """Three finite numbers as a tuple.

    Raises:
        OptionError: there are not three, or one is not finite.
    """
    array = _numbers(values)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise refused(name, values, "three finite numbers")
    return float(array[0]), float(array[1]), float(array[2])


def unit_vector3(name: str, values: ArrayLike) -> Vector3:
    """A direction as a unit vector; one that is a unit vector is kept to the bit.

    Raises:
        OptionError: it is not three finite numbers, or all of them are zero.
    """
    vector = vector3(name, values)
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise refused(name, values, "three finite numbers, not all zero")
    if abs(length - 1.0) <= 1e-12:
        return vector
    return vector3(name, np.array(vector) / length)


def _rpy(name: str, values: ArrayLike) -> Vector3:
    """Roll, pitch and yaw, none of them beyond a whole turn: then they are degrees."""
    angles = vector3(name, values)
    if max(map(abs, angles)) > 2.0 * math.pi:
        raise refused(name, values, "in rad, none beyond a whole turn; are these degrees?")
    return angles


def _near(name: str, values: ArrayLike) -> Vector3:
    """Where a mount is on its flange: within LONGEST."""
    place = vector3(name, values)
    if max(map(abs, place)) > LONGEST:
        raise refused(name, values, f"within {LONGEST:g} m of the flange; are these millimetres?")
    return place


def _length(name: str, value: float) -> float:
    """How long an instrument is: LONGEST at most."""
    length = float(positive("m")["rule"](name, value))
    if length > LONGEST:
        raise refused(name, value, f"{LONGEST:g} m at most; are these millimetres?", "m")
    return length


def _view(name: str, value: float) -> float:
    """The angle of a camera to its shaft: STEEPEST_VIEW at most."""
    angle = float(finite("rad")["rule"](name, value))
    if not 0.0 <= angle <= STEEPEST_VIEW:
        allowed = f"from 0 to {STEEPEST_VIEW:.4g}, which is 70 degrees; are these degrees?"
        raise refused(name, value, allowed, "rad")
    return angle


def _name(name: str, value: str) -> str:
    """A text that is not empty."""
    if not isinstance(value, str) or not value:
        raise refused(name, value, "a text that is not empty")
    return value


def _travel(name: str, values: ArrayLike) -> tuple[float, float]:
    """Least and largest angle about zero, neither beyond two turns."""
    array = _numbers(values)
    good = array.shape == (2,) and array[0] <= 0.0 <= array[1] and array[0] < array[1]
    if not good or not float(np.abs(array).max()) <= 4.0 * math.pi:
        raise refused(name, values, "the least and the largest angle in rad, about zero")
    return float(array[0]), float(array[1])


def _depth_range(name: str, values: ArrayLike) -> tuple[float, float]:
    array = _numbers(values)
    if array.shape != (2,) or not (np.isfinite(array).all() and array[0] < array[1]):
        raise refused(name, values, "the least and the largest depth in m, both finite")
    return float(array[0]), float(array[1])


def _numbers(values: ArrayLike) -> Array:
    """An array of what was given; NaN if that is not numbers."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return np.array(np.nan)


@options
@dataclass(frozen=True, slots=True)
class Camera:
    """The endoscope's camera: at the tip, looking along the shaft or at an angle to it.

    In its image x points right and y down. At angle and roll zero these are the shaft's x and y.

    Attributes:
        field_of_view: full angle of the round image [rad]. The default, 70 deg, is customary
            for laparoscopes; no source was found (60 and 80 deg are documented).
        angle: between the shaft and the direction of view [rad], from 0 to 70 deg. The camera
            looks to the side of the shaft's y, which is down in the image. A mount that is
            turned about the shaft makes it look to another side.
        roll: of the camera about its direction of view [rad], after it is turned by ``angle``.
    """

    field_of_view: float = field(default=math.radians(70.0), metadata=between(0.0, math.pi, "rad"))
    angle: float = field(default=0.0, metadata=rule(_view))
    roll: float = field(default=0.0, metadata=finite("rad"))

    @property
    def rotation(self) -> Array:
        """(3, 3) from the camera's axes to the shaft's: a turn about x, then the roll."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        d, e = math.cos(self.roll), math.sin(self.roll)
        tilt = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
        return np.asarray(tilt @ np.array([[d, -e, 0.0], [e, d, 0.0], [0.0, 0.0, 1.0]]))


@options
@dataclass(frozen=True, slots=True)
class Mount:
    """Where the instrument is on the flange, and how it is turned there.

    Attributes:
        xyz: (3,) its origin, seen from the flange [m].
        rpy: (3,) turns about the flange's x, y and z, one after the other [rad].
    """

    xyz: Vector3 = field(default=(0.0, 0.0, 0.0), metadata=rule(_near))
    rpy: Vector3 = field(default=(0.0, 0.0, 0.0), metadata=rule(_rpy))

    @property
    def placement(self) -> pin.SE3:
        """Placement of the mount, seen from the flange."""
        return pin.SE3(pin.rpy.rpyToMatrix(np.array(self.rpy)), np.array(self.xyz))


@options
@dataclass(frozen=True, slots=True)
class WristJoint:
    """A turning joint between shaft and tool.

    Attributes:
        name: of the joint.
        axis: (3,) that it turns about, as a unit vector in the axes of the straight wrist, which
            are the shaft's.
        position: its least and its largest angle [rad]; zero, where the wrist is straight, is
            between them.
        velocity: its speed limit [rad/s].
        along: from the joint before, or from the end of the shaft, along the straight wrist [m].
        acceleration: its limit [rad/s^2]; one is assumed without it, as of an arm.
        jerk: likewise [rad/s^3].
    """

    name: str = field(metadata=rule(_name))
    axis: Vector3 = field(metadata=rule(unit_vector3))
    position: tuple[float, float] = field(metadata=rule(_travel))
    velocity: float = field(metadata=positive("rad/s"))
    along: float = field(default=0.0, metadata=at_least(0.0, "m"))
    acceleration: float | None = field(default=None, metadata=or_none(positive("rad/s^2")))
    jerk: float | None = field(default=None, metadata=or_none(positive("rad/s^3")))


def _wrist_joints(name: str, values: Iterable[Any]) -> tuple[WristJoint, ...]:
    """Joints; mappings, as files have them, are taken for their keyword arguments."""
    take = part(WristJoint)["rule"]
    joints = tuple(take(name, value) for value in values)
    if not 1 <= len(joints) <= MOST_JOINTS:
        raise refused(name, values, f"1 to {MOST_JOINTS} joints; a tool without one has no wrist")
    return joints


@options
@dataclass(frozen=True, slots=True)
class Wrist:
    """The joints between shaft and tool, such as roll, pitch and yaw.

    At zero the wrist is straight, and the tool in line with the shaft.

    Attributes:
        joints: from the shaft to the tool.
        tool: from the last joint to the tool's point, along the straight wrist [m].
    """

    joints: tuple[WristJoint, ...] = field(metadata=rule(_wrist_joints))
    tool: float = field(default=0.0, metadata=at_least(0.0, "m"))

    @property
    def length(self) -> float:
        """From the end of the shaft to the tool's point where the wrist is straight [m]."""
        return sum(joint.along for joint in self.joints) + self.tool

    @property
    def pieces(self) -> tuple[float, ...]:
        """From each joint to the next, and from the last one to the tool's point [m]."""
        return (*(joint.along for joint in self.joints[1:]), self.tool)


@options
@dataclass(frozen=True, slots=True)
class Instrument:
    """A rigid shaft along its mount's z axis, with a tool at its end.

    Without a wrist the tool is the shaft's tip, and the camera looks out of it.

    Attributes:
        length: of the shaft [m]; 10 mm laparoscopes are 0.30 to 0.35 m long.
        radius: of the shaft [m].
        mount_offset: where the shaft begins, along the mount's z [m].
        camera: at the tip.
        mount: on the flange; the flange itself without it.
        wrist: joints between the shaft and the tool; None for a tool that is fixed to the shaft.
    """

    length: float = field(default=0.33, metadata=rule(_length))
    radius: float = field(default=0.005, metadata=positive("m"))
    mount_offset: float = field(default=0.0, metadata=at_least(0.0, "m"))
    camera: Camera = field(default_factory=Camera, metadata=part(Camera))
    mount: Mount = field(default_factory=Mount, metadata=part(Mount))
    wrist: Wrist | None = field(default=None, metadata=or_none(part(Wrist)))

    @property
    def end(self) -> float:
        """Distance of the shaft's end from the mount, along the shaft [m]."""
        return self.mount_offset + self.length

    @property
    def tip(self) -> float:
        """Distance of the tip from the mount, along the shaft [m]; with a straight wrist."""
        return self.end if self.wrist is None else self.end + self.wrist.length

    def on_shaft(self, along: float) -> pin.SE3:
        """The point of the shaft ``along`` [m] from the mount, seen from the flange."""
        return self.mount.placement * pin.SE3(np.eye(3), np.array([0.0, 0.0, along]))


@options
@dataclass(frozen=True, slots=True)
class Trocar:
    """The incision: the point that the shaft pivots about, and how far it may go.

    Cone and depth range are what the patient allows. The paper's law does not know them: a run
    is checked against them, and says where it left them.

    Attributes:
        pivot: (3,) the remote centre of motion in the world [m]; where it is at the start, if
            it moves.
        axis: (3,) unit vector in the world, into the patient: the cone's axis.
        cone_half_angle: how far the shaft may tilt from the axis [rad].
        depth_range: least and largest insertion depth of the tip beyond the pivot [m].
    """

    pivot: Vector3 = field(metadata=rule(vector3))
    axis: Vector3 = field(metadata=rule(unit_vector3))
    cone_half_angle: float = field(
        default=math.radians(60.0), metadata=between(0.0, math.pi, "rad")
    )
    depth_range: tuple[float, float] = field(default=(0.0, 0.25), metadata=rule(_depth_range))
