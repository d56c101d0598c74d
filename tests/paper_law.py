"""The paper's law written down literally, and what its tests start from.

It has its own dual-quaternion product, Pinocchio's Jacobian in world axes and numpy's pinv.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from helpers import nearer

from rcmqp import (
    ArmState,
    Insertion,
    Reference,
    arm_names,
    load_arm,
    make_controller,
)
from rcmqp.controllers import DualQuaternion
from rcmqp.maths.dualquaternion import Array, from_se3

PERIOD = 8e-3
SEVEN_JOINTS = [name for name in arm_names() if load_arm(name).nv == 7]


def hamilton(a: Array, b: Array) -> Array:
    w = a[0] * b[0] - a[1:] @ b[1:]
    return np.array([w, *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


def product(x: Array, y: Array) -> Array:
    dual = hamilton(x[:4], y[4:]) + hamilton(x[4:], y[:4])
    return np.concatenate([hamilton(x[:4], y[:4]), dual])


def conjugate(x: Array) -> Array:
    return np.array([x[0], *-x[1:4], x[4], *-x[5:]])


def pose_jacobian(insertion: Insertion, state: ArmState) -> Array:
    """J of (1), (8, n): x' = (omega + eps v) x / 2, with the twist at the world's origin."""
    model = insertion.arm.model
    J = pin.computeJointJacobians(model, model.createData(), state.q)  # in world axes
    twists = np.vstack([np.zeros(model.nv), J[3:], np.zeros(model.nv), J[:3]])
    return np.column_stack([0.5 * product(twist, state.x) for twist in twists.T])


def error(state: ArmState, x_d: Array) -> Array:
    """Error e of (3), (8,)."""
    one: Array = np.eye(8)[0]
    return one - product(conjugate(state.x), x_d)


def matrix_N(insertion: Insertion, state: ArmState, x_d: Array) -> Array:
    """N of (3), (8, n): N v = vec(conj(x') x_d)."""
    columns = pose_jacobian(insertion, state).T
    return np.column_stack([product(conjugate(column), x_d) for column in columns])


def controller(insertion: Insertion, **options: Any) -> DualQuaternion:
    made = make_controller("dual_quaternion", insertion, PERIOD, **options)
    assert isinstance(made, DualQuaternion)
    return made


def moving(x_d: Array, rate: Array) -> Reference:
    return Reference(x_d, rate, np.zeros(3), np.zeros(3))  # the law does not ask for the trocar


def still(x_d: Array) -> Reference:
    return moving(x_d, np.zeros(8))


def moved(state: ArmState, twist: Array) -> Array:
    """The pose a twist (linear, angular), in the effector's axes, away from a state."""
    return nearer(from_se3(state.oMe * pin.exp6(twist)), state.x)
