"""Inverses by LAPACK's singular values, and least squares in order of priority, in numpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rcmqp.maths.dualquaternion import Array


@dataclass(frozen=True, slots=True, eq=False)
class SingularValues:
    """A = U diag(s) Vt, as far as its rank can go.

    Attributes:
        U: (m, r) orthonormal columns.
        s: (r,) largest first.
        Vt: (r, n) orthonormal rows.
    """

    U: Array
    s: Array
    Vt: Array

    @classmethod
    def of(cls, A: Array, rank: int | None = None) -> Self:
        """Decompose A (m, n); ``rank`` is the largest it can have, if that is known."""
        U, s, Vt = np.linalg.svd(A, full_matrices=False)
        return cls(U[:, :rank], s[:rank], Vt[:rank])

    def kept(self, tolerance: float, largest: float | None = None) -> NDArray[np.bool_]:
        """Which singular values (r,) are above ``tolerance`` times the largest, or another."""
        return self.s > tolerance * (self.s[0] if largest is None else largest)

    def truncated(self, kept: NDArray[np.bool_]) -> Array:
        """1 / s where kept, else 0."""
        return np.divide(1.0, self.s, out=np.zeros_like(self.s), where=kept)

    def solve(self, inverse: Array, b: Array) -> Array:
        """V diag(inverse) U^T b: (n,) for b (m,), with a number for each singular value."""
        return np.asarray(self.Vt.T @ (inverse * (self.U.T @ b)))

    def remainder(self, v: Array, kept: NDArray[np.bool_]) -> Array:
        """(I - A^+ A) v: what of v (n,) the kept directions do not see."""
        row_space = self.Vt[kept]
        return np.asarray(v - row_space.T @ (row_space @ v))


def in_order(
    levels: Sequence[tuple[Array, Array]], rest: Array, tolerance: float
) -> tuple[Array, float]:
    """Least squares in order of priority, each level in the nullspace of those above.

        v_k = v_(k-1) + (A_k P_(k-1))^+ (b_k - A_k v_(k-1)),   v = v_m + P_m rest

    with P_k the projector on what the levels up to k leave free (Siciliano and Slotine 1991).

    Args:
        levels: pairs of A (m, n) and b (m,), the first the most important.
        rest: (n,) what to do with what is left.
        tolerance: a singular value of A_k P_(k-1) counts as zero up to ``tolerance`` times the
            largest of A_k itself.

    Returns:
        v (n,), and the least singular value of the last level's A_m P_(m-1).
    """
    n = rest.size
    v, rows, least = np.zeros(n), np.zeros((0, n)), 0.0
    for A, b in levels:
        svd = SingularValues.of(A - (A @ rows.T) @ rows)
        kept = svd.kept(tolerance, float(np.linalg.norm(A, 2)))
        step = svd.solve(svd.truncated(kept), b - A @ v)
        v = v + step - rows.T @ (rows @ step)  # again, for where A P is small beside A
        rows, least = np.vstack([rows, svd.Vt[kept]]), float(svd.s[-1])
    return v + rest - rows.T @ (rows @ rest), least
