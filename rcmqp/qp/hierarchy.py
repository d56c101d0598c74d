"""The hierarchical least-squares solver: strict and damped levels; it always answers."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.errors import InvalidProblem, OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp.levels import Answer, Bounds, HierarchySolution, Level
from rcmqp.qp.problem import QP, QPSolver, Status, checked
from rcmqp.qp.solvers import get_solver, solver_names

HEAVY = 1e-4
"""A backend's answer proposes the rows with multipliers above this, times the heaviest."""

_REGULARISATION = 1e-6

FAR = 1e3
"""A goal farther away than this many times the largest bound is brought this near for a backend:
the active set is that of its direction, and ProxQP took 75 ms for goals of 1e50."""

NO_VERDICTS: Mapping[int, Status] = MappingProxyType({})
"""The verdicts where no backend was asked."""

_DEFAULTS: dict[str, dict[str, Any]] = {
    "proxqp": {"eps_abs": 1e-5, "max_iter": 10, "max_iter_in": 10},
    "daqp": {"iter_limit": 100},
}
"""A proposal need not be perfect, but quick: the number of iterations is bounded, and after them
the hierarchy's own active set stands."""


def hierarchy_backends() -> list[str]:
    """Backends that a Hierarchy accepts here: its own, and every QP solver installed."""
    return ["active_set", *solver_names()]


class Hierarchy:
    """Minimises |A_1 v - b_1|, then |A_2 v - b_2| below it, and so on, inside bounds.

    Above all levels: the box, which always holds, and the hard rows, exceeded least where they
    cannot all hold. Below all levels: |v - v_rest|, which makes v unique.

    A strict level (damping zero) is at its least-squares optimum, and later levels keep A v. A
    damped level, with d its damping and Z an orthonormal basis of what strict levels above left
    free, minimises, without bounds,

        |A v - b|^2 + |L Z^T v|^2 + sum_j |(A_j v - c_j) / (0.003 d_j)|^2,  L = d (I + C^T C)^-1,

    where j are the damped levels above, c_j = A_j v what they have reached, and C stacks A Z / d
    and the A_j Z / d_j. If that breaks a bound in the end, each damped level goes, inside the
    bounds, three proximal steps from the v without bounds towards its A v there; where the joints
    are ``sluggish`` and bounds keep a part of that from it, with more damping, the more, the
    larger the part, and towards less where they keep the damped levels above from theirs. With
    strict levels above damped ones and one below, v is continuous in the levels and the bounds,
    except where guarded levels are not reached; see kernel/cascade.h for the formulas and
    constants.

    A strict level below damped ones asks for less, b / (1 + m / 0.003), where these are not
    served, with m^2 = sum_j |A_j v - b_j|^2 / d_j^2.

    First all levels are tried in closed form. If a bound is in the way, levels go one by one.
    Each step of a level tries its active set of the last call; if that is wrong, no bound at all;
    then, in its first step, a backend solves the level as a QP. Its active set, too, is only a
    proposal, whose optimum is computed in closed form and verified, and repaired where it fails.
    So v depends on the backend, its tolerance and earlier calls by rounding only, which levels of
    badly scaled or nearly dependent rows make larger; the time depends on them.

    The KKT residual of each level is computed at its optimum from the problem's own numbers:
    stationarity, signs, complementarity, feasibility, each relative to the size of the terms
    where that is above one. A level above 1e-8 is never called exact.

    Directions in which a strict level gains less than 1e-9 of its unit (nm/s, nrad/s) for each
    unit of v belong to the levels below; entries of A below that are not seen. With ``guarded``
    levels, what cannot be reached of them and of the hard rows is damped likewise, the more, the
    more is left.

    Attributes:
        backend: ``"proxqp"``, ``"daqp"``, any solver of ``solver_names()``; ``"active_set"`` for
            none at all.
        max_rounds: of the active set, for each level.
    """

    def __init__(
        self, backend: str = "active_set", *, max_rounds: int = 100, **options: Any
    ) -> None:
        self.backend, self.max_rounds = backend, int(max_rounds)
        if not 1 <= self.max_rounds <= 10_000:
            raise OptionError(f"max_rounds is {max_rounds}, it must be from 1 to 10000")
        self._options = _DEFAULTS.get(backend, {}) | options
        self._solvers: list[QPSolver] = []
        self._sets = np.zeros((0, _kernel.SETS, 0))
        self._verdicts: dict[int, Status] = {}
        if backend == "active_set":
            if options:
                raise OptionError(f"active_set has no options, {sorted(options)} given")
        else:
            try:
                self._solvers.append(get_solver(backend, **self._options))
            except UnknownName as error:
                known = {"active_set", *error.known}
                raise UnknownName("hierarchy backend", backend, known) from None

    def reset(self) -> None:
        """Forget warm starts: the next answers are those of a new object, bit by bit."""
        self._sets.fill(0.0)
        for solver in self._solvers:
            solver.reset()

    def solve(
        self,
        levels: Sequence[Level],
        bounds: Bounds,
        rest: ArrayLike | None = None,
        guarded: int = 0,
        sluggish: bool = False,
    ) -> HierarchySolution:
        """The lexicographic optimum; for finite numbers there is always one, inside the box.

        Args:
            levels: highest priority first.
            bounds: the box and the hard rows.
            rest: (n,) v_rest, zero by default.
            guarded: how many of the first levels hard rows may not keep from their goal: where
                the box alone would let these levels be reached, the rows come after them.
            sluggish: whether joints cannot turn round at once, as with limits of acceleration:
                damped levels that bounds keep from their goal weigh speed more, and those
                below such levels ask for less.

        Raises:
            InvalidProblem: shapes that do not fit, or ``rest`` not finite.
        """
        n = bounds.lower.size
        for level in levels:
            if level.A.shape[1] != n and len(level.A):
                raise InvalidProblem(
                    f"level {level.name!r} has {level.A.shape[1]} unknowns, the bounds have {n}"
                )
        rest = np.zeros(n) if rest is None else checked(rest, (n,), "rest")
        blocks = [level.A for level in levels if len(level.A)]
        A = np.concatenate([*blocks, np.eye(n)])
        b = np.concatenate([*(level.b for level in levels), rest])
        ends = np.cumsum([*(level.b.size for level in levels), n])
        damping = np.array([*(level.damping for level in levels), 0.0])
        box = bounds.lower, bounds.upper, bounds.C, bounds.d
        problem = (A, b, ends, damping, *box, operator.index(guarded), int(sluggish))
        sets = self.active_sets(len(ends), n + bounds.d.size)
        v, account = _kernel.solve(*problem, self.max_rounds, None, sets, self.asks)
        answer = Answer(account, ends, n, bounds.d.size)
        names = [level.name for level in levels]
        return HierarchySolution(v, bounds.names, answer, names, self.verdicts())

    def active_sets(self, levels: int, bounds: int) -> Array:
        """The last active sets (levels + 1, SETS, bounds); zero after another size, or reset().

        Args:
            levels: with the rest.
            bounds: of the box and hard rows.
        """
        shape = levels + 1, _kernel.SETS, bounds
        if self._sets.shape != shape:
            self._sets = np.zeros(shape)
        return self._sets

    @property
    def asks(self) -> Callable[..., Array] | None:
        """The function that compiled code calls for a blocked level; None without a backend."""
        return self._propose if self._solvers else None

    def verdicts(self) -> Mapping[int, Status]:
        """Status of the backend's answers since the last call, by level from 1 on."""
        if not self._verdicts:
            return NO_VERDICTS
        verdicts, self._verdicts = self._verdicts, {}
        return verdicts

    def _propose(
        self,
        k: int,
        M: Array,
        c: Array,
        R: Array,
        lower: Array,
        upper: Array,
    ) -> Array:
        """The backend's guess at the active set of level k: 1 at upper, -1 at lower, 0.

        Each level has a solver of its own, so that warm starts fit.
        """
        while len(self._solvers) < k:
            self._solvers.append(get_solver(self.backend, **self._options))
        self._verdicts[k], z = propose(self._solvers[k - 1], M, c, R, lower, upper)
        heavy = np.abs(z) > HEAVY * float(np.abs(z).max(initial=0.0))
        heavy &= np.isfinite(np.where(z > 0.0, upper, lower))
        return np.where(heavy, np.sign(z), 0.0)


def propose(
    solver: QPSolver, M: Array, c: Array, R: Array, lower: Array, upper: Array
) -> tuple[Status, Array]:
    """A backend's verdict on one level, and its signed multiplier for each row of R.

    The unknown is scaled by the largest finite bound, and a little regularisation makes the QP
    strictly convex; both only shape a proposal.
    """
    bounds = np.concatenate([upper, -lower])
    unit = float(np.max(bounds, where=np.isfinite(bounds), initial=0.0)) or 1.0
    r = M.shape[1]
    with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers make a proposal that fails
        c = c * min(1.0, FAR * unit / max(float(np.linalg.norm(c)), unit))
    up, low = np.isfinite(upper), np.isfinite(lower)
    qp = QP(
        M.T @ M + _REGULARISATION * np.eye(r),
        -(M.T @ c) / unit,
        np.zeros((0, r)),
        np.zeros(0),
        np.concatenate([R[up], -R[low]]),
        np.concatenate([upper[up], -lower[low]]) / unit,
        np.full(r, -np.inf),
        np.full(r, np.inf),
    )
    z = np.zeros(len(R))
    try:
        solution = solver.solve(qp)
    except Exception:  # noqa: BLE001  (a proposal that is not made is one that failed)
        return Status.STOPPED, z
    if solution.status is not Status.SOLVED or not np.isfinite(solution.v).all():
        return Status.STOPPED, z
    split = int(up.sum())
    z[up] += solution.z[:split]
    z[low] -= solution.z[split:]
    z[~np.isfinite(z)] = 0.0
    return Status.SOLVED, z
