"""What looks wrong with an arm though it can be loaded: units, a flange that points aside."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from rcmqp.world.arm import Arm

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
    return [*_degrees(arm), *_millimetres(arm), *([] if mounted else _flange(arm))]


def _degrees(arm: Arm) -> list[str]:
    found = []
    for i, joint in enumerate(arm.joints):
        if not arm.turns[i]:
            continue
        limit = max(abs(arm.lower[i]), abs(arm.upper[i]))
        far = TURNS < limit <= 720.0
        if far or arm.velocity[i] > FAST:
            travel = f"{arm.lower[i]:g} to {arm.upper[i]:g} rad at {arm.velocity[i]:g} rad/s"
            found.append(
                f"{arm.name}: joint {joint!r} turns from {travel}; are these degrees? A URDF has "
                "radians: multiply by 0.0174533"
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
