"""Rows of the library's tasks in numpy, as their docstrings have them."""

from __future__ import annotations

import functools
import math

import numpy as np
import pinocchio as pin

from oracles.desired import desired
from oracles.kinematics import kinematic_hessian
from oracles.objectives import value
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import C8
from rcmqp.references.view import Reference
from rcmqp.tasks import (
    DepthTask,
    DirectionTask,
    ObjectiveTask,
    OrientationTask,
    PoseTask,
    PostureTask,
    RcmTask,
    Residual,
    RollTask,
    Task,
    TipTask,
)
from rcmqp.world.arm import ArmState

OPPOSITE = 1e-12
"""Below this w^2 + z^2 the shafts point apart and there is no roll between them."""


@functools.singledispatch
def residual(task: Task, state: ArmState, reference: Reference) -> Residual:
    """What the task's evaluate() is to give."""
    raise TypeError(f"no oracle for {type(task).__name__}; register one here")


@residual.register
def rcm(task: RcmTask, state: ArmState, reference: Reference) -> Residual:
    """See RcmTask."""
    r = state.oMe.actInv(reference.pivot)
    nu, omega = state.J_local[:3], state.J_local[3:] * np.array([[1.0], [1.0], [0.0]])
    jacobian = pin.skew(r) @ omega - nu
    carried = state.oMe.rotation.T @ reference.pivot_dot
    drift = carried
    if task.period > 0.0:
        change = np.einsum("aij,i,j", kinematic_hessian(state.J_local), state.v, state.v)
        twist = state.J_local @ state.v
        spin = np.array([0.0, 0.0, twist[5]])
        nu_dot = change[:3] + np.cross(spin, twist[:3])
        omega_dot = change[3:] + np.cross(spin, twist[3:])
        omega_dot[2] = 0.0
        moving = jacobian @ state.v + 2.0 * carried
        bend = np.cross(moving, omega @ state.v) + np.cross(r, omega_dot) - nu_dot
        drift = carried + 0.5 * task.period * bend
    return Residual(r[:2], jacobian[:2], drift[:2])


@residual.register
def tip(task: TipTask, state: ArmState, reference: Reference) -> Residual:
    """See TipTask."""
    d, R = desired(reference), state.oMe.rotation
    nu, omega = state.J_local[:3], state.J_local[3:]
    a = np.array([0.0, 0.0, state.shaft.tip])
    jacobian = R @ (nu - pin.skew(a) @ omega)
    error = state.oMe.translation - d.p + (R - d.R) @ a
    if len(state.tool_at) == 3:
        tool = state.tool
        jacobian = tool.oMt.rotation @ tool.J_local[:3]
        error = tool.oMt.translation - d.p - d.R @ a
    return Residual(error, jacobian, -d.R @ (d.nu + pin.skew(d.omega) @ a))


@residual.register
def depth(task: DepthTask, state: ArmState, reference: Reference) -> Residual:
    """See DepthTask."""
    d, oMe = desired(reference), state.oMe
    r, r_d = oMe.actInv(reference.pivot), d.R.T @ (reference.pivot - d.p)
    nu, omega = state.J_local[:3], state.J_local[3:]
    jacobian = nu - pin.skew(r) @ omega
    drift = pin.skew(r_d) @ d.omega - d.nu + (d.R - oMe.rotation).T @ reference.pivot_dot
    return Residual((r_d - r)[2:], jacobian[2:], drift[2:])


@residual.register
def roll(task: RollTask, state: ArmState, reference: Reference) -> Residual:
    """See RollTask."""
    s = dq.quaternion_mul(dq.quaternion_conj(dq.P(reference.x_d)), dq.P(state.x))
    w, x, y, z = (float(value) for value in (s if s[0] >= 0.0 else -s))
    n = w * w + z * z
    if n < OPPOSITE:
        return Residual(np.zeros(1), np.zeros((1, state.J_local.shape[1])), np.zeros(1))
    own = np.array([(x * z - w * y) / n, (w * x + y * z) / n, 1.0])
    other = np.array([(x * z + w * y) / n, (y * z - w * x) / n, 1.0])
    return Residual(
        np.array([2.0 * math.atan2(z, w)]),
        own[None] @ state.J_local[3:],
        np.array([-other @ desired(reference).omega]),
    )


@residual.register
def orientation(task: OrientationTask, state: ArmState, reference: Reference) -> Residual:
    """See OrientationTask."""
    R, held = state.tool.oMt.rotation, np.asarray(task.orientation, dtype=float)
    s = dq.quaternion_mul(dq.P(dq.from_se3(state.tool.oMt)), dq.quaternion_conj(held))
    s = s if s[0] >= 0.0 else -s
    jacobian = (s[0] * np.eye(3) - pin.skew(s[1:])) @ R @ state.tool.J_local[3:]
    return Residual(2.0 * s[1:], jacobian, np.zeros(3))


@residual.register
def direction(task: DirectionTask, state: ArmState, reference: Reference) -> Residual:
    """See DirectionTask."""
    d = desired(reference)
    eRd = state.oMe.rotation.T @ d.R
    u = eRd[:, 2]
    jacobian = pin.skew(u) @ state.J_local[3:]
    drift = eRd @ np.array([d.omega[1], -d.omega[0], 0.0])
    return Residual(u[:2], jacobian[:2], drift[:2])


@residual.register
def pose(task: PoseTask, state: ArmState, reference: Reference) -> Residual:
    """See PoseTask."""
    side = -1.0 if dq.P(state.x) @ dq.P(reference.x_d) < 0.0 else 1.0
    x_d, x_d_dot = side * reference.x_d, side * reference.x_d_dot
    x_conj = dq.conj(state.x)
    N = dq.H8_minus(x_d) @ C8 @ state.J_dq
    return Residual(dq.IDENTITY - dq.mul(x_conj, x_d), -N, -dq.mul(x_conj, x_d_dot))


@residual.register
def posture(task: PostureTask, state: ArmState, reference: Reference) -> Residual:
    """See PostureTask."""
    posture, nv = np.asarray(task.posture, dtype=float), state.angles.size
    turning = np.asarray(task.continuous, dtype=bool)
    turning = turning if turning.size else np.zeros(nv, dtype=bool)
    error = state.angles - posture
    short = np.mod(error + np.pi, 2.0 * np.pi) - np.pi
    error = np.where(turning, short, error)
    return Residual(error, np.eye(nv), np.zeros(nv))


@residual.register
def objective(task: ObjectiveTask, state: ArmState, reference: Reference) -> Residual:
    """See ObjectiveTask."""
    c, J_c = value(task.objective, state)
    nv = J_c.size
    return Residual(np.zeros(nv), np.eye(nv), -task.K_c * (task.c_d - c) * J_c)
