"""The limits of an arm's joints: which hold, which are assumed, which were set by hand."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, Self

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from rcmqp.errors import JointLimitViolated, OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm_limits import (
    ACCELERATION_TIME,
    SPEED,
    SPEED_TIME,
    STROKE_SPEED,
    UNITS,
    ArmLimits,
    SpeedNearLimits,
    filled,
    per_joint,
    per_joint_position,
)

_ASSUMPTIONS = (
    ("acceleration", "velocity", SPEED_TIME),
    ("jerk", "acceleration", ACCELERATION_TIME),
)
"""What is assumed of a limit that is not known: another limit over a time."""

ASSUMED = ("velocity", "acceleration", "jerk")
"""Limits that may be assumed."""

MOST_TURN, MOST_STROKE = 7.0, 2.0
"""How far from zero joints are drawn at random [rad], [m]: a turn, whatever the limits say."""


class Limited:
    """The limits of an arm's joints; Arm derives from it.

    Where no acceleration or jerk limit is known, one is assumed: a joint is taken to reach its
    speed limit in SPEED_TIME, and its acceleration limit in ACCELERATION_TIME. A joint whose
    acceleration is said to have no limit has no jerk limit either, unless one is given. Where the
    speed limit is not known, as of an MJCF, it is SPEED or STROKE_SPEED.

    Attributes:
        name: what it is called.
        model: Pinocchio's model.
        lower, upper: (nv,) position limits [rad]; infinite for continuous joints.
        velocity: (nv,) speed limits [rad/s].
        acceleration: (nv,) acceleration limits [rad/s^2]; infinite only where that was asked for.
        jerk: (nv,) jerk limits [rad/s^3]; infinite only where that was asked for.
        speed_near_limits: speed limits that depend on the position, beside ``velocity``; None
            for most arms.
    """

    name: str
    model: pin.Model
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    speed_near_limits: SpeedNearLimits | None

    @property
    def nv(self) -> int:
        """Number of joints, and size of a joint velocity."""
        return int(self.model.nv)

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, from the base to the flange."""
        return tuple(self.model.names)[1:]

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of each joint's position: m of a prismatic joint, else rad."""
        prismatic = [joint.shortname().startswith("JointModelP") for joint in self.model.joints]
        return tuple("m" if slides else "rad" for slides in prismatic[1:])

    @property
    def turns(self) -> NDArray[np.bool_]:
        """Which joints (nv,) turn [rad]; the others slide [m]."""
        return np.array([unit == "rad" for unit in self.joint_units])

    @property
    def assumed(self) -> frozenset[str]:
        """Which limits, see ASSUMED, are assumed for at least one joint."""
        return frozenset(name for name in self._assumed if self.is_assumed(name).any())

    def is_assumed(self, name: str) -> NDArray[np.bool_]:
        """For which joints (nv,) a limit is assumed; for none once it has been set otherwise."""
        values, missing = self._assumed.get(name, (None, None))
        if missing is None or getattr(self, name) is not values:
            return np.zeros(self.nv, dtype=bool)
        return missing

    @property
    def limits_by_hand(self) -> ArmLimits:
        """The limits that are not the arm's own: given to load_arm(), set, or confirmed().

        load_arm(..., **arm.limits_by_hand.given()) makes an arm with the same limits.
        """
        pairs = np.column_stack([self.lower, self.upper])
        own = np.column_stack([self._own["lower"], self._own["upper"]])
        found: dict[str, Any] = {"position": _changed(pairs, (pairs == own).all(axis=1))}
        for name, of, time in _ASSUMPTIONS:
            values, assumed = getattr(self, name), self.is_assumed(name)
            again = assumed & (values == getattr(self, of) / time)
            found[name] = _changed(values, again | (~assumed & (values == self._own[name])))
        own_speed = self.is_assumed("velocity") | (self.velocity == self._own["velocity"])
        found["velocity"] = _changed(self.velocity, own_speed)
        if self.speed_near_limits != self._own_speed_near_limits:
            found["speed_near_limits"] = self.speed_near_limits
        return ArmLimits(**found)

    def confirmed(self) -> Self:
        """The same arm, with no limit counted as assumed: "I have checked these numbers".

        run_realtime() drives an arm only with limits that are given or confirmed.
        """
        arm = copy.copy(self)
        arm._assumed = {}
        return arm

    @property
    def is_confirmed(self) -> bool:
        """Whether confirmed() made the arm."""
        return not self._assumed

    def check_limits_known(self) -> None:
        """Check that a real arm may be driven with these limits.

        Raises:
            OptionError: a limit of speed, acceleration or jerk is assumed, or infinite.
        """
        for name in ASSUMED:
            values = getattr(self, name)
            if name not in self.assumed and np.isfinite(values).all():
                continue
            state = "only assumed" if name in self.assumed else "infinite"
            numbers = ", ".join(f"{x:.4g}" for x in values)
            give = "velocity=..." if name == "velocity" else "acceleration=..., jerk=..."
            remedy = ": choose one that it can do"
            if state == "only assumed":
                remedy = ", or, if you have checked these, use load_arm(...).confirmed()"
            raise OptionError(
                f"the {name} limits of {self.name} are {state}: {numbers} {UNITS[name]}; a real "
                f"arm needs a limit, load_arm(..., {give}){remedy}"
            )

    def limit_margin(self, angles: ArrayLike) -> Array:
        """Distance (..., nv) of joint angles (..., nv) to the nearer limit; negative outside."""
        angles = np.asarray(angles, dtype=float)
        return np.asarray(np.minimum(angles - self.lower, self.upper - angles))

    def random_angles(self, rng: np.random.Generator) -> Array:
        """Joint angles (nv,) drawn evenly between the limits, or within +-pi without limits.

        Of limits that are far away, only the part within MOST_TURN or MOST_STROKE of zero, or of
        the limit nearest to it, is drawn from.
        """
        lower = np.where(np.isfinite(self.lower), self.lower, -np.pi)
        upper = np.where(np.isfinite(self.upper), self.upper, np.pi)
        centre, most = np.clip(0.0, lower, upper), np.where(self.turns, MOST_TURN, MOST_STROKE)
        lower, upper = np.maximum(lower, centre - most), np.minimum(upper, centre + most)
        return np.asarray(rng.uniform(lower, upper))

    def _check_inside(self, angles: Array) -> None:
        """Check joint angles (nv,).

        Raises:
            JointLimitViolated: the joint that is farthest outside its limits.
        """
        worst = int(np.argmin(self.limit_margin(angles)))
        if self.limit_margin(angles)[worst] < 0.0:
            raise JointLimitViolated(
                self.joints[worst],
                angles[worst],
                self.lower[worst],
                self.upper[worst],
                self.joint_units[worst],
            )

    def _set_limits(
        self, own: Mapping[str, Any], by_hand: Mapping[str, Any], continuous: Array
    ) -> None:
        """Put together the arm's own limits, those given by hand, and what is assumed of others.

        Args:
            own: (nv,) lower, upper and velocity; acceleration and jerk as LimitValues, or None;
                speed_near_limits.
            by_hand: limits by their name in ArmLimits.
            continuous: (nv,) which joints turn without end.
        """
        joints = self.joints
        self._own = {name: own[name] for name in ("lower", "upper", "velocity")}
        for name, _, _ in _ASSUMPTIONS:
            known = own[name]
            self._own[name] = (
                np.full(self.nv, np.nan) if known is None else per_joint(name, known, joints)
            )
        now = dict(self._own)
        for name in UNITS.keys() & by_hand.keys():
            now[name], _ = filled(per_joint(name, by_hand[name], joints), now[name])
        if "position" in by_hand:
            given = per_joint_position(by_hand["position"], joints)
            for joint in np.flatnonzero(continuous & ~np.isnan(given[:, 0])):
                raise OptionError(
                    f"position of {joints[joint]} is given, and the joint turns without end; "
                    "make it revolute in the URDF, or leave it out"
                )
            now["lower"], _ = filled(given[:, 0], now["lower"])
            now["upper"], _ = filled(given[:, 1], now["upper"])
        now["velocity"], missing = filled(
            now["velocity"], np.where(self.turns, SPEED, STROKE_SPEED)
        )
        self._assumed: dict[str, tuple[Array, NDArray[np.bool_]]] = {
            "velocity": (now["velocity"], missing)
        }
        for name, of, time in _ASSUMPTIONS:
            now[name], missing = filled(now[name], now[of] / time)
            self._assumed[name] = now[name], missing & np.isfinite(now[name])
        for name, values in now.items():
            values.setflags(write=False)
            setattr(self, name, values)
        near = by_hand.get("speed_near_limits", own["speed_near_limits"])
        self.speed_near_limits, self._own_speed_near_limits = near, own["speed_near_limits"]
        if near is not None and len(near.offset) != self.nv:
            raise OptionError(
                f"speed_near_limits is for {len(near.offset)} joints, the arm has {self.nv}: "
                f"{', '.join(joints)}"
            )


def _changed(values: Array, kept: NDArray[np.bool_]) -> tuple[Any, ...] | None:
    """The values (nv, ...) of a limit, None in place of those that are kept; None of them all."""
    if kept.all():
        return None
    rows = (tuple(x) if isinstance(x, list) else x for x in values.tolist())
    return tuple(None if own else x for own, x in zip(kept, rows, strict=True))
