"""Rows of the library's limits in numpy, as their docstrings have them."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pinocchio as pin

import oracles.tasks
from rcmqp.limits import (
    Constraint,
    Damper,
    EntrySphere,
    JointLimits,
    KeepIn,
    KeepOut,
    Limit,
    SphereLimit,
    TrocarCone,
    TrocarDepth,
    TrocarSpeed,
)
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.view import Reference
from rcmqp.tasks import RcmTask
from rcmqp.world.arm import ArmState

ON_AXIS = 1e-6
"""Sine of the angle below which the shaft is on the cone's axis, and tilts in no direction."""

CENTRE = 1e-9
"""Distance [m] below which a point is at the centre, and away from it in no direction."""


@functools.singledispatch
def constraint(limit: Limit, state: ArmState, reference: Reference) -> Constraint:
    """What the limit's evaluate() is to give."""
    raise TypeError(f"no oracle for {type(limit).__name__}; register one here")


def pace(limit: Damper, s: float) -> float:
    """See Damper.pace()."""
    A, size = limit.deceleration, abs(s)
    if limit.gain**2 * size <= A:
        return limit.gain * s
    return math.copysign(math.sqrt(2.0 * A * size - (A / limit.gain) ** 2), s)


@constraint.register
def joints(limit: JointLimits, state: ArmState, reference: Reference) -> Constraint:
    """The box, whose oracle is tests/test_joint_limits.py."""
    return Constraint.box(*limit.interval(state.angles, state.v, state.a))


@constraint.register
def trocar_cone(limit: TrocarCone, state: ArmState, reference: Reference) -> Constraint:
    """See TrocarCone."""
    x, y, z = (float(c) for c in state.oMe.rotation.T @ np.array(limit.trocar.axis))
    sine = math.hypot(x, y)
    if sine > ON_AXIS:
        by_omega = np.array([[y / sine, -x / sine]])
    else:
        by_omega = np.array([[0.0 if z > 0.0 else 1.0, 0.0]])
    room = limit.trocar.cone_half_angle - math.atan2(sine, z)
    row = by_omega @ state.J_local[3:5]
    return Constraint.rows(row, [pace(limit, room)], limit.row_names)


@constraint.register
def trocar_speed(limit: TrocarSpeed, state: ArmState, reference: Reference) -> Constraint:
    """See TrocarSpeed; the bend is of second degree in v, so differences are exact."""

    def bend(v: Array) -> Array:
        moving = dataclasses.replace(state, v=v)
        with_bend, without = (
            oracles.tasks.residual(RcmTask(period=period), moving, reference).drift
            for period in (2.0, 0.0)
        )
        return np.asarray(with_bend - without)

    v, nv, T = state.v, state.v.size, limit.period
    J = oracles.tasks.residual(RcmTask(), state, reference).jacobian * limit.arm.acceleration
    by_v = np.transpose([(bend(v + e) - bend(v - e)) / 2.0 for e in np.eye(nv)])
    b, inverse = bend(v), np.linalg.inv(J @ J.T)
    s = math.sqrt(b @ inverse @ b)
    row = b @ inverse @ by_v / s
    rate = row @ v + limit.gain * T * (limit.share - s)
    unit = T * float(np.linalg.norm(b)) / s
    return Constraint.rows([unit * row], [unit * rate], limit.row_names)


@constraint.register
def trocar_depth(limit: TrocarDepth, state: ArmState, reference: Reference) -> Constraint:
    """See TrocarDepth."""
    r = state.oMe.actInv(reference.pivot)
    row = state.J_local[2] - (pin.skew(r) @ state.J_local[3:])[2]
    drift = -(state.oMe.rotation.T @ reference.pivot_dot)[2]
    depth = state.shaft.tip - r[2]
    shallowest, deepest = limit.trocar.depth_range
    return Constraint.rows(
        np.array([row, -row]),
        [pace(limit, deepest - depth) - drift, pace(limit, depth - shallowest) + drift],
        limit.row_names,
    )


@constraint.register
def keep_out(limit: KeepOut, state: ArmState, reference: Reference) -> Constraint:
    """See KeepOut."""
    b, jacobian, drift = seen(limit, state, reference)
    delta, u = direction(b, state.shaft.tip if limit.part == "tip" else nearest(limit, state, b))
    if delta <= CENTRE:
        u = np.array([1.0, 0.0, 0.0])
    room = delta - limit.radius - limit.instrument.radius
    return Constraint.rows([-u @ jacobian], [pace(limit, room) + u @ drift], limit.row_names)


@constraint.register
def keep_in(limit: KeepIn, state: ArmState, reference: Reference) -> Constraint:
    """See KeepIn."""
    b, jacobian, drift = seen(limit, state, reference)
    ends = [state.shaft.tip, *([mount(limit, state)] if limit.part == "shaft" else [])]
    C, d = [], []
    for s in ends:
        delta, u = direction(b, s)
        C.append(u @ jacobian)
        d.append(pace(limit, limit.room - delta) - u @ drift)
    return Constraint.rows(C, d, limit.row_names)


@constraint.register
def entry_sphere(limit: EntrySphere, state: ArmState, reference: Reference) -> Constraint:
    """See EntrySphere."""
    b, jacobian, drift = seen(limit, state, reference)
    delta, u = direction(b, nearest(limit, state, b))
    d = pace(limit, limit.room - delta) - u @ drift
    return Constraint.rows([u @ jacobian], [d], limit.row_names)


def seen(limit: SphereLimit, state: ArmState, reference: Reference) -> tuple[Array, Array, Array]:
    """A sphere's centre b (3,) in the effector's axes, db/dv (3, nv), db/dt with joints still."""
    centre, velocity = np.array(limit.centre), np.array(limit.velocity)
    if limit.on_trocar:
        centre, velocity = centre + reference.pivot, velocity + reference.pivot_dot
    b = state.oMe.actInv(centre)
    jacobian = pin.skew(b) @ state.J_local[3:] - state.J_local[:3]
    return b, jacobian, state.oMe.rotation.T @ velocity


def mount(limit: SphereLimit, state: ArmState) -> float:
    """Where the shaft begins, from the effector [m]."""
    return state.shaft.tip - limit.instrument.length


def nearest(limit: SphereLimit, state: ArmState, b: Array) -> float:
    """The point s of the shaft, from mount to tip, that is nearest to b (3,) [m]."""
    return min(max(float(b[2]), mount(limit, state)), state.shaft.tip)


def direction(b: Array, s: float) -> tuple[float, Array]:
    """Distance delta of b (3,) from s e_z and the unit vector u (3,) there, zero at the centre."""
    apart = np.array([b[0], b[1], b[2] - s])
    delta = math.sqrt(float(apart @ apart))
    return delta, apart / delta if delta > CENTRE else np.zeros(3)
