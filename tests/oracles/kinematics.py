"""The kinematic Hessian, by Lie brackets."""

from __future__ import annotations

import numpy as np

from rcmqp.maths.dualquaternion import Array

_LEVI_CIVITA: Array = np.cross(np.eye(3)[:, None], np.eye(3)).transpose(2, 0, 1)
"""(3, 3, 3): (a x b)_i = sum_jk e[i, j, k] a_j b_k."""


def kinematic_hessian(J_local: Array) -> Array:
    """Kinematic Hessian (6, nv, nv) of a serial chain: H[:, i, j] = d J_local[:, i] / d q_j.

    A column of the local Jacobian changes only with the joints beyond its own, by their Lie
    bracket: d J_i / d q_j = [J_i, J_j] for i < j, else 0.

    Args:
        J_local: (6, nv) linear then angular, in the effector frame.
    """
    v, w = J_local[:3], J_local[3:]
    cross = np.einsum("abc,bi,cj->aij", _LEVI_CIVITA, w, np.concatenate([v, w], axis=1))
    w_x_v, w_x_w = np.split(cross, 2, axis=2)
    beyond = np.triu(np.ones((v.shape[1], v.shape[1])), 1)
    return np.asarray(beyond * np.concatenate([w_x_v - w_x_v.transpose(0, 2, 1), w_x_w]))
