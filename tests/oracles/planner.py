"""Equations (7)-(11) of the path planner in numpy, as rcmqp.references.planner has them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import allowed, whole


def constrain(x_rcm: ArrayLike, x: ArrayLike) -> tuple[Array, float]:
    """Rotation r_rcm (4,) and depth t_z [m] of the pose nearest to x that obeys the RCM.

    Equations (7) and (8). The rotation is kept; of the translation along the shaft's own axes,

        t_rcm = translation((x_rcm r_rcm)* x),

    the two lateral components, which are the trocar's offsets from the shaft, are dropped.

    Mended: the paper prints x_rcm^l in that line, which gives another vector.

    Args:
        x_rcm: (8,) pose at the trocar, x_d(0).
        x: (8,) the effector's pose.
    """
    r = dq.P(dq.mul(dq.conj(x_rcm), x))
    t = dq.translation(dq.mul(dq.conj(dq.mul(x_rcm, dq.from_rotation(r))), x))
    return r, float(t[2])


def plan(x_rcm: ArrayLike, x: ArrayLike, x_d: ArrayLike, points: int) -> Array:
    """Poses (N + 2, 8) from x to x_d by way of N points, each of them through the RCM.

        r_inc = exp(log(r_l* r_d) / (N + 1))                            (9)
        t_inc = (t_d - t_l) / (N + 1)                                   (10)
        c(m)  = r_l r_inc^m (1 + eps (t_l + m t_inc) k / 2)             (11)

    and the poses are x_rcm c(m), m = 0 .. N + 1.

    Mended: c(i) is c(m); t_inc, printed as a power, is multiplied by m; m runs from 0, the
    start, not 1. The sign of r_d is chosen so that the turn is the short way round.

    Args:
        x_rcm: (8,) pose at the trocar, x_d(0).
        x: (8,) start; brought to the nearest pose that obeys the RCM, which is the first pose.
        x_d: (8,) end; likewise, and the last pose.
        points: N, at least 1.

    Raises:
        InvalidCommand: a pose is not a unit dual quaternion.
        OptionError: points is less than 1.
    """
    points = allowed("points", points, whole(1))
    x_rcm, x, x_d = (
        dq.check_unit(pose, what) for pose, what in ((x_rcm, "x_rcm"), (x, "x"), (x_d, "x_d"))
    )
    r_l, t_l = constrain(x_rcm, x)
    r_d, t_d = constrain(x_rcm, dq.align_sign(x_d, x))
    part = np.arange(points + 2) / (points + 1)
    r = dq.quaternion_mul(r_l, dq.quaternion_exp(part[:, None] * _log_turn(r_l, r_d)))
    return _constrained_pose(x_rcm, r, t_l + part * (t_d - t_l))


def _log_turn(r_l: Array, r_d: Array) -> Array:
    """log(r_l* r_d) (3,): half of the turn between two rotations, in turned axes."""
    return dq.quaternion_log(dq.quaternion_mul(dq.quaternion_conj(r_l), r_d))


def _constrained_pose(x_rcm: Array, r: Array, depth: Array) -> Array:
    """x_rcm r (1 + eps t_z k / 2) (..., 8) of rotations r (..., 4) and depths (...) [m]."""
    shift = dq.from_translation(np.stack([0.0 * depth, 0.0 * depth, depth], axis=-1))
    return dq.mul(x_rcm, dq.mul(dq.from_rotation(r), shift))
