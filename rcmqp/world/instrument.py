"""The endoscope on the arm, and the trocar that it passes through."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array

Vector3: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Camera:
    """The endoscope's camera: at the tip, looking along the shaft.

    In its image x points right and y down.

    Attributes:
        field_of_view: full angle of the round image [rad]. The default, 70 deg, is customary
            for laparoscopes; no source was found (60 and 80 deg are documented).
    """

    field_of_view: float = math.radians(70.0)

    def __post_init__(self) -> None:
        """Check the angle."""
        _within("field_of_view", self.field_of_view, 0.0, math.pi)


@dataclass(frozen=True, slots=True)
class Instrument:
    """A rigid shaft along the flange's z axis, with a camera at its tip.

    Attributes:
        length: of the shaft [m]; 10 mm laparoscopes are 0.30 to 0.35 m long.
        radius: of the shaft [m].
        mount_offset: where the shaft begins, along the flange's z [m].
        camera: at the tip.
    """

    length: float = 0.33
    radius: float = 0.005
    mount_offset: float = 0.0
    camera: Camera = field(default_factory=Camera)

    def __post_init__(self) -> None:
        """Check the sizes."""
        _within("length", self.length, 0.0, math.inf)
        _within("radius", self.radius, 0.0, math.inf)
        if not (math.isfinite(self.mount_offset) and self.mount_offset >= 0.0):
            raise OptionError(f"mount_offset = {self.mount_offset} m, it must be 0 or more")

    @property
    def tip(self) -> float:
        """Distance of the tip from the flange, along its z [m]."""
        return self.mount_offset + self.length


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

    pivot: Vector3
    axis: Vector3
    cone_half_angle: float = math.radians(60.0)
    depth_range: tuple[float, float] = (0.0, 0.25)

    def __post_init__(self) -> None:
        """Make the axis a unit vector and check the rest."""
        object.__setattr__(self, "pivot", vector3("pivot", self.pivot))
        object.__setattr__(self, "axis", unit_vector3("axis", self.axis))
        _within("cone_half_angle", self.cone_half_angle, 0.0, math.pi)
        if len(self.depth_range) != 2:
            raise OptionError(f"depth_range = {self.depth_range}, it must be least and largest")
        low, high = (float(depth) for depth in self.depth_range)
        if not -math.inf < low < high < math.inf:
            raise OptionError(
                f"depth_range = [{low}, {high}] m, the first must be the smaller, both finite"
            )
        object.__setattr__(self, "depth_range", (low, high))


def vector3(name: str, values: Sequence[float] | Array) -> Vector3:
    """Three finite numbers as a tuple.

    Raises:
        OptionError: there are not three, or one is not finite.
    """
    array = np.asarray(values, dtype=float)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise OptionError(f"{name} = {values}, it must be three finite numbers")
    return float(array[0]), float(array[1]), float(array[2])


def unit_vector3(name: str, values: Sequence[float] | Array) -> Vector3:
    """A direction as a unit vector; one that is a unit vector is kept to the bit.

    Raises:
        OptionError: it is not three finite numbers, or all of them are zero.
    """
    vector = vector3(name, values)
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise OptionError(f"{name} = {values} has no direction")
    if abs(length - 1.0) <= 1e-12:
        return vector
    return vector3(name, np.array(vector) / length)


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low < value < high:
        raise OptionError(f"{name} = {value}, it must lie between {low} and {high}")
