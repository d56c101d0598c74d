"""A wrist out of a URDF: of an instrument's own, or of a robot's with its instrument."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin

from rcmqp.errors import ArmError
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import find_frame
from rcmqp.world.instrument import Wrist, WristJoint, vector3
from rcmqp.world.urdf import Urdf, limits_of, model_of, read_urdf, soft_limits_of

STRAIGHT = 1e-5
"""How far joints and tip may be off the shaft's axis where all joints are zero [m]."""


def wrist_of_urdf(path: Path, shaft: str, tip: str) -> tuple[float, Wrist]:
    """The joints between two links of a URDF, and how long the shaft before them is.

    A joint that turns about the shaft is moved along it to the next one that does not: that
    changes nothing, and the shaft reaches to there.

    Args:
        path: the URDF.
        shaft: the link that the instrument is mounted by; the shaft goes from its origin along z.
        tip: the link whose origin is the tool's point.

    Returns:
        From the origin of ``shaft`` to where the wrist begins [m]; and the wrist.

    Raises:
        ArmError: the file is not a URDF; there are no joints between the links, or others than
            revolute ones with limits; or at zero they are not in line with the shaft.
        FrameNotFound: there is no such link.
    """
    urdf = read_urdf(path)
    model = model_of(urdf)
    data, ends = model.createData(), [find_frame(model, link) for link in (shaft, tip)]
    pin.computeJointJacobians(model, data, pin.neutral(model))
    start, end = (data.oMi[frame.parentJoint] * frame.placement for frame in ends)
    before, through = (list(model.supports[frame.parentJoint]) for frame in ends)
    chain = through[len(before) :]
    if through[: len(before)] != before or not chain:
        raise ArmError(f"{path}: no joint is between the links {shaft} and {tip}; name others")
    names = [model.names[i] for i in chain]
    places = [np.asarray(start.actInv(data.oMi[i].translation)) for i in chain]
    places.append(np.asarray(start.actInv(end.translation)))
    for place, name in zip(places, [*names, tip], strict=True):
        if (off := float(np.hypot(place[0], place[1]))) > STRAIGHT:
            raise ArmError(
                f"{path}: {name} is {1e3 * off:.2f} mm off the z axis of {shaft} where all joints "
                "are zero; a wrist must be straight there: turn the links' origins"
            )
    axes = [_axis(urdf, model, data, i, start) for i in chain]
    along = [float(place[2]) for place in places]
    for k in reversed(range(len(chain))):
        if math.hypot(*axes[k][:2]) < 1e-9:  # turns about the shaft
            along[k] = along[k + 1]
    steps = np.diff(along, prepend=along[0])
    if (steps < -STRAIGHT).any() or along[0] <= 0.0:
        raise ArmError(
            f"{path}: from {shaft} to {tip} the joints do not follow each other along z"
        )
    given = limits_of(urdf, names)
    joints = []
    for i, axis, step in zip(chain, axes, steps, strict=False):
        name, at = model.names[i], model.joints[i].idx_q
        soft = soft_limits_of(urdf, name)
        low = max(model.lowerPositionLimit[at], soft[0])
        high = min(model.upperPositionLimit[at], soft[1])
        joints.append(
            WristJoint(
                name,
                vector3("axis", axis),
                (float(low), float(high)),
                float(model.velocityLimit[model.joints[i].idx_v]),
                max(0.0, float(step)),
                given["acceleration"].get(name),
                given["jerk"].get(name),
            )
        )
    return along[0], Wrist(tuple(joints), max(0.0, float(steps[-1])))


def _axis(urdf: Urdf, model: pin.Model, data: pin.Data, joint: int, start: pin.SE3) -> Array:
    """The axis (3,) of a revolute joint, seen from ``start``."""
    name = model.names[joint]
    if model.joints[joint].nq != 1:
        raise ArmError(f"{urdf.path}: {name} turns without end; make it revolute, with limits")
    columns = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.WORLD)
    motion = columns.reshape(6, -1)[:, model.joints[joint].idx_v]  # (6,) for a model of one joint
    if math.hypot(*motion[3:]) < 0.5:
        raise ArmError(f"{urdf.path}: {name} slides; the joints of a wrist turn")
    elements = (each for each in urdf.root.iterfind("joint") if each.get("name") == name)
    if any(each.find("mimic") is not None for each in elements):
        raise ArmError(f"{urdf.path}: {name} follows another joint; a wrist's joints are free")
    axis = start.rotation.T @ motion[3:]
    return np.asarray(np.where(np.abs(axis) < 1e-12, 0.0, axis))
