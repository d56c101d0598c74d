"""What an arm's file takes from the registered arm that it is like, for the joints that it has."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pinocchio as pin

from rcmqp.world.arm import find_frame
from rcmqp.world.arm_file import LIMITS, ArmFile
from rcmqp.world.urdf import RAIL_JOINT, Urdf, model_of

OF_ALL_JOINTS = ("speed_near_limits", "srs_offsets")
"""Keys that mean nothing for an arm with other joints."""


SAME_AXIS = 0.01
"""Angle up to which two z axes count as the same [rad]."""


def entry_of(file: ArmFile, urdf: Urdf) -> dict[str, Any]:
    """What the file says; values that the registered arm has joint by joint are by joint name.

    A joint that the file locks has none, a rail is at the middle of its travel at home, and its
    limits of acceleration and jerk are assumed. Where the base or the mount is tilted, the shaft
    would point elsewhere at the registered arm's home: it is searched.

    Args:
        file: the arm's file.
        urdf: that it names.
    """
    entry = dict(file.entry)
    inherits = "home" in file.like and entry["home"] is file.like["home"]
    if inherits and (_tilted(file, "base") or _tilted(file, "flange")):
        del entry["home"]
    locked = entry.get("locked", {})
    if not file.like or (set(locked) == set(file.like.get("locked", {})) and "rail" not in entry):
        return entry
    joints = _joints(urdf, file.like)
    for key in ("home", *LIMITS):
        values = entry.get(key)
        if values is file.like.get(key) and isinstance(values, list):
            named = zip(joints, values, strict=True)
            entry[key] = {joint: value for joint, value in named if joint not in locked}
            if key == "home" and "rail" in entry:
                rail = entry["rail"]
                entry[key][RAIL_JOINT] = (rail["lower"] + rail["upper"]) / 2.0
    for key in OF_ALL_JOINTS:
        if entry.get(key) is file.like.get(key):
            entry.pop(key, None)
    return entry


def _tilted(file: ArmFile, table: str) -> bool:
    """Whether a placement in the file has another z axis than that of the registered arm."""
    like = dataclasses.replace(file, entry=file.like)
    turn = like.placement(table).rotation.T @ file.placement(table).rotation
    return bool(turn[2, 2] < np.cos(SAME_AXIS))


def _joints(urdf: Urdf, like: Any) -> list[str]:
    """Joints of a registered arm, from the base to its flange."""
    model: pin.Model = model_of(urdf)
    joint = find_frame(model, like["flange"]["frame"]).parentJoint
    names = [model.names[i] for i in list(model.supports[joint])[1:]]
    return [name for name in names if name not in like.get("locked", {})]
