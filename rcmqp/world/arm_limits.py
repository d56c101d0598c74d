"""Limits of an arm's joints as data: given by hand, near the position limits, and assumed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import options, or_none, part, refused, rule

SPEED_TIME = 0.5
"""Time in which a joint reaches its speed limit, where its acceleration is not known [s].

The assumed acceleration limit is the speed limit over this.
"""

ACCELERATION_TIME = 0.02
"""Time in which a joint reaches its acceleration limit, where its jerk is not known [s].

The assumed jerk limit is the acceleration limit over this. Careful beside the 2 ms of Franka's
arms; with 50 ms, where all joints are at their limits, they cannot bring the shaft back in time:
of wild runs the worst was 64 to 360 mm off the trocar, with 20 ms 0.002 mm.
"""

SPEED, STROKE_SPEED = 1.0, 0.1
"""Speed of a joint that turns [rad/s], or slides [m/s], where nothing says it."""

UNITS = {"velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3"}
"""Limits that are one positive number a joint, and their units; m in place of rad if prismatic."""

LimitValues = float | Array | Sequence[float | None] | Mapping[str, float]
"""A number for all joints, one for each (None keeps the joint's own), or numbers by joint name."""

Interval = tuple[float, float]
GivenPosition = Interval | Array | Sequence[Sequence[float] | None] | Mapping[str, Sequence[float]]
"""Lower and upper limit for all joints, for each (None keeps its own), or by joint name."""


def _check_size(name: str, size: int, joints: Sequence[str]) -> None:
    if size != len(joints):
        raise OptionError(
            f"{name} has shape ({size},), the arm has {len(joints)} joints; give one number for "
            f"all joints, one for each, or numbers by name of joint ({', '.join(joints)})"
        )


def _plain(
    name: str, given: Any, joints: Sequence[str] = ()
) -> float | tuple[float | None, ...] | None:
    """A positive number, or a tuple of such numbers and None."""
    if given is None or _is_scalar(given):
        return None if given is None else _positive(name, given)
    values = tuple(given)
    if joints:
        _check_size(name, len(values), joints)
    names = joints or [f"joint {i}" for i in range(1, len(values) + 1)]
    return tuple(
        None if value is None else _positive(f"{name} of {joint}", value, name)
        for joint, value in zip(names, values, strict=True)
    )


def _plain_position(name: str, given: Any, joints: Sequence[str] = ()) -> Any:
    """A pair, or a tuple of pairs and None."""
    if given is None:
        return None
    if _is_scalar(given):
        raise refused(name, given, "a lower and an upper limit")
    values = tuple(given)
    if len(values) == 2 and all(x is not None and _is_scalar(x) for x in values):
        return _interval(name, values)
    if joints:
        _check_size(name, len(values), joints)
    names = joints or [f"joint {i}" for i in range(1, len(values) + 1)]
    return tuple(
        None if pair is None else _interval(f"{name} of {joint}", pair)
        for joint, pair in zip(names, values, strict=True)
    )


def _interval(what: str, pair: Any) -> Interval:
    try:
        lower, upper = (_number(what, x) for x in pair)
    except (TypeError, ValueError) as error:
        raise refused(what, pair, "a lower and an upper limit") from error
    if not lower < upper:
        raise OptionError(f"{what} = ({lower}, {upper}), the first must be below the second")
    return lower, upper


def _positive(what: str, given: Any, name: str = "") -> float:
    value, name = _number(what, given), name or what
    if not value > 0.0:
        hint = "" if name == "velocity" else "; math.inf is no limit"
        raise OptionError(f"{what} = {value:g} {UNITS[name]}, it must be positive{hint}")
    if name == "velocity" and math.isinf(value):
        raise OptionError(
            f"{what} = {value:g} rad/s, it must be finite; give the speed that the joint reaches"
        )
    return value


def _is_scalar(given: Any) -> bool:
    return (
        isinstance(given, str)
        or not hasattr(given, "__len__")
        or getattr(given, "shape", None) == ()
    )


def _number(what: str, given: Any) -> float:
    if isinstance(given, str | bool):
        raise refused(what, given, "a number")
    try:
        return float(given)
    except (TypeError, ValueError, OverflowError) as error:
        raise refused(what, given, "a number") from error


def _numbers(name: str, given: Any) -> tuple[float, ...]:
    try:
        return tuple(_number(f"speed_near_limits.{name}", value) for value in given)
    except TypeError as error:
        raise refused(f"speed_near_limits.{name}", given, "one number a joint") from error


@options
@dataclass(frozen=True, slots=True)
class SpeedNearLimits:
    """Speed limits that fall towards the ends of a joint's travel, as those of Franka's FR3.

    At the angle q a joint may move at most at

        max(0, sqrt(2 deceleration (upper - q)) - offset)

    upwards, and downwards likewise with q - lower; beyond ``upper`` or ``lower`` the root is 0.
    Franka Control Interface documentation, "Position-based velocity limits".

    Attributes:
        offset: (nv,) speed that is kept in reserve [rad/s].
        deceleration: (nv,) with which a joint can stop at the end of its travel [rad/s^2].
        lower, upper: (nv,) angles at which the root is zero [rad]; infinite without such a limit.
    """

    offset: tuple[float, ...] = field(metadata=rule(_numbers))
    deceleration: tuple[float, ...] = field(metadata=rule(_numbers))
    lower: tuple[float, ...] = field(metadata=rule(_numbers))
    upper: tuple[float, ...] = field(metadata=rule(_numbers))

    def __post_init__(self) -> None:
        rows = list(zip(self.offset, self.deceleration, self.lower, self.upper, strict=False))
        if any(len(getattr(self, item.name)) != len(rows) for item in dataclasses.fields(self)):
            raise OptionError(
                "speed_near_limits: offset, deceleration, lower and upper have "
                f"{len(self.offset)}, {len(self.deceleration)}, {len(self.lower)} and "
                f"{len(self.upper)} numbers; give each of them one number a joint"
            )
        for i, (offset, deceleration, lower, upper) in enumerate(rows, 1):
            good = 0.0 <= offset < math.inf and 0.0 < deceleration < math.inf and lower < upper
            if not good:
                raise OptionError(
                    f"speed_near_limits of joint {i}: offset {offset} must be 0 or more, "
                    f"deceleration {deceleration} positive, both finite, and lower {lower} below "
                    f"upper {upper}"
                )

    def bounds(self, angles: ArrayLike) -> tuple[Array, Array]:
        """Least and largest velocity (..., nv) allowed at joint angles (..., nv) [rad/s]."""
        angles, offset = np.asarray(angles, dtype=float), np.array(self.offset)
        twice = 2.0 * np.array(self.deceleration)
        up, down = (
            np.maximum(0.0, np.sqrt(twice * np.maximum(0.0, room)) - offset)
            for room in (np.array(self.upper) - angles, angles - np.array(self.lower))
        )
        return 0.0 - down, up


@options
@dataclass(frozen=True, slots=True)
class ArmLimits:
    """Limits given by hand in place of an arm's own; None keeps the arm's own.

    Attributes:
        position: lower and upper limit, one pair for all joints or a pair for each [rad].
        velocity, acceleration, jerk: one number for all joints or one for each [rad/s],
            [rad/s^2], [rad/s^3]; math.inf is no limit, which a speed has to have.
        speed_near_limits: speed limits that depend on the position.
    """

    position: Interval | tuple[Interval | None, ...] | None = field(
        default=None, metadata=rule(_plain_position)
    )
    velocity: float | tuple[float | None, ...] | None = field(default=None, metadata=rule(_plain))
    acceleration: float | tuple[float | None, ...] | None = field(
        default=None, metadata=rule(_plain)
    )
    jerk: float | tuple[float | None, ...] | None = field(default=None, metadata=rule(_plain))
    speed_near_limits: SpeedNearLimits | None = field(
        default=None, metadata=or_none(part(SpeedNearLimits))
    )

    def given(self) -> dict[str, Any]:
        """Those that are not None, by name: what load_arm() takes."""
        fields = ((item.name, getattr(self, item.name)) for item in dataclasses.fields(self))
        return {name: value for name, value in fields if value is not None}

    def to_data(self) -> dict[str, Any]:
        """Numbers, lists and texts for JSON, which has no infinity."""
        given = self.given()
        if self.speed_near_limits is not None:
            given["speed_near_limits"] = dataclasses.asdict(self.speed_near_limits)
        return {name: _without_infinity(value) for name, value in given.items()}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Self:
        """The inverse of to_data()."""
        return cls(**{name: _with_infinity(value) for name, value in data.items()})


def per_joint(name: str, given: LimitValues, joints: Sequence[str]) -> Array:
    """Numbers (nv,) of a limit that was given in any of the three ways; NaN where none was.

    Args:
        name: velocity, acceleration or jerk.
        given: see LimitValues.
        joints: (nv,) the joints' names.

    Raises:
        OptionError: a number is not positive, or there are too many or too few.
        UnknownName: no joint has this name.
    """
    if isinstance(given, Mapping):
        given = tuple(given.get(joint) for joint in _known(given, joints))
    values = _plain(name, given, joints)
    assert values is not None
    if isinstance(values, float):
        return np.full(len(joints), values)
    _check_size(name, len(values), joints)
    return np.array([math.nan if value is None else value for value in values])


def per_joint_position(given: GivenPosition, joints: Sequence[str]) -> Array:
    """Lower and upper position limits (nv, 2); NaN where none was given. See per_joint()."""
    if isinstance(given, Mapping):
        given = tuple(given.get(joint) for joint in _known(given, joints))
    values = _plain_position("position", given, joints)
    assert values is not None
    if values and isinstance(values[0], float):
        return np.tile(np.array(values, dtype=float), (len(joints), 1))
    _check_size("position", len(values), joints)
    return np.array([(math.nan, math.nan) if value is None else value for value in values])


def filled(known: Array, assumed: Array) -> tuple[Array, NDArray[np.bool_]]:
    """A limit (nv,) with what is assumed in place of NaN, and for which joints (nv,) it is."""
    missing = np.isnan(known)
    return np.where(missing, assumed, known), missing


def _known(given: Mapping[str, Any], joints: Sequence[str]) -> Sequence[str]:
    """All joints, if every name in the mapping is one of them."""
    for joint in given:
        if joint not in joints:
            raise UnknownName("joint", str(joint), joints)
    return joints


def _without_infinity(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _without_infinity(x) for name, x in value.items()}
    if isinstance(value, tuple | list):
        return [_without_infinity(x) for x in value]
    return str(value) if isinstance(value, float) and math.isinf(value) else value


def _with_infinity(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _with_infinity(x) for name, x in value.items()}
    if isinstance(value, list):
        return tuple(_with_infinity(x) for x in value)
    return float(value) if value in ("inf", "-inf") else value
