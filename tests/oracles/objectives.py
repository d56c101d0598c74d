"""Values and gradients of the library's objectives in numpy."""

from __future__ import annotations

import functools

import numpy as np

from oracles.kinematics import kinematic_hessian
from rcmqp.maths.dualquaternion import Array
from rcmqp.tasks.objectives import (
    JointCentring,
    LeastSingularValue,
    Manipulability,
    Objective,
    SingularityProduct,
)
from rcmqp.world.arm import ArmState


@functools.singledispatch
def value(objective: Objective, state: ArmState) -> tuple[float, Array]:
    """What the objective's evaluate() is to give."""
    raise TypeError(f"no oracle for {type(objective).__name__}; register one here")


@value.register
def singularity_product(objective: SingularityProduct, state: ArmState) -> tuple[float, Array]:
    """See SingularityProduct."""
    theta = state.angles + objective._offsets
    s, c = np.sin(theta), np.cos(theta)
    s3, s4, s5 = s[2], s[3], s[4]
    c2, c6 = c[1], c[5]
    elbow = s4**2
    shoulder, wrist = 1.0 - (c2 * s3) ** 2, 1.0 - (c6 * s5) ** 2
    both = 1.0 - (c2 * c6) ** 2
    twice = np.sin(2.0 * theta)  # d(sin^2) = sin 2 theta = -d(cos^2)
    gradient = np.array(
        [
            0.0,
            elbow * wrist * twice[1] * (s3**2 * both + shoulder * c6**2),
            -elbow * wrist * both * c2**2 * twice[2],
            shoulder * wrist * both * twice[3],
            -elbow * shoulder * both * c6**2 * twice[4],
            elbow * shoulder * twice[5] * (s5**2 * both + wrist * c2**2),
            0.0,
        ]
    )
    return float(elbow * shoulder * wrist * both), gradient


@value.register
def manipulability(objective: Manipulability, state: ArmState) -> tuple[float, Array]:
    """See Manipulability."""
    U, s, Vt = np.linalg.svd(state.J_local, full_matrices=False)
    others = np.prod(np.where(np.eye(len(s)), 1.0, s), axis=1)  # m / s_i, also where s_i = 0
    weighted = (U * others) @ Vt
    gradient = np.einsum("ri,rik->k", weighted, kinematic_hessian(state.J_local))
    return float(np.prod(s)), gradient


@value.register
def least_singular_value(objective: LeastSingularValue, state: ArmState) -> tuple[float, Array]:
    """See LeastSingularValue."""
    U, s, Vt = np.linalg.svd(state.J_local, full_matrices=False)
    hessian = kinematic_hessian(state.J_local)
    return float(s[-1]), np.einsum("r,rik,i->k", U[:, -1], hessian, Vt[-1])


@value.register
def joint_centring(objective: JointCentring, state: ArmState) -> tuple[float, Array]:
    """See JointCentring."""
    middle, half = objective._middle, objective._half
    offset = (state.angles - middle) / half
    count = int(np.isfinite(half).sum())
    return 1.0 - float(offset @ offset) / count, -2.0 * offset / (half * count)
