"""The whole hierarchy in one native call of DAQP (``break_points``): fast, but not exact.

The box is hard, level by level the rest is soft. The first level that is not reached ends where
it should. With bounds active, later levels end above their lexicographic optimum, because DAQP
keeps the earlier level's violated rows at their violation and its active bounds where they are.
On 2000 random problems of the tests' shape (RCM 2 rows, tip 3, posture; 7 joints, bounds active
in all) MEASURED.
"""

from __future__ import annotations

from collections.abc import Sequence

import daqp
import numpy as np

from rcmqp.dualquaternion import Array
from rcmqp.errors import OptionError
from rcmqp.qp.levels import Bounds

_INFINITY = 1e30
_SOFT = 8


class DaqpLevels:
    """Backend ``"daqp_levels"`` of Hierarchy.

    Attributes:
        primal_tol: feasibility tolerance.
        iter_limit: iterations.
    """

    def __init__(self, primal_tol: float = 1e-9, iter_limit: int = 1000) -> None:
        for name, value in (("primal_tol", primal_tol), ("iter_limit", iter_limit)):
            if not value > 0:
                raise OptionError(f"daqp_levels: {name} is {value}, it must be positive")
        self.primal_tol, self.iter_limit = float(primal_tol), int(iter_limit)

    def solve(
        self,
        levels: Sequence[tuple[Array, Array, str]],
        lower: Array,
        upper: Array,
        bounds: Bounds,
        fallback: Array,
    ) -> tuple[Array, bool]:
        """The point v (n,) that DAQP finds, and whether it says so; else ``fallback``."""
        matrices = [bounds.C, *(A for A, _, _ in levels)]
        goals = [b for _, b, _ in levels]
        above = np.concatenate([upper, bounds.d, *goals])
        below = np.concatenate([lower, np.full(bounds.d.size, -np.inf), *goals])
        sense = np.full(above.size, _SOFT, dtype=np.int32)
        sense[: lower.size] = 0
        sizes = [lower.size, *(len(A) for A in matrices)]
        ends = np.cumsum([size for size in sizes if size], dtype=np.int32)
        v, _, flag, _ = daqp.solve(
            None,
            None,
            np.concatenate(matrices),
            np.minimum(above, _INFINITY),
            np.maximum(below, -_INFINITY),
            sense,
            break_points=ends,
            primal_tol=self.primal_tol,
            iter_limit=self.iter_limit,
        )
        if flag <= 0 or not np.isfinite(v).all():
            return fallback, False
        return np.array(v), True
