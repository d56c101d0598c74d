"""From motion to rest, inside the acceleration limits: what every safe stop does."""

from __future__ import annotations

import math

import numpy as np

from rcmqp.arm import Arm
from rcmqp.dualquaternion import Array


def braking(arm: Arm, angles: Array, v: Array, period: float) -> Array:
    """Joint velocities (m, nv) [rad/s], one a cycle, from ``v`` to rest, the last one zero.

    Each differs from the one before by at most the acceleration limits times the period; a joint
    without one stops at once only if all do. All joints slow down in proportion, so that the
    shaft goes on along its way through the trocar; where one that moves would so leave its
    position limits, each slows down by itself, as fast as it may. A joint whose angle is not
    known has no position limits to leave.

    Args:
        arm: whose limits.
        angles: (nv,) joint angles now [rad]; NaN or infinite where they are not known.
        v: (nv,) joint velocity now [rad/s]; a joint whose velocity is not finite is stopped,
            for what is not known cannot be slowed down.
        period: [s].
    """
    v = np.where(np.isfinite(v), v, 0.0)
    most = arm.acceleration * period
    cycles = max(1, math.ceil(float(np.max(np.abs(v) / most)) - 1e-9))
    share = np.arange(cycles - 1, -1, -1)[:, None] / cycles
    together = share * v
    end = angles + period * (v + together.sum(axis=0))  # v holds until the first of them
    leaves = ((v < 0.0) & (end < arm.lower)) | ((v > 0.0) & (end > arm.upper))
    if not np.any(np.isfinite(angles) & leaves):
        return np.asarray(together)
    steps = np.arange(1, cycles + 1)[:, None]
    return np.asarray(np.sign(v) * np.maximum(np.abs(v) - steps * most, 0.0))
