"""DAQP, a dual active-set method, native."""

from __future__ import annotations

import time

import daqp
import numpy as np

from rcmqp.maths.options import allowed, positive
from rcmqp.qp.problem import QP, QPSolution, Status

_INFINITY = 1e30
_EQUALITY = 5


class DAQP:
    """Solver ``"daqp"``: no state between calls, so it has nothing to warm up or to reset.

    Attributes:
        primal_tol: feasibility tolerance, relative to the constraint's norm.
        dual_tol: tolerance on the multipliers' signs.
        iter_limit: iterations.
    """

    def __init__(
        self, primal_tol: float = 1e-10, dual_tol: float = 1e-12, iter_limit: int = 1000
    ) -> None:
        for name, value in (("primal_tol", primal_tol), ("iter_limit", iter_limit)):
            allowed(f"daqp: {name}", value, positive())
        self.primal_tol, self.dual_tol = float(primal_tol), float(dual_tol)
        self.iter_limit = int(iter_limit)

    def reset(self) -> None:
        """Nothing is kept."""

    def solve(self, qp: QP) -> QPSolution:
        """Answer ``qp``."""
        start = time.perf_counter()
        n, n_in = qp.g.size, qp.d.size
        upper = np.minimum(np.concatenate([qp.ub, qp.d, qp.b]), _INFINITY)
        lower = np.concatenate([qp.lb, np.full(n_in, -_INFINITY), qp.b])
        sense = np.zeros(upper.size, dtype=np.int32)
        sense[n + n_in :] = _EQUALITY
        v, _, flag, info = daqp.solve(
            np.array(qp.H),  # copies: DAQP's docs do not promise to leave its inputs alone
            np.array(qp.g),
            np.concatenate([qp.C, qp.A]),
            upper,
            np.maximum(lower, -_INFINITY),
            sense,
            primal_tol=self.primal_tol,
            dual_tol=self.dual_tol,
            iter_limit=self.iter_limit,
        )
        elapsed = time.perf_counter() - start
        if flag <= 0:
            status = Status.INFEASIBLE if flag == -1 else Status.STOPPED
            return QPSolution.failed(qp, status, elapsed, f"daqp exit flag {flag}")
        multipliers = np.array(info["lam"])
        z_box, z, y = np.split(multipliers, [n, n + n_in])
        return QPSolution(np.array(v), y, z, z_box, Status.SOLVED, elapsed)
