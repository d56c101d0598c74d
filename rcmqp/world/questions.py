"""Doubts about an arm that can be loaded: wrong units, a flange that points aside."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from rcmqp.errors import ArmError, JointLimitViolated
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm
from rcmqp.world.arm_limits import per_joint, per_joint_position

TURNS = 13.0
"""Position limit that no joint which is not endless has [rad]: more than two turns each way."""

FAST = 35.0
"""Speed that no joint of an arm has [rad/s]; 2000 deg/s."""

LONG, LONG_STROKE = 15.0, 10.0
"""Length of an arm, and travel of a sliding joint, that may be in millimetres [m]."""

ASIDE, ALONG = math.cos(math.radians(75.0)), math.cos(math.radians(10.0))
"""Cosines: the flange's z axis is far from outwards, another axis of it is near."""

ENDLESS = 1e6
"""What a longer travel stands for: no limit [m]."""

_TURN_TO_Z = {
    "x": "[0.0, 1.5707963267948966, 0.0]",
    "-x": "[0.0, -1.5707963267948966, 0.0]",
    "y": "[-1.5707963267948966, 0.0, 0.0]",
    "-y": "[1.5707963267948966, 0.0, 0.0]",
    "-z": "[3.141592653589793, 0.0, 0.0]",
}
"""rpy that turns the z axis to another axis of the frame."""


def questions(arm: Arm, *, mounted: bool = False) -> list[str]:
    """A sentence, with a remedy, for each thing that looks wrong.

    Args:
        arm: what was loaded.
        mounted: whether the turn from the frame to the flange was chosen on purpose.
    """
    return [
        *_degrees(arm, *np.ones((2, arm.nv), dtype=bool)),
        *_millimetres(arm),
        *([] if mounted else _flange(arm)),
    ]


def check_given(arm: Arm) -> None:
    """Refuse numbers of one's own that look like degrees: home, and limits.

    Those of a URDF, which may be another's, are only questioned, also where other joints have
    limits that were given; see questions().

    Raises:
        ArmError: with the joint, and what to do.
    """
    recipe = {} if arm.source is None else arm.source.recipe
    position, velocity = np.zeros((2, arm.nv), dtype=bool)
    for given in (recipe.get("own", {}), arm.limits_by_hand.given()):
        if "position" in given:
            position |= ~np.isnan(per_joint_position(given["position"], arm.joints)[:, 0])
        if "velocity" in given:
            velocity |= ~np.isnan(per_joint("velocity", given["velocity"], arm.joints))
    found = _degrees(arm, position, velocity)
    found += _home(arm) if recipe.get("home") is not None else []  # one that is searched is right
    if found:
        raise ArmError(found[0])


def home_question(arm: Arm, error: JointLimitViolated) -> str:
    """A sentence if a home outside the limits is inside in another unit; else nothing."""
    slides = arm.joint_units[arm.joints.index(error.joint)] == "m"
    unit, right, factor, most = (
        ("millimetres", "metres", 0.001, 2.0)
        if slides
        else ("degrees", "radians", math.pi / 180.0, 2.0 * math.pi)
    )
    inside = error.lower <= factor * error.position <= error.upper
    if abs(error.position) <= most or not inside:
        return ""
    return (
        f"{arm.name}: home has {error}; are these {unit}? Home is in {right}: multiply by "
        f"{factor:.6g}"
    )


def _home(arm: Arm) -> list[str]:
    """Whether home turns an endless joint more than twice; others are inside their limits."""
    for i, joint in enumerate(arm.joints):
        if arm.turns[i] and not math.isfinite(arm.upper[i]) and abs(arm.home[i]) > TURNS:
            return [
                f"{arm.name}: home has joint {joint!r} at {arm.home[i]:g} rad; are these degrees? "
                "Home is in radians: multiply by 0.0174533"
            ]
    return []


def _degrees(arm: Arm, position: Array, velocity: Array) -> list[str]:
    """Whether a joint's limits look like degrees, of each kind where the mask (nv,) is true."""
    found = []
    for i, joint in enumerate(arm.joints):
        if not arm.turns[i]:
            continue
        limit = max(abs(arm.lower[i]), abs(arm.upper[i]))
        far = position[i] and TURNS < limit <= 720.0
        if far or (velocity[i] and arm.velocity[i] > FAST):
            travel = f"{arm.lower[i]:g} to {arm.upper[i]:g} rad at {arm.velocity[i]:g} rad/s"
            found.append(
                f"{arm.name}: joint {joint!r} turns from {travel}; are these degrees? Limits are "
                "in radians: multiply by 0.0174533"
            )
    return found[:1]


def _millimetres(arm: Arm) -> list[str]:
    lengths = [float(np.linalg.norm(each.translation)) for each in arm.model.jointPlacements]
    total = sum(lengths) + float(np.linalg.norm(arm.jMflange.translation))
    found = []
    if total > LONG:
        found.append(
            f"{arm.name}: from base to flange the links are {total:.3g} m long together; are "
            "these millimetres? A URDF has metres: multiply each origin's xyz by 0.001"
        )
    for i, joint in enumerate(arm.joints):
        stroke = arm.upper[i] - arm.lower[i]
        if not arm.turns[i] and LONG_STROKE < stroke < ENDLESS:
            found.append(
                f"{arm.name}: joint {joint!r} slides by {stroke:g} m; are these millimetres? A "
                "URDF has metres: multiply its limits by 0.001"
            )
    return found


def _flange(arm: Arm) -> list[str]:
    """Whether z of the flange points away from the wrist.

    The wrist is the last joint whose origin is not the flange's own.
    """
    data = arm.model.createData()
    pin.forwardKinematics(arm.model, data, pin.neutral(arm.model))
    flange = data.oMi[arm.model.njoints - 1] * arm.jMflange
    origins = [oMi.translation for oMi in list(data.oMi)[:0:-1]]
    away = next((d for o in origins if np.linalg.norm(d := flange.translation - o) > 1e-3), None)
    if away is None:
        return []
    seen = flange.rotation.T @ away / np.linalg.norm(away)
    if seen[2] >= ASIDE:
        return []
    axis = int(np.argmax(np.abs(seen)))
    outwards = f"{'-' if seen[axis] < 0.0 else ''}{'xyz'[axis]}"
    if abs(seen[axis]) < ALONG:
        return []
    angle = math.degrees(math.acos(min(1.0, max(-1.0, float(seen[2])))))
    return [
        f"{arm.name}: z of the flange {arm.flange!r}, along which the instrument is mounted, is "
        f"{angle:.0f} deg from outwards, its {outwards} axis points outwards; if the instrument "
        f"is to go on along that one, give rpy = {_TURN_TO_Z[outwards]} in [flange] of an arm's "
        "file"
    ]
