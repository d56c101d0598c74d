"""The manipulability of RCM and tip in numpy; see rcmqp.controllers.task_priority."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from oracles.kinematics import kinematic_hessian
from rcmqp import ArmState, Reference
from rcmqp.maths.dualquaternion import Array

SINGULAR = 1e-12
"""Below this share of the largest, a singular value is taken for this when J^+ shows the way."""


def shaft_jacobian(state: ArmState, reference: Reference) -> tuple[Array, Array]:
    """Jacobian J (5, nv) of the RCM's rows and the tip, and its derivative (5, nv, nv).

    In the effector's axes: two rows of RcmTask, d(pivot, x and y)/dq; then three rows, the
    tip's velocity. The last axis of the derivative is the joint that moves.
    """
    H = kinematic_hessian(state.J_local)
    r = state.oMe.actInv(reference.pivot)
    nu, omega = state.J_local[:3], state.J_local[3:]
    shaft = np.diag([1.0, 1.0, 0.0])  # takes the spin out, as RcmTask does
    r_dot, turned = pin.skew(r) @ omega - nu, shaft @ omega
    seen = pin.skew(r) @ turned - nu
    seen_dot = np.cross(r_dot[:, None, :], turned[:, :, None], axis=0)
    seen_dot = seen_dot + np.einsum("ab,bij->aij", pin.skew(r) @ shaft, H[3:]) - H[:3]
    a = pin.skew(state.oMe.actInv(state.tool.oMt.translation))
    tip, tip_dot = nu - a @ omega, H[:3] - np.einsum("ab,bij->aij", a, H[3:])
    return np.vstack([seen[:2], tip]), np.concatenate([seen_dot[:2], tip_dot])


def manipulability(J: Array, dJ: Array) -> tuple[float, Array]:
    """Measure m = sqrt(det J J^T) and g = J^(+T) grad m (k,), of J (k, nv), dJ/dq (k, nv, nv).

    The gradient is built without dividing by m, so it is right at a singularity, too, where
    J^+ is not: there the direction that J has lost is what g points along.
    """
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    others = np.prod(np.where(np.eye(len(s)), 1.0, s), axis=1)  # m / s_i, also where s_i = 0
    gradient = np.einsum("ri,rik->k", (U * others) @ Vt, dJ)
    g = U @ ((Vt @ gradient) / np.maximum(s, SINGULAR * s[0]))
    return float(np.prod(s)), np.asarray(g)
