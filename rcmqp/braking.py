"""From motion to rest, inside the acceleration limits: what every safe stop does."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from rcmqp.arm import Arm
from rcmqp.dualquaternion import Array
from rcmqp.insertion import Insertion

GAIN = 60.0
"""How fast the shaft goes back to where it was when the stop began [1/s]."""


def braking(
    insertion: Insertion, angles: Array, v: Array, period: float, pivot: Array
) -> Iterator[Array]:
    """Joint velocities (nv,) [rad/s], one a cycle, from ``v`` to rest, the last one zero.

    Each is slower() of the one before, at the angles to which the joints have gone meanwhile. The
    shaft goes on through the place where it is nearest to the trocar now: the RCM error does not
    grow, however well the trocar is known. Where the angles are not known, or that takes more
    than twice as long as it need, all joints slow down in proportion.

    Args:
        insertion: whose arm, and its limits.
        angles: (nv,) joint angles now [rad]; NaN or infinite where they are not known.
        v: (nv,) joint velocity, until the first of these [rad/s].
        period: [s].
        pivot: (3,) the trocar in the world, as last known [m].
    """
    arm, v = insertion.arm, _known(v)
    held: Array | None = None  # in the world [m]
    q = arm.configuration(angles) if np.isfinite(angles).all() else None
    twice = 2.0 * float(np.max(np.abs(v) / (arm.acceleration * period)))
    for cycle in itertools.count():
        rows = sideways = None
        if q is not None:  # v holds until the next one
            q = arm.integrate(q, v, period)
            state = insertion.state(q)
            if held is None:
                depth = state.oMe.actInv(np.asarray(pivot, dtype=float))[2]
                held = state.oMe.act(np.array([0.0, 0.0, depth]))
            seen = state.oMe.actInv(held)
            rows = lateral(state.J_local, float(seen[2]))
            sideways = min(GAIN, 0.5 / period) * seen[:2]
        v = slower(arm, angles, v, period, rows if cycle < twice else None, sideways)
        v.setflags(write=False)
        if q is not None:
            angles = arm.angles(q)
        yield v
        if not v.any():
            return


def slower(
    arm: Arm,
    angles: Array,
    v: Array,
    period: float,
    rows: Array | None = None,
    sideways: Array | None = None,
) -> Array:
    """Joint velocity (nv,) of the next cycle on the way to rest [rad/s].

    It differs from ``v`` by at most the acceleration limits times the period; a joint without
    one stops at once only if all do. With s as small as these limits allow, it is

        s (v - A^+ A v) + A^+ b,

    A the ``rows`` and b the ``sideways``, so that the shaft stays on the trocar; s v, all joints
    in proportion, where no rows are given or the limits do not allow that. Where a joint that
    moves would so leave its position limits, each slows down by itself, as fast as it may. A joint
    whose angle is not known has no position limits to leave.

    Args:
        arm: whose limits.
        angles: (nv,) joint angles [rad]; NaN or infinite where they are not known.
        v: (nv,) joint velocity now [rad/s]; a joint whose velocity is not finite is stopped,
            for what is not known cannot be slowed down.
        period: [s].
        rows: (2, nv) velocity of the shaft at the trocar, across it, per joint velocity.
        sideways: (2,) what it is to be [m/s]; zero if not given.
    """
    v = _known(v)
    most = arm.acceleration * period
    cycles = math.ceil(float(np.max(np.abs(v) / most)) - 1e-9)
    if cycles <= 1:
        return np.zeros_like(v)
    end = angles + period * v * (cycles + 1) / 2.0
    leaves = ((v < 0.0) & (end < arm.lower)) | ((v > 0.0) & (end > arm.upper))
    if np.any(np.isfinite(angles) & leaves):
        return np.asarray(np.sign(v) * np.maximum(np.abs(v) - most, 0.0))
    if rows is not None and np.isfinite(rows).all():
        for wanted in (np.zeros(2) if sideways is None else sideways, np.zeros(2)):
            found = _on_the_trocar(rows, wanted, v, most)
            if found is not None:
                return found
    return np.asarray((1.0 - 1.0 / cycles) * v)


def lateral(J_local: Array, depth: float) -> Array:
    """Velocity (2, nv) of the shaft's point at ``depth`` [m] from the effector, across the shaft.

    Args:
        J_local: (6, nv) linear then angular, in the effector's axes.
        depth: along the shaft [m].
    """
    nu, omega = J_local[:3], J_local[3:]
    return np.array([nu[0] + depth * omega[1], nu[1] - depth * omega[0]])


def _on_the_trocar(rows: Array, wanted: Array, v: Array, most: Array) -> Array | None:
    """The slowest s (v - A^+ A v) + A^+ wanted within v +- most, s from 0 to 1; None: none is."""
    inverse = np.linalg.pinv(rows, rcond=1e-6)
    along, across = v - inverse @ (rows @ v), inverse @ wanted
    still = np.abs(along) < 1e-12
    low, high = v - most - across, v + most - across
    if np.any(still & ((low > 0.0) | (high < 0.0))):
        return None
    ends = np.divide([low, high], along, out=np.array([low, high]), where=~still)
    ends[:, still] = [[-np.inf], [np.inf]]
    least = max(0.0, float(np.min(ends, axis=0).max()))
    if least > min(1.0, float(np.max(ends, axis=0).min())):
        return None
    return np.asarray(least * along + across)


def _known(v: Array) -> Array:
    return np.where(np.isfinite(v), v, 0.0)
