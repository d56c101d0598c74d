"""An arm that has the joints of an instrument's wrist after its own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin

from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm
from rcmqp.world.arm_limits import SpeedNearLimits
from rcmqp.world.instrument import Instrument

ENDLESS = {"offset": 0.0, "deceleration": 1.0, "lower": -np.inf, "upper": np.inf}
"""Numbers of SpeedNearLimits for a joint whose speed limit does not depend on its position."""


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
