"""The same tasks in one QP, by weights: the comparison that shows what strict levels are for."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import ClassVar

from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import bounded_gain
from rcmqp.controllers.given import JOINT_LIMITS
from rcmqp.controllers.hierarchical_qp import default_limits
from rcmqp.controllers.one_level import OneLevel, Still
from rcmqp.maths.options import at_least, positive
from rcmqp.references.view import Reference
from rcmqp.tasks import ObjectiveTask, RcmTask, RollTask, Task, TipTask
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class WeightedQP(Controller):
    """One QP: RCM, tool and objective in one cost, inside the limits of hierarchical_qp.

        min_v  sum_i w_i |J_i v + K e_i + drift_i|^2 + damping |v|^2

    as users of pink and mink write it: no published controller, and every number is chosen here.
    A weight trades errors where it should forbid them: when
    the arm runs out of speed, the RCM gives way a little, the more the smaller its weight; and
    the larger it is, the worse the QP is conditioned.

    The QP is solved as a hierarchy of one level: whatever the backend proposes is computed again
    in closed form and verified, so the answer is the optimum, and the same bits each time. A QP
    without an answer, because hard rows cannot all hold, say, ends in the safe stop.

    Attributes:
        gain: K of every task [1/s]; K T must be below 2.
        rcm_weight: of the RCM's two rows [1/m^2].
        tip_weight: of the tip's three rows [1/m^2].
        roll_weight: of the roll about the shaft [1/rad^2].
        objective_weight: of the objective's velocity; 0 leaves it out.
        damping: of the joint velocity.
        limit_gain: how fast the trocar's limits may be approached [1/s].
        backend: ``active_set``, the hierarchy's own, or any of the QP solvers, see Hierarchy.
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
    backend: str = "active_set"

    def __post_init__(self) -> None:
        """Check the options; make tasks, limits and the solver.

        Raises:
            OptionError: an option's value is not allowed.
            UnknownName: there is no such backend.
            SolverNotInstalled: the backend's package is missing.
        """
        super().__post_init__()
        _ = self._qp  # made before the first cycle

    @functools.cached_property
    def _qp(self) -> OneLevel:
        insertion, gain = self.insertion, self.gain
        strict: dict[str, float] = {"gain": gain, "damping": 0.0}
        tasks: list[Task] = [
            RcmTask(weight=self.rcm_weight, **strict),
            TipTask(weight=self.tip_weight, **strict),
            RollTask(weight=self.roll_weight, **strict),
        ]
        if self.objective_weight > 0.0:
            tasks.append(ObjectiveTask.made_for(insertion, weight=self.objective_weight))
        if self.damping > 0.0:
            tasks.append(Still(weight=self.damping, damping=0.0))
        limits = default_limits(insertion, self.period, self.limit_gain)
        return OneLevel(tasks, limits, insertion.arm, self.period, self.backend)

    def reset(self) -> None:
        """Forget the solver's warm start."""
        self._qp.reset()

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """One QP."""
        solution, wrong = self._qp.solve(state, reference)
        if wrong:
            return self.safe_stop(state, f"the QP has no solution: {wrong}", account=solution)
        return Command.of(solution.v, {}, solution)
