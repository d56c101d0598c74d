"""The strict hierarchical least-squares solver: lexicographic, exact, and it always answers."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.dualquaternion import Array
from rcmqp.errors import OptionError, UnknownName
from rcmqp.qp.active_set import LeastSquares
from rcmqp.qp.cascade import Cascade, Descent
from rcmqp.qp.levels import Bounds, HierarchySolution, Level, LevelResult, Route
from rcmqp.qp.problem import QP, InvalidProblem, QPSolution, QPSolver, Status, checked
from rcmqp.qp.solvers import check_options, get_solver, solver_names

EXACT = 1e-8
"""A level whose KKT residual is above this is not called exact."""

REACHED = 1e-9
"""A level is reached if its residual is below this, relative to the level's numbers."""

TOUCHING = 1e-9
"""A bound this near counts as active, relative to its size where that is above one."""

_REGULARISATION = 1e-6
_DEFAULTS: dict[str, dict[str, Any]] = {"proxqp": {"max_iter": 20, "max_iter_in": 20}}
"""A proposal need not be perfect, but quick: without these one took 0.5 s."""


def hierarchy_backends() -> list[str]:
    """Backends that a Hierarchy accepts here: its own, and every QP solver installed."""
    names = solver_names()
    return ["active_set", *(["daqp_levels"] if "daqp" in names else []), *names]


class Hierarchy:
    """Minimises |A_1 v - b_1|, then |A_2 v - b_2| without changing A_1 v, and so on, in bounds.

    Above all levels: the box, which always holds, and the hard rows, exceeded least where they
    cannot all hold. Below all levels: |v - v_rest|, which makes v unique.

    Every level first tries its closed form. If a bound is in the way, the backend solves the
    level as a QP; its active set is only a proposal, whose optimum is computed in closed form
    and verified here, and repaired where it fails. So v does not depend on the backend or its
    tolerance, only the time does, and neither does it depend on earlier calls beyond rounding.

    The KKT residual of each level is computed at the final v from the problem's own numbers:
    stationarity, signs, complementarity, feasibility, each relative to the size of the terms
    where that is above one. A level above 1e-8 is never called exact.

    Singular values of a level, in what the levels above left free, count as zero below 1e-10 of
    that level's norm.

    Attributes:
        backend: ``"proxqp"``, ``"daqp"``, any solver of ``solver_names()``; ``"active_set"`` for
            none at all; or ``"daqp_levels"``, all levels in one native call and inexact, see
            ``daqp_levels.py``.
        max_rounds: of the active set, for each level.
    """

    def __init__(self, backend: str = "proxqp", *, max_rounds: int = 100, **options: Any) -> None:
        self.backend, self.max_rounds = backend, int(max_rounds)
        if self.max_rounds < 1:
            raise OptionError(f"max_rounds is {max_rounds}, it must be at least 1")
        self._options = _DEFAULTS.get(backend, {}) | options
        self._solvers: list[QPSolver] = []
        self._native: Any = None
        if backend == "active_set":
            if options:
                raise OptionError(f"active_set has no options, {sorted(options)} given")
        elif backend == "daqp_levels":
            get_solver("daqp")  # says what to install
            from rcmqp.qp.daqp_levels import DaqpLevels

            check_options(backend, DaqpLevels, options)
            self._native = DaqpLevels(**options)
        else:
            try:
                self._solvers.append(get_solver(backend, **self._options))
            except UnknownName as error:
                known = {"active_set", "daqp_levels", *error.known}
                raise UnknownName("hierarchy backend", backend, known) from None

    def reset(self) -> None:
        """Forget warm starts: the next answers are those of a new object, bit by bit."""
        for solver in self._solvers:
            solver.reset()

    def solve(
        self, levels: Sequence[Level], bounds: Bounds, rest: ArrayLike | None = None
    ) -> HierarchySolution:
        """The lexicographic optimum; for finite numbers there is always one, inside the box.

        Args:
            levels: highest priority first.
            bounds: the box and the hard rows.
            rest: (n,) v_rest, zero by default.

        Raises:
            InvalidProblem: shapes that do not fit, or ``rest`` not finite.
        """
        start, n = time.perf_counter(), bounds.lower.size
        for level in levels:
            if level.A.shape[1] != n and len(level.A):
                raise InvalidProblem(
                    f"level {level.name!r} has {level.A.shape[1]} unknowns, the bounds have {n}"
                )
        rest = np.zeros(n) if rest is None else checked(rest, (n,), "rest")
        with np.errstate(all="ignore"):  # what overflows is caught by its result
            return self._solve(levels, bounds, rest, start)

    def _solve(
        self, levels: Sequence[Level], bounds: Bounds, rest: Array, start: float
    ) -> HierarchySolution:
        n, crossed = rest.size, bounds.lower > bounds.upper
        middle = 0.5 * bounds.lower + 0.5 * bounds.upper
        lower = np.where(crossed, middle, bounds.lower)
        upper = np.where(crossed, middle, bounds.upper)
        v = np.clip(np.zeros(n), lower, upper)
        unit = power_of_two(np.concatenate([lower, upper]))
        cascade = Cascade(
            v / unit, lower / unit, upper / unit, bounds.C, bounds.d / unit, self.max_rounds
        )
        todo = [(x.A if len(x.A) else np.zeros((0, n)), x.b, x.name) for x in levels]
        todo.append((np.eye(n), rest, "rest"))
        if self._native is not None:
            v, found = self._native.solve(todo, lower, upper, bounds, v)
            route = Route.UNVERIFIED if found else Route.KEPT
            top = Descent(route, np.zeros(len(cascade.G)), cascade.Z)
            descents = [top] * len(todo)
        else:
            top = self._guarded(cascade, None, None, 0)
            descents = [self._guarded(cascade, A, b / unit, k) for k, (A, b, _) in enumerate(todo)]
            v = cascade.v * unit
        cascade.rescale(unit)
        cascade.v = v = np.minimum(np.maximum(v, lower), upper)
        over = cascade.excess()
        results = tuple(
            self._result(cascade, done, A, b, A @ v - b, name, over)
            for done, (A, b, name) in zip(descents, todo, strict=True)
        )
        exceeded = np.maximum(bounds.C @ v - bounds.d, 0.0)
        d = np.where(exceeded > 0.0, bounds.d, 0.0)
        hard = self._result(cascade, top, bounds.C, d, exceeded, "limits", over)
        Gv = cascade.G @ v
        touching = TOUCHING * np.maximum(1.0, np.abs(Gv))
        at_upper, at_lower = cascade.asked - Gv <= touching, v - lower <= touching[:n]
        for array in (v, exceeded, at_lower, at_upper, crossed):
            array.setflags(write=False)
        elapsed = time.perf_counter() - start
        return HierarchySolution(
            v,
            hard,
            results[:-1],
            results[-1],
            exceeded,
            at_lower,
            at_upper,
            crossed,
            bounds.names,
            elapsed,
        )

    def _guarded(self, cascade: Cascade, A: Array | None, b: Array | None, k: int) -> Descent:
        """One level of the cascade; a factorisation that fails leaves the level alone."""
        v, Z = cascade.v, cascade.Z
        try:
            if A is None or b is None:
                done = cascade.satisfy_rows()
            else:
                done = cascade.descend(A, b, self._proposer(k) if self._solvers else None)
            if np.isfinite(cascade.v).all() and np.isfinite(cascade.Z).all():
                return done
        except np.linalg.LinAlgError:
            pass  # an SVD that does not converge; answered below
        cascade.v, cascade.Z = v, Z
        return Descent(Route.KEPT, np.zeros(len(cascade.G)), Z)

    def _proposer(self, k: int) -> Any:
        """The backend for level k; each level has its own, so that warm starts fit."""
        while len(self._solvers) <= k:
            self._solvers.append(get_solver(self.backend, **self._options))
        return lambda problem: propose(self._solvers[k], problem)

    def _result(
        self,
        cascade: Cascade,
        done: Descent,
        A: Array,
        b: Array,
        residual: Array,
        name: str,
        over: float,
    ) -> LevelResult:
        route, kkt, off = done.route, np.nan, np.abs(residual)
        if self._native is None:
            kkt = max(over, cascade.kkt(done, A, b, residual))
            if route.exact and not kkt <= EXACT:
                route = Route.UNVERIFIED
            elif route is Route.UNVERIFIED and kkt <= EXACT:
                route = Route.ACTIVE_SET
        reached = bool((off <= REACHED).all())
        if not reached:
            terms = np.abs(A) @ np.abs(cascade.v) + np.abs(b)
            reached = bool((off <= REACHED * np.maximum(1.0, terms)).all())
        multipliers = done.multipliers * cascade.unit / cascade.norms
        residual.setflags(write=False)
        multipliers.setflags(write=False)
        return LevelResult(
            name, route, residual, reached, kkt, multipliers, done.rounds, done.backend
        )


def power_of_two(numbers: Array) -> float:
    """A unit in which the largest finite one is about 1, so that tolerances fit any box."""
    largest = float(np.max(np.abs(numbers), where=np.isfinite(numbers), initial=0.0))
    return 2.0 ** round(math.log2(largest)) if 1e-100 < largest < 1e100 else 1.0


def propose(solver: QPSolver, problem: LeastSquares) -> QPSolution:
    """A backend's answer to one level: v is y, z has a signed multiplier for each row.

    The unknown is scaled by the largest finite bound, and a little regularisation makes the QP
    strictly convex; both only shape a proposal.
    """
    bounds = np.concatenate([problem.upper, -problem.lower])
    unit = float(np.max(bounds, where=np.isfinite(bounds), initial=0.0)) or 1.0
    r = problem.M.shape[1]
    up, low = np.isfinite(problem.upper), np.isfinite(problem.lower)
    empty = np.zeros(0)
    qp = QP(
        problem.M.T @ problem.M + _REGULARISATION * np.eye(r),
        -(problem.M.T @ problem.c) / unit,
        np.zeros((0, r)),
        empty,
        np.concatenate([problem.R[up], -problem.R[low]]),
        np.concatenate([problem.upper[up], -problem.lower[low]]) / unit,
        np.full(r, -np.inf),
        np.full(r, np.inf),
    )
    found = solver.solve(qp)
    if found.status is not Status.SOLVED or not np.isfinite(found.v).all():
        return QPSolution.failed(qp, Status.STOPPED, found.solve_time, found.message)
    z = np.zeros(len(problem.R))
    split = int(up.sum())
    z[up] += found.z[:split]
    z[low] -= found.z[split:]
    z[~np.isfinite(z)] = 0.0
    return QPSolution(unit * found.v, empty, z, np.zeros(r), Status.SOLVED, found.solve_time)
