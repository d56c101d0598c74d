"""The large needle driver on arms, and its kinematics by hand."""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin

from rcmqp import Instrument, load_arm
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument_file import load_instrument

ARMS = ("lwa3", "panda", "ur10")
NEEDLE_DRIVER = load_instrument("large_needle_driver")
PITCH_TO_YAW, YAW_TO_TIP, SHAFT = 0.0091, 0.0102, 0.4162
JOINTS = 3


@functools.cache
def bare(name: str) -> tuple[Arm, pin.Data]:
    """An arm alone, and data for its kinematics."""
    arm = load_arm(name)
    return arm, arm.model.createData()


def tool_by_hand(insertion: Insertion, q: Array) -> pin.SE3:
    """The needle driver's tool, see chain_by_hand()."""
    return chain_by_hand(insertion, q)[-1]


def chain_by_hand(insertion: Insertion, q: Array) -> list[pin.SE3]:
    """The needle driver from the flange of the arm alone: the mount, the end of the shaft, the yaw
    joint and the tool, one turn after the other."""
    arm, data = bare(insertion.arm.name)
    roll, pitch, yaw = insertion.arm.angles(q)[-JOINTS:]
    pin.framesForwardKinematics(arm.model, data, q[: arm.nq])

    def turned(axis: str, angle: float, along: float) -> pin.SE3:
        R = pin.utils.rotate(axis, angle)
        return pin.SE3(R, R @ np.array([0.0, 0.0, along]))

    mount = data.oMf[arm.model.getFrameId(arm.flange)].copy()
    end = mount * pin.SE3(np.eye(3), np.array([0, 0, SHAFT]))
    at_yaw = end * turned("z", roll, 0.0) * turned("y", pitch, PITCH_TO_YAW)
    return [mount, end, at_yaw, at_yaw * turned("x", yaw, YAW_TO_TIP)]


def inserted(name: str, instrument: Instrument = NEEDLE_DRIVER) -> Insertion:
    return Insertion.on_shaft(load_arm(name), instrument)


def somewhere(insertion: Insertion, rng: np.random.Generator) -> Array:
    """Angles (nv,) near the start, the wrist bent."""
    near = insertion.angles_start + rng.uniform(-0.3, 0.3, insertion.arm.nv)
    return np.asarray(np.clip(near, insertion.arm.lower, insertion.arm.upper))
