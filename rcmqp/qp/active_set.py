"""Bounded linear least squares, exactly: min |M y - c|^2 subject to lower <= R y <= upper.

A primal active-set method (Nocedal and Wright 2006, algorithm 16.3) on orthogonal factors: y
stays feasible, the working set stays independent, each round is an equality-constrained least
squares in closed form, and the multipliers' signs are checked here. M may be rank deficient. The
sizes are those of an arm (up to about ten unknowns, hundreds of rows), so every round factors
afresh and carries no error on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcmqp.dualquaternion import Array

RANK_TOL = 1e-10
"""Singular values below this are zero. M comes scaled by the norm of its level's matrix A (not
by its own: all that is left of A after the earlier levels may be rounding)."""

EPS = float(np.finfo(float).eps)

FEASIBILITY_TOL = 1e-12
"""A bound counts as kept up to this, times the size of y where that is above one."""

MULTIPLIER_TOL = 8.0
"""Multipliers count as zero up to this many times what rounding of the residual makes of them."""

RATE_TOL = 1e-12
"""A row whose product with a unit step is below this does not block the step."""

STALL = 1e-15
"""A shorter step is no progress [unit of v]."""

OVERSHOOT = 1e-13
"""Of the rows that a step meets within this, the one met fastest counts (Harris's ratio test)."""

HEAVY = 1e-4
"""A backend's answer proposes the rows with multipliers above this, times the heaviest."""

USELESS = 1e-2
"""A backend's answer that exceeds a bound by more than this, times their size, is no help."""

INDEPENDENT = 1e-8
"""A row joins a proposed working set if this much of it is new."""


@dataclass(frozen=True, slots=True, eq=False)
class LeastSquares:
    """One level, in the coordinates y that the earlier levels left free; y = 0 is feasible.

    Attributes:
        M: (m, r) level's matrix times the free basis, divided by the level's norm.
        c: (m,) what is missing at y = 0, divided likewise.
        R: (k, r) rows of the inequalities, of at most unit norm.
        lower: (k,) at most zero, -inf for none.
        upper: (k,) at least zero, inf for none.
        noise: (m,) rounding error of c.
        scale: size of the numbers that c is a difference of.
    """

    M: Array
    c: Array
    R: Array
    lower: Array
    upper: Array
    noise: Array
    scale: float

    def feasible(self, y: Array) -> bool:
        """Whether y keeps every bound to FEASIBILITY_TOL."""
        Ry = self.R @ y
        tol = FEASIBILITY_TOL * max(1.0, float(np.abs(Ry).max(initial=0.0)))
        return bool((Ry <= self.upper + tol).all() and (Ry >= self.lower - tol).all())


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """A feasible y and the multipliers that prove it.

    Attributes:
        y: (r,).
        multipliers: (k,) of M^T (M y - c) + R^T multipliers = 0; positive at upper bounds.
        rounds: rounds of the active set; 0 if a proposal or the closed form was right at once.
        verified: feasible, with multipliers of the right signs.
    """

    y: Array
    multipliers: Array
    rounds: int
    verified: bool


@dataclass(slots=True)
class _Working:
    """Rows held at a bound; side is +1 at the upper, -1 at the lower one."""

    rows: list[int]
    sides: list[int]


def pseudo_solve(M: Array, c: Array) -> tuple[Array, Array, Array]:
    """Least squares of least norm, refined once, and the spaces that come with it.

    Args:
        M: (m, r), scaled so that RANK_TOL is absolute.
        c: (m,).

    Returns:
        y (r,); N (r, r - rank) orthonormal, M N = 0; U (m, rank) orthonormal basis of M's range.
    """
    if not len(M):
        return np.zeros(M.shape[1]), np.eye(M.shape[1]), np.zeros((0, 0))
    U, s, Vt = np.linalg.svd(M, full_matrices=len(M) < M.shape[1])
    rank = int((s > RANK_TOL).sum())
    U = U[:, :rank]
    inverse = Vt[:rank].T @ (U / s[:rank]).T
    y: Array = inverse @ c
    return y + inverse @ (c - M @ y), Vt[rank:].T, U


def solve(problem: LeastSquares, max_rounds: int, start: Array | None = None) -> Optimum:
    """The active-set method from a feasible ``start`` (y = 0 by default)."""
    y = np.zeros(problem.M.shape[1]) if start is None else start
    return _rounds(problem, y, _Working([], []), max_rounds)


def polish(problem: LeastSquares, y: Array, z: Array, max_rounds: int) -> Optimum:
    """The exact optimum near a backend's answer, whatever that answer's quality.

    The rows that the answer holds at a bound become the working set, heaviest multiplier
    first; the optimum on it is verified, and repaired by the active-set method if it fails.

    Args:
        problem: the level.
        y: (r,) the backend's answer, to its tolerance.
        z: (k,) its multipliers, positive at upper bounds.
        max_rounds: of the repair.
    """
    Ry, heaviest = problem.R @ y, float(np.abs(z).max(initial=0.0))
    finite = np.concatenate([problem.upper, -problem.lower])
    size = min(1.0, float(np.max(finite, where=np.isfinite(finite), initial=0.0)))
    if not np.maximum(Ry - problem.upper, problem.lower - Ry).max(initial=0.0) < USELESS * size:
        return solve(problem, max_rounds)
    bound = np.where(z > 0.0, problem.upper, problem.lower)
    near = np.flatnonzero((np.abs(z) > HEAVY * heaviest) & np.isfinite(bound))
    near = near[np.argsort(-np.abs(z[near]), kind="stable")]
    if near.size:
        _, T = np.linalg.qr(problem.R[near].T)
        near = near[: len(T)][np.abs(np.diag(T)) > INDEPENDENT]
    sides = np.where(z[near] > 0.0, 1, -1)
    working = _Working([int(i) for i in near], [int(i) for i in sides])
    if near.size:
        Q, T = np.linalg.qr(problem.R[near].T)
        y = Q @ np.linalg.solve(T.T, bound[near])
    else:
        y = np.zeros(y.size)
    step, U = _newton(problem, y, working)
    y = y + step
    if problem.feasible(y):
        multipliers, worst = _multipliers(problem, y, working, U)
        if worst is None:
            return Optimum(y, multipliers, 0, True)
        return _rounds(problem, y, working, max_rounds)
    share, _, _ = _longest(problem, np.zeros(y.size), y, [], False)
    return _rounds(problem, share * y, _Working([], []), max_rounds)


def _newton(problem: LeastSquares, y: Array, working: _Working) -> tuple[Array, Array]:
    """Step (r,) to the optimum on the working set, and the range of M along that set."""
    missing = problem.c - problem.M @ y
    if not working.rows:
        step, _, U = pseudo_solve(problem.M, missing)
        return step, U
    Q, _ = np.linalg.qr(problem.R[working.rows].T, mode="complete")
    free = Q[:, len(working.rows) :]
    along, _, U = pseudo_solve(problem.M @ free, missing)
    return free @ along, U


def _longest(
    problem: LeastSquares, y: Array, step: Array, held: list[int], lowest: bool
) -> tuple[float, int, int]:
    """Share in [0, 1] of a step that is feasible, the row that blocks it (or -1), its side."""
    rate, Ry = problem.R @ step, problem.R @ y
    least = RATE_TOL * float(np.linalg.norm(step))
    rate[held] = 0.0
    moving = np.flatnonzero(np.abs(rate) > least)
    if not moving.size:
        return 1.0, -1, 0
    bound = np.where(rate[moving] > 0, problem.upper[moving], problem.lower[moving])
    speed = np.abs(rate[moving])
    gaps = np.maximum((bound - Ry[moving]) * np.sign(rate[moving]), 0.0)
    shares, reach = gaps / speed, float(((gaps + OVERSHOOT) / speed).min())
    if not reach < np.inf:
        return 1.0, -1, 0
    tied = np.flatnonzero(shares <= reach)
    best = int(tied[0] if lowest else tied[np.argmax(speed[tied])])
    share, row = float(shares[best]), int(moving[best])
    return (share, row, 1 if rate[row] > 0 else -1) if share < 1.0 else (1.0, -1, 0)


def _multipliers(
    problem: LeastSquares,
    y: Array,
    working: _Working,
    U: Array,
    lowest: bool = False,
) -> tuple[Array, int | None]:
    """Multipliers (k,), and the place in the working set of one with the wrong sign.

    At the optimum the residual has no part in U, the range of M along the working set, so what
    is there is rounding and goes. That is what lets rows of very different size share a level:
    the heavy ones' rounding would drown the light ones' residual.
    """
    full = np.zeros(len(problem.R))
    if not working.rows:
        return full, None
    residual = problem.M @ y - problem.c
    residual = residual - U @ (U.T @ residual)
    noise = np.abs(np.eye(len(U)) - U @ U.T) @ problem.noise
    noise = noise + EPS * np.abs(residual)
    tol = MULTIPLIER_TOL * float(np.linalg.norm(np.abs(problem.M).T @ noise))
    Q, T = np.linalg.qr(problem.R[working.rows].T)
    found = np.linalg.solve(T, -(Q.T @ (problem.M.T @ residual)))
    signed = found * working.sides
    full[working.rows] = np.where(signed > 0.0, found, 0.0)
    wrong = np.flatnonzero(signed < -tol)
    if not wrong.size:
        return full, None
    best = min(wrong, key=lambda i: working.rows[i] if lowest else signed[i])
    return full, int(best)


def _rounds(problem: LeastSquares, y: Array, working: _Working, max_rounds: int) -> Optimum:
    """The active-set rounds: to the optimum on the working set, or to the row that blocks.

    In a degenerate vertex steps have zero length; after some of those, rows are dropped and
    added by lowest index (Bland's rule), which cannot cycle.
    """
    stalls = 0
    for rounds in range(1, max_rounds + 1):
        lowest = stalls > 2 * y.size
        step, U = _newton(problem, y, working)
        share, row, side = _longest(problem, y, step, working.rows, lowest)
        y = y + share * step
        stalls = 0 if share * float(np.linalg.norm(step)) > STALL else stalls + 1
        if row >= 0:
            working.rows.append(row)
            working.sides.append(side)
            continue
        multipliers, worst = _multipliers(problem, y, working, U, lowest)
        if worst is None:
            return Optimum(y, multipliers, rounds, problem.feasible(y))
        working.rows.pop(worst)
        working.sides.pop(worst)
    return Optimum(y, np.zeros(len(problem.R)), max_rounds, False)
