"""Least squares in order of priority, by the singular values of each level's Jacobian."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from rcmqp import _kernel
from rcmqp.maths.dualquaternion import Array


def inverse(
    tolerance: float = 0.0, *, beta: float = 0.0, lambda_max: float = 0.0, epsilon: float = 1.0
) -> Array:
    """What stands for the inverse 1 / s of a singular value s, for in_order().

        s / (s^2 + beta^2 + lambda^2),  lambda^2 = lambda_max^2 (1 - (s / epsilon)^2)

    with lambda for a level's least singular value alone, and only where that is below epsilon.

    Args:
        tolerance: 0 stands for the inverse where s is at most this share of the largest singular
            value of the level's A.
        beta: damping of all directions.
        lambda_max: largest further damping of the least singular value.
        epsilon: the least singular value is damped further below this.
    """
    return np.array([tolerance, beta, lambda_max, epsilon])


Levels: TypeAlias = tuple[tuple[Array, Array], ...]
"""Pairs of A (m, n), of rank six or less, and b (m,), the first the most important."""


def in_order(levels: Levels, inverse: Array, rest: Array | None = None) -> tuple[Array, float]:
    """Least squares in order of priority, each level in the nullspace of those above.

        v_k = v_(k-1) + (A_k P_(k-1))^+ (b_k - A_k v_(k-1)),   v = v_m + P_m rest

    with P_k the projector on what the levels up to k leave free (Siciliano and Slotine 1991). A
    direction counts as taken where its singular value of A_k P_(k-1) is not cut off.

    Args:
        levels: rows A v = b of each.
        inverse: (4,) numbers of inverse().
        rest: (n,) what to do with what is left; nothing, if not given.

    Returns:
        v (n,), and the least singular value of the last level's A_m P_(m-1); NaN where a number
        is not finite.
    """
    return _kernel.in_order(levels, inverse, rest)
