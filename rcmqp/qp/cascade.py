"""The lexicographic descent: a point, the directions still free, and one level after the other.

For convex least squares A_k v is the same at every optimum of level k. So later levels may move
in the null space of A_k and nowhere else, which keeps A_k v exactly: v <- v + Z y with Z an
orthonormal basis of what is free. y = 0 is always feasible. A bound with a positive multiplier is
active at every optimum of its level (complementary slackness), so it leaves Z too; every other
bound stays an inequality. This is the null-space form of Escande, Mansard and Wieber (2014),
with the bounds above all levels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rcmqp.dualquaternion import Array
from rcmqp.qp.active_set import EPS, LeastSquares, polish, pseudo_solve, solve
from rcmqp.qp.levels import Route
from rcmqp.qp.problem import QPSolution, Status

FIXED = 1e-11
"""A unit row whose part in the free directions is below this cannot change any more."""

STRONG = 1e-7
"""A bound leaves Z if its multiplier is above this, relative to the level's size. A smaller one
stays an inequality, which is never wrong, only more degenerate."""

CARRIED = 1e-12
"""A unit row that is exceeded by less is kept, times its size where that is above one."""

LARGEST = 1e150
"""Larger numbers overflow when squared: the level is left alone."""

Proposer = Callable[[LeastSquares], QPSolution]
"""Asks a backend for one level's y (v), and for the multipliers of its rows (z)."""


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """What one level did.

    Attributes:
        route: how it was answered.
        multipliers: (k,) of the unit rows, in the level's own units squared.
        Z: (n, r) what was free before the level.
        rounds: active-set rounds.
        backend: the backend's verdict, None if it was not asked.
    """

    route: Route
    multipliers: Array
    Z: Array
    rounds: int = 0
    backend: Status | None = None


def size(x: Array) -> float:
    """Euclidean norm of any array, also where its squares would over- or underflow."""
    norm = math.sqrt(float(np.vdot(x, x)))
    if 1e-150 < norm < LARGEST or not x.size:
        return norm
    largest = float(np.abs(x).max())
    return largest * float(np.linalg.norm(x / largest)) if 0.0 < largest < np.inf else largest


class Cascade:
    """A feasible point and the directions in which it may still move.

    Attributes:
        v: (n,) the point.
        Z: (n, r) orthonormal basis of the free directions.
        G: (n + m, n) the identity, then the hard rows scaled to unit norm.
        norms: (n + m,) what the rows were divided by; 1 for the box and for zero rows.
        lower: (n + m,) bounds on G v.
        upper: (n + m,); after level 0 with the excess carried.
        asked: (n + m,) upper as it was asked.
        unit: what the numbers of a Descent are multiples of, 1 until rescale().
        small: size of the box where that is below one: what small residuals are relative to.
    """

    def __init__(
        self, v: Array, lower: Array, upper: Array, C: Array, d: Array, max_rounds: int
    ) -> None:
        n = v.size
        norms = np.array([size(row) for row in C])
        self._counts = np.concatenate([np.zeros(n, dtype=bool), norms > 0.0])
        norms[norms == 0.0] = 1.0
        self.v, self.max_rounds = v, max_rounds
        self.unit = self.small = 1.0
        self.G = np.concatenate([np.eye(n), C / norms[:, None]])
        self.norms = np.concatenate([np.ones(n), norms])
        self.lower = np.concatenate([lower, np.full(len(C), -np.inf)])
        self.upper = self.asked = np.concatenate([upper, d / norms])
        self.Z = np.eye(n)[:, lower < upper]
        self._can_bind = np.isfinite(self.lower) | np.isfinite(self.upper)

    def satisfy_rows(self) -> Descent:
        """Level 0: from a point in the box, exceed the hard rows least; carry the excess.

        min sum_i max(0, C_i v - d_i)^2 in the box. The rows V exceeded at the optimum are
        searched: least squares of V's excess while the other rows are kept; then a row that
        ends below its bound leaves V, and one whose multiplier says that exceeding it pays
        enters. The sum falls from round to round, so that no V comes back.
        """
        Z, rounds, route = self.Z, 0, Route.CLOSED_FORM
        box = np.arange(len(self.G)) < self.v.size
        multipliers, V = np.zeros(len(self.G)), self._over() > 1.0
        for _ in range(self.max_rounds):
            if not V.any():
                break
            weights = self.norms[V]
            A, b = self.G[V] * weights[:, None], self.upper[V] * weights
            problem, rows, weight = self._problem(A, b, np.where(V, np.inf, self.upper))
            if not weight < LARGEST or not problem.scale < LARGEST:
                route = Route.KEPT
                break
            optimum = solve(problem, self.max_rounds)
            rounds += optimum.rounds
            route = Route.ACTIVE_SET if optimum.verified else Route.UNVERIFIED
            self.v = self.v + self.Z @ optimum.y
            multipliers[:] = 0.0
            multipliers[rows] = optimum.multipliers * weight**2
            strong = np.abs(multipliers) > STRONG * problem.scale * weight**2
            after = (V & (self._over() > -1.0)) | (strong & ~box)
            if np.array_equal(after, V):
                self._fix(np.concatenate([self.G[self._over() > 1.0], self.G[strong & box]]))
                break
            V = after
        else:
            route = Route.UNVERIFIED
        if not V.any():
            multipliers[:] = 0.0
        carried = np.maximum(self.upper, self.G @ self.v)
        self.upper = np.where(box, self.upper, carried)
        return Descent(route, multipliers, Z, rounds)

    def descend(self, A: Array, b: Array, propose: Proposer | None) -> Descent:
        """One level: move to where |A v - b| is least, and keep A v from now on."""
        Z, zero = self.Z, np.zeros(len(self.G))
        if not Z.shape[1] or not len(A):
            return Descent(Route.CLOSED_FORM, zero, Z)
        problem, rows, weight = self._problem(A, b, self.upper)
        if weight == 0.0:
            return Descent(Route.CLOSED_FORM, zero, Z)
        if not weight < LARGEST or not problem.scale < LARGEST:
            return Descent(Route.KEPT, zero, Z)
        y, free, _ = pseudo_solve(problem.M, problem.c)
        if problem.feasible(y):
            self.v, self.Z = self.v + Z @ y, Z @ free
            return Descent(Route.CLOSED_FORM, zero, Z)
        proposal = propose(problem) if propose else None
        verdict = proposal.status if proposal else None
        optimum = None
        if proposal and verdict is Status.SOLVED:
            optimum = polish(problem, proposal.v, proposal.z, self.max_rounds)
        if optimum is None or not optimum.verified:
            optimum = solve(problem, self.max_rounds)
        route = Route.ACTIVE_SET if optimum.rounds else Route.POLISHED
        if not optimum.verified:
            route = Route.UNVERIFIED
        if not np.isfinite(optimum.y).all() or not problem.feasible(optimum.y):
            return Descent(Route.UNVERIFIED, zero, Z, optimum.rounds, verdict)
        multipliers = zero
        multipliers[rows] = optimum.multipliers * weight**2
        self.v = self.v + Z @ optimum.y
        strong = np.abs(multipliers) > STRONG * problem.scale * weight**2
        self._fix(np.concatenate([A / weight, self.G[strong]]))
        return Descent(route, multipliers, Z, optimum.rounds, verdict)

    def rescale(self, unit: float) -> None:
        """Go from multiples of ``unit``, a power of two, to the caller's unit; exact."""
        self.unit, self.small = unit, min(1.0, unit)
        self.v, self.lower, self.upper = self.v * unit, self.lower * unit, self.upper * unit
        self.asked = self.asked * unit

    def excess(self) -> float:
        """The most by which v exceeds a bound, over the size of G v or ``small``."""
        Gv = self.G @ self.v
        over = float(np.maximum(Gv - self.upper, self.lower - Gv).max(initial=0.0))
        return over / max(self.small, float(np.abs(Gv).max(initial=0.0)))

    def kkt(self, done: Descent, A: Array, b: Array, residual: Array) -> float:
        """Residual of a level's optimality conditions at v, from the problem's own numbers.

        The larger of: gradient A^T residual + G^T multipliers along what was free before the
        level, and multiplier times slack at the bound of the multiplier's sign, over ``small``;
        both over the size of A times b, or ``small``.

        Args:
            done: the level.
            A: (m, n) its matrix.
            b: (m,) its goal.
            residual: (m,) A v - b, or for level 0 the excess of the hard rows.
        """
        gradient, lam = A.T @ residual, done.multipliers * self.unit
        scale = max(self.small, size(A) * max(size(b), size(residual)))
        worst = 0.0
        if lam.any():
            gradient = gradient + self.G.T @ lam
            Gv = self.G @ self.v
            slack = np.where(lam > 0.0, self.upper - Gv, Gv - self.lower)
            held = lam != 0.0
            worst = float(np.abs(lam[held] * slack[held]).max()) / self.small
        worst = max(worst, float(np.abs(done.Z.T @ gradient).max(initial=0.0))) / scale
        return worst if worst < np.inf else np.inf

    def _over(self) -> Array:
        """(n + m,) by how much each hard row is exceeded, in tolerances; box and zero rows not."""
        Gv = self.G @ self.v
        over: Array = (Gv - self.upper) / (CARRIED * np.maximum(1.0, np.abs(Gv)))
        over[~self._counts] = -np.inf
        return over

    def _problem(
        self, A: Array, b: Array, upper: Array
    ) -> tuple[LeastSquares, NDArray[np.intp], float]:
        """The level in y, the rows of G that can still matter, and the norm of A."""
        weight = size(A) or 1.0
        R, Gv = self.G @ self.Z, self.G @ self.v
        rows = np.flatnonzero(self._can_bind & (np.vecdot(R, R) > FIXED**2))
        A = A / weight
        Av, b = A @ self.v, b / weight
        problem = LeastSquares(
            A @ self.Z,
            b - Av,
            R[rows],
            np.minimum((self.lower - Gv)[rows], 0.0),
            np.maximum((upper - Gv)[rows], 0.0),
            EPS * (np.abs(b) + np.abs(A) @ np.abs(self.v)),
            size(b) + size(Av),
        )
        return problem, rows, weight if A.any() else 0.0

    def _fix(self, rows: Array) -> None:
        """Take the span of ``rows``, of about unit norm, out of the free directions."""
        _, free, _ = pseudo_solve(rows @ self.Z, np.zeros(len(rows)))
        self.Z = self.Z @ free
