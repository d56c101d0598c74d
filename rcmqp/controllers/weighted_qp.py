"""The same tasks in one QP, by weights: the comparison that shows what strict levels are for."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import bounded_gain
from rcmqp.controllers.given import JOINT_LIMITS
from rcmqp.controllers.hierarchical_qp import default_limits
from rcmqp.limits import Limit, combine
from rcmqp.maths.options import at_least, positive
from rcmqp.qp import QP, QPSolver, Status, get_solver
from rcmqp.references.view import Reference
from rcmqp.tasks import ObjectiveTask, RcmTask, RollTask, TipTask, Together
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class WeightedQP(Controller):
    """One QP: RCM, tool and objective in one cost, inside the limits of hierarchical_qp.

        min_v  sum_i w_i |J_i v + K e_i + drift_i|^2 + damping |v|^2

    as users of pink and mink write it: no published controller, and every number is chosen here.
    A weight trades errors where it should forbid them: when
    the arm runs out of speed, the RCM gives way a little, the more the smaller its weight; and
    the larger it is, the worse the QP is conditioned.

    A QP that the backend does not solve, because hard rows cannot all hold, say, ends in the
    safe stop.

    Attributes:
        gain: K of every task [1/s]; K T must be below 2.
        rcm_weight: of the RCM's two rows [1/m^2].
        tip_weight: of the tip's three rows [1/m^2].
        roll_weight: of the roll about the shaft [1/rad^2].
        objective_weight: of the objective's velocity; 0 leaves it out.
        damping: of the joint velocity.
        limit_gain: how fast the trocar's limits may be approached [1/s].
        backend: any of the QP solvers. DAQP, because ProxQP leaves one QP in five of these badly
            conditioned ones unsolved when the arm is at its limits.
    """

    name: ClassVar[str] = "weighted_qp"
    enforces: ClassVar[tuple[str, ...] | None] = JOINT_LIMITS
    holds_roll: ClassVar[bool | None] = True
    remark: ClassVar[str] = (
        "weights let the objective of the redundant joints pull against trocar and tip, from the "
        "first cycle on. On a slow path this start from rest is its largest jerk."
    )
    feed_forward: ClassVar[bool] = True

    gain: float = field(default=60.0, metadata=bounded_gain())
    rcm_weight: float = field(default=1e4, metadata=positive("1/m^2"))
    tip_weight: float = field(default=1.0, metadata=positive("1/m^2"))
    roll_weight: float = field(default=1e-2, metadata=positive("1/rad^2"))
    objective_weight: float = field(default=1e-6, metadata=at_least(0.0))
    damping: float = field(default=1e-8, metadata=at_least(0.0))
    limit_gain: float = field(default=60.0, metadata=bounded_gain(below=1.0))
    backend: str = "daqp"

    def __post_init__(self) -> None:
        """Check the options; make tasks, limits and the solver.

        Raises:
            OptionError: an option's value is not allowed.
            UnknownName: there is no such backend.
            SolverNotInstalled: the backend's package is missing.
        """
        super().__post_init__()
        _ = self._tasks, self._limits, self._solver  # made before the first cycle

    @functools.cached_property
    def _tasks(self) -> Together:
        insertion, gain = self.insertion, self.gain
        tasks = (
            RcmTask(gain=gain, weight=self.rcm_weight)
            + TipTask.made_for(insertion, gain=gain, weight=self.tip_weight)
            + RollTask(gain=gain, weight=self.roll_weight)
        )
        if self.objective_weight > 0.0:
            tasks += ObjectiveTask.made_for(insertion, weight=self.objective_weight)
        return tasks

    @functools.cached_property
    def _limits(self) -> tuple[Limit, ...]:
        return default_limits(self.insertion, self.period, self.limit_gain)

    @functools.cached_property
    def _solver(self) -> QPSolver:
        return get_solver(self.backend)

    def reset(self) -> None:
        """Forget the solver's warm start."""
        self._solver.reset()

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """One QP."""
        level = self._tasks.level(state, reference)
        bounds = combine(self._limits, state, reference)
        n = len(bounds.lower)
        qp = QP.build(
            level.A.T @ level.A + self.damping * np.eye(n),
            -(level.A.T @ level.b),
            C=bounds.C,
            d=bounds.d,
            lb=bounds.lower,
            ub=bounds.upper,
        )
        solution = self._solver.solve(qp)
        if solution.status is not Status.SOLVED or not np.isfinite(solution.v).all():
            reason = f"the QP has no solution: {solution.status.value}"
            return self.safe_stop(state, reason, account=solution)
        return Command(np.clip(solution.v, bounds.lower, bounds.upper), {}, solution)
