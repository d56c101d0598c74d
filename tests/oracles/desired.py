"""The desired effector, as the tasks in the world's geometry need it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.view import Reference


@dataclass(frozen=True, slots=True, eq=False)
class Desired:
    """Placement and twist of the desired effector.

    Attributes:
        R: (3, 3) its axes in the world.
        p: (3,) its origin in the world [m].
        nu: (3,) its linear velocity [m/s], in its own axes.
        omega: (3,) its angular velocity [rad/s], in its own axes.
    """

    R: Array
    p: Array
    nu: Array
    omega: Array


def desired(reference: Reference) -> Desired:
    """Placement and twist of x_d.

    omega + eps nu = 2 x_d* x_d_dot, vec(r a r*) = H+(r) H-(r*) vec(a) and t = 2 D(x_d) r*.
    """
    x_d = reference.x_d
    r, r_conj_right = dq.P(x_d), H4_minus(dq.quaternion_conj(dq.P(x_d)))
    R = (H4_plus(r) @ r_conj_right)[1:, 1:]
    p = 2.0 * (r_conj_right @ dq.D(x_d))[1:]
    twist = 2.0 * (dq.H8_plus(dq.conj(x_d)) @ reference.x_d_dot)
    return Desired(R, p, twist[5:8], twist[1:4])


def H4_plus(a: Array) -> Array:
    """Hamilton operator (4, 4) of a left factor: vec(a b) = H4+(a) vec(b)."""
    return np.column_stack([dq.quaternion_mul(a, unit) for unit in np.eye(4)])


def H4_minus(b: Array) -> Array:
    """Hamilton operator (4, 4) of a right factor: vec(a b) = H4-(b) vec(a)."""
    return np.column_stack([dq.quaternion_mul(unit, b) for unit in np.eye(4)])
