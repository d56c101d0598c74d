"""An instrument's wrist: after the joints of an arm, and out of a URDF."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pinocchio as pin

from rcmqp.errors import ArmError, OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm, find_frame
from rcmqp.world.arm_limits import SpeedNearLimits
from rcmqp.world.instrument import Instrument, Wrist, WristJoint, vector3
from rcmqp.world.urdf import Urdf, limits_of, model_of, read_urdf, soft_limits_of

ENDLESS = {"offset": 0.0, "deceleration": 1.0, "lower": -np.inf, "upper": np.inf}
"""Numbers of SpeedNearLimits for a joint whose speed limit does not depend on its position."""

STRAIGHT = 1e-5
"""How far joints and tip may be off the shaft's axis where all joints are zero [m]."""


def with_wrist(arm: Arm, instrument: Instrument) -> Arm:
    """The arm with the wrist's joints after its own; the arm itself without a wrist.

    The shaft stays on the arm's last joint, the tool is on the wrist's last one.

    Raises:
        OptionError: the arm has a wrist already, or a joint that is called as one of the wrist.
    """
    wrist = instrument.wrist
    if arm.wrist is not None:
        raise OptionError(
            f"{arm.name} has the joints of a wrist already; give the arm alone, which is "
            "insertion.bare"
        )
    if wrist is None:
        return arm
    model, parent = arm.model.copy(), arm.last_joint
    _set_limits(model, arm)
    place = arm.jMflange * instrument.on_shaft(instrument.end)
    for joint in wrist.joints:
        body = model.existFrame(joint.name, pin.FrameType.BODY)
        if model.existJointName(joint.name) or body:  # it may be held there, beyond the flange
            raise OptionError(
                f"the wrist's joint {joint.name!r} has a name that {arm.name} has already; give "
                "it another"
            )
        place = place * pin.SE3(np.eye(3), np.array([0.0, 0.0, joint.along]))
        kind = pin.JointModelRevoluteUnaligned(np.array(joint.axis))
        numbers = (np.array([x]) for x in (np.inf, joint.velocity, *joint.position))
        parent = model.addJoint(parent, kind, place, joint.name, *numbers)
        place = pin.SE3.Identity()
    frame = arm.model.frames[arm.model.getFrameId(arm.flange)]
    made = Arm(
        model,
        arm.flange,
        name=arm.name,
        title=arm.title,
        licence=arm.licence,
        home_search=lambda _: np.concatenate([arm.home, np.zeros(len(wrist.joints))]),
        flange_offset=frame.placement.actInv(arm.jMflange),
        acceleration=[*_known(arm, "acceleration"), *(each.acceleration for each in wrist.joints)],
        jerk=[*_known(arm, "jerk"), *(each.jerk for each in wrist.joints)],
        speed_near_limits=_near(arm.speed_near_limits, len(wrist.joints)),
        source=arm.source,
        wrist=wrist,
    )
    return made.confirmed() if arm.is_confirmed else made


def _set_limits(model: pin.Model, arm: Arm) -> None:
    """Copy the arm's limits of position and speed, given by hand or not, into the model."""
    lower, upper = model.lowerPositionLimit.copy(), model.upperPositionLimit.copy()
    for i, joint in enumerate(model.joints[1:]):
        if joint.nq == 1:
            lower[joint.idx_q], upper[joint.idx_q] = arm.lower[i], arm.upper[i]
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    model.velocityLimit = np.where(arm.is_assumed("velocity"), np.nan, arm.velocity)


def _known(arm: Arm, name: str) -> list[float | None]:
    """A limit of each joint; None where it is assumed."""
    values: Array = getattr(arm, name)
    return [None if no else x for no, x in zip(arm.is_assumed(name), values.tolist(), strict=True)]


def _near(own: SpeedNearLimits | None, more: int) -> SpeedNearLimits | None:
    """The arm's speed limits that depend on the position, with ``more`` joints without any."""
    if own is None:
        return None
    rows = dataclasses.asdict(own)
    return SpeedNearLimits(**{name: (*rows[name], *(x,) * more) for name, x in ENDLESS.items()})


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
        ArmError: the file is not a URDF; the links have no joints between them; a joint between
            them is not revolute, or has no limits; or at zero they leave the shaft's line.
        FrameNotFound: a link has a name that the file does not have.
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
