"""Every other QP backend, through qpsolvers."""

from __future__ import annotations

import time
import warnings
from typing import Any

import numpy as np
import qpsolvers
import scipy.sparse
from qpsolvers.exceptions import QPError

from rcmqp.errors import OptionError
from rcmqp.qp.problem import QP, QPSolution, Status

_TIGHT: dict[str, dict[str, Any]] = {
    "clarabel": {"tol_gap_abs": 1e-10, "tol_gap_rel": 1e-10, "tol_feas": 1e-10},
    "highs": {"time_limit": 0.05},  # its QP solver was seen to cycle for minutes
    "osqp": {"eps_abs": 1e-8, "eps_rel": 0.0, "max_iter": 4000},
    "piqp": {"eps_abs": 1e-10, "eps_rel": 0.0},
    "scs": {"eps_abs": 1e-8, "eps_rel": 0.0},
}
"""Tolerances where the backend's own are loose; options override them."""


class ThroughQpsolvers:
    """A solver that qpsolvers knows by ``name``; no state between calls.

    Args:
        name: qpsolvers' name.
        options: go to the backend.

    Raises:
        OptionError: the backend rejects an option; a small QP is solved to find out.
    """

    def __init__(self, name: str, **options: Any) -> None:
        self.name, self.options = name, _TIGHT.get(name, {}) | options
        self._sparse = name in qpsolvers.sparse_solvers and name not in qpsolvers.dense_solvers
        trial = QP.build(np.eye(2), np.ones(2), C=np.eye(2), d=np.ones(2))
        try:
            self._call(trial)
        except (TypeError, AttributeError, KeyError, ValueError, QPError) as error:
            raise OptionError(f"{name} rejects {options}: {error}") from error

    def reset(self) -> None:
        """Nothing is kept."""

    def solve(self, qp: QP) -> QPSolution:
        """Answer ``qp``."""
        start = time.perf_counter()
        if not (qp.A.size or np.isfinite(qp.d).any() or np.isfinite([qp.lb, qp.ub]).any()):
            return self._unconstrained(qp, start)
        try:
            solution = self._call(qp)
        except (QPError, ValueError, ArithmeticError, RuntimeError) as error:
            elapsed = time.perf_counter() - start
            return QPSolution.failed(qp, Status.STOPPED, elapsed, f"{self.name}: {error}")
        elapsed = time.perf_counter() - start
        if not solution.found or solution.x is None:
            return QPSolution.failed(qp, Status.STOPPED, elapsed, f"{self.name}: not found")

        def multipliers(value: Any, size: int) -> Any:
            return np.zeros(size) if value is None or not len(value) else np.array(value)

        n = qp.g.size
        z = np.zeros(qp.d.size)
        z[np.isfinite(qp.d)] = multipliers(solution.z, int(np.isfinite(qp.d).sum()))
        return QPSolution(
            np.array(solution.x, dtype=float),
            multipliers(solution.y, qp.b.size),
            z,
            multipliers(solution.z_box, n),
            Status.SOLVED,
            elapsed,
        )

    def _unconstrained(self, qp: QP, start: float) -> QPSolution:
        """Solve H v = -g here: qpsolvers calls some bounded problems of this kind unbounded."""
        v = np.asarray(np.linalg.lstsq(qp.H, -qp.g)[0], dtype=np.float64)
        elapsed, none = time.perf_counter() - start, np.zeros(0)
        if np.abs(qp.H @ v + qp.g).max(initial=0.0) > 1e-9 * max(1.0, np.abs(qp.g).max(initial=0)):
            return QPSolution.failed(qp, Status.STOPPED, elapsed, "unbounded below")
        zeros = np.zeros(qp.d.size)
        return QPSolution(v, none, zeros, np.zeros(qp.g.size), Status.SOLVED, elapsed)

    def _call(self, qp: QP) -> qpsolvers.Solution:
        on = np.isfinite(qp.d)
        box = bool(np.isfinite(qp.lb).any() or np.isfinite(qp.ub).any())

        def matrix(x: Any) -> Any:
            return scipy.sparse.csc_matrix(x) if self._sparse else np.array(x)

        problem = qpsolvers.Problem(
            matrix(qp.H),
            np.array(qp.g),
            matrix(qp.C[on]) if on.any() else None,
            qp.d[on] if on.any() else None,
            matrix(qp.A) if qp.b.size else None,
            np.array(qp.b) if qp.b.size else None,
            np.array(qp.lb) if box else None,
            np.array(qp.ub) if box else None,
        )
        with warnings.catch_warnings():  # what they warn of is in the status
            warnings.simplefilter("ignore")
            return qpsolvers.solve_problem(problem, solver=self.name, **self.options)
