"""ProxQP (proxsuite, dense), native, kept warm between calls of the same size.

ProxQP's default ``eps_primal_inf`` and ``eps_dual_inf`` of 1e-4 declare feasible problems
infeasible when bounds are active (888 of 3600 solves of an equality cascade; 2 with 1e-12), so
both are 1e-12 here. ``eps_abs`` is in the unit of the rows: 1e-6 is off by up to 6e-3 rad/s in
near-null directions, so it is 1e-9.

With the default ``DenseBackend``, two new objects given the same numbers differ in the last bits
(up to 3e-13) in half of the solves, as memory falls. ``PrimalLDLT``, used here, repeats to the
bit for the sizes of an arm (none of 2000 solves up to 8 unknowns and 14 rows differed) and takes
10 to 80 % longer; with 100 rows it can differ too.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from proxsuite import proxqp

from rcmqp.maths.options import allowed, positive
from rcmqp.qp.problem import QP, QPSolution, Status

_STATUS = {
    proxqp.PROXQP_SOLVED: Status.SOLVED,
    proxqp.PROXQP_PRIMAL_INFEASIBLE: Status.INFEASIBLE,
    proxqp.PROXQP_DUAL_INFEASIBLE: Status.STOPPED,
    proxqp.PROXQP_MAX_ITER_REACHED: Status.STOPPED,
}


class ProxQP:
    """Solver ``"proxqp"``.

    One proxsuite object is kept for each size (n, n_eq, n_in, box or not). A solve that fails
    throws its object away, since a warm start from a failed solve was seen to return 3e5 rad/s,
    and a failure after a warm start is tried again without.

    Attributes:
        eps_abs: absolute tolerance on the residuals, in the rows' units.
        eps_primal_inf: tolerance of the test that declares primal infeasibility.
        eps_dual_inf: the same for dual infeasibility.
        max_iter: outer iterations.
        max_iter_in: inner iterations in each of them.
        warm: start from the last solution of the same size.
    """

    def __init__(
        self,
        eps_abs: float = 1e-9,
        eps_primal_inf: float = 1e-12,
        eps_dual_inf: float = 1e-12,
        max_iter: int = 200,
        max_iter_in: int = 100,
        warm: bool = True,
    ) -> None:
        for name, value in (
            ("eps_abs", eps_abs),
            ("eps_primal_inf", eps_primal_inf),
            ("eps_dual_inf", eps_dual_inf),
            ("max_iter", max_iter),
            ("max_iter_in", max_iter_in),
        ):
            allowed(f"proxqp: {name}", value, positive())
        self.eps_abs, self.warm = float(eps_abs), bool(warm)
        self.eps_primal_inf, self.eps_dual_inf = float(eps_primal_inf), float(eps_dual_inf)
        self.max_iter, self.max_iter_in = int(max_iter), int(max_iter_in)
        self._objects: dict[tuple[int, int, int, bool], Any] = {}

    def reset(self) -> None:
        """Forget earlier calls."""
        self._objects.clear()

    def solve(self, qp: QP) -> QPSolution:
        """Answer ``qp``."""
        start = time.perf_counter()
        box = bool((qp.lb > -np.inf).any() or (qp.ub < np.inf).any())
        key = (qp.g.size, qp.b.size, qp.d.size, box)
        data: dict[str, Any] = {"H": qp.H, "g": qp.g}
        if qp.b.size:
            data |= {"A": qp.A, "b": qp.b}
        if qp.d.size:
            data |= {"C": qp.C, "l": np.full(qp.d.size, -np.inf), "u": qp.d}
        if box:
            data |= {"l_box": qp.lb, "u_box": qp.ub}
        solver = self._objects.pop(key, None)
        if solver is not None:
            solver.update(**data)
            solver.solve()
        if solver is None or solver.results.info.status != proxqp.PROXQP_SOLVED:
            solver = self._new(key)
            solver.init(**data)
            solver.solve()
        result = solver.results
        status = _STATUS.get(result.info.status, Status.STOPPED)
        elapsed = time.perf_counter() - start
        if status is not Status.SOLVED:
            return QPSolution.failed(qp, status, elapsed, str(result.info.status))
        if self.warm:
            self._objects[key] = solver
        z = np.array(result.z)
        return QPSolution(
            np.array(result.x),
            np.array(result.y),
            z[: qp.d.size],
            z[qp.d.size :] if box else np.zeros(qp.g.size),
            status,
            elapsed,
        )

    def _new(self, key: tuple[int, int, int, bool]) -> Any:
        n, n_eq, n_in, box = key
        dense = proxqp.dense
        solver = dense.QP(
            n, n_eq, n_in, box, dense.HessianType.Dense, dense.DenseBackend.PrimalLDLT
        )
        settings = solver.settings
        settings.eps_abs, settings.eps_rel = self.eps_abs, 0.0
        settings.eps_primal_inf = self.eps_primal_inf
        settings.eps_dual_inf = self.eps_dual_inf
        settings.max_iter, settings.max_iter_in = self.max_iter, self.max_iter_in
        settings.initial_guess = proxqp.WARM_START_WITH_PREVIOUS_RESULT
        return solver
