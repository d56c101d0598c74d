"""The RCM as a task: strict levels of least squares, inside hard limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

import numpy as np

from rcmqp.arm import ArmState
from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import check_gain, check_not_negative, checked_reference
from rcmqp.errors import InvalidCommand
from rcmqp.insertion import Insertion
from rcmqp.limits import JointLimits, Limit, TrocarCone, TrocarDepth, combine
from rcmqp.qp import Hierarchy, HierarchySolution
from rcmqp.reference import Reference
from rcmqp.tasks import ObjectiveTask, RcmTask, RollTask, Task, TipTask, Together

CONE_DECELERATION = 1.0
"""What the shaft may be slowed down with before the cone's edge [rad/s^2]."""

DEPTH_DECELERATION = 0.2
"""What the tip may be slowed down with before the end of its depth range [m/s^2]."""

LevelOfTasks: TypeAlias = Task | Together


@dataclass(frozen=True, eq=False)
class HierarchicalQP(Controller):
    """Limits, then the RCM, then the tool, then what is left: each level strictly above the next.

        lexmin_v  |A_1 v - b_1|, |A_2 v - b_2|, ...   within  lower <= v <= upper,  C v <= d

    with A and b of each level from its tasks: A v = b says that the error e goes as e' = -K e,
    the motion of the reference and of the trocar included. When the arm runs out of speed or
    range, the lower levels give way and the higher ones do not notice.

    The levels, unless ``levels`` gives others: RcmTask; TipTask; RollTask; ObjectiveTask. Any
    order is one expression:

        HierarchicalQP(insertion, T, levels=[RcmTask(), TipTask(d) + RollTask(weight=0.01)])

    The limits, unless ``limits`` gives others: JointLimits (position, speed, acceleration,
    braking distance counted), TrocarCone, TrocarDepth.

    Not finished: where the trocar's rows and the joints' acceleration limits cannot all hold, the
    rows are put above the RCM, which is the wrong way round for a patient; and a level whose
    active set is degenerate may end unverified, a feasible answer that the account names.

    A step always answers, inside the joint limits. A reference that is not finite or no pose is
    answered by the safe stop ``brake``: the joints stop as fast as their limits allow. Where a
    trocar's rows cannot all hold, they are exceeded as little as can be, and the command says
    by how much.

    Attributes:
        gain: K of every task [1/s]; K T must be below 2.
        K_c: gain of the objective, see ObjectiveTask; 0 leaves it out.
        c_d: desired value of the objective.
        objective: its name in OBJECTIVES; empty for the arm's own.
        limit_gain: how fast the trocar's limits may be approached [1/s].
        backend: ``proxqp``, ``daqp``, ``active_set`` or any solver that qpsolvers has: the
            answer is the same, the time is not. ``daqp_levels`` is faster and inexact.
        levels: tasks, the first the most important; only from Python.
        limits: only from Python.
    """

    name: ClassVar[str] = "hierarchical_qp"
    diagnostics: ClassVar[Mapping[str, tuple[str, str]]] = {
        "rcm_residual": ("m/s", "|A v - b| of the RCM's rows"),
        "tip_residual": ("m/s", "|A v - b| of the tip's rows"),
        "roll_residual": ("rad/s", "|A v - b| of the roll's row"),
        "objective_residual": ("rad/s", "|A v - b| of the objective's rows"),
        "safe_stop": ("1", "1 where the joints brake instead of following"),
        "exact": ("1", "1 where every level is the optimum to rounding"),
        "joints_at_limit": ("1", "joints at a bound of their box"),
        "violation": ("m/s, rad/s", "largest excess of a hard row"),
        "kkt": ("1", "largest residual of the levels' optimality conditions"),
    }

    gain: float = 60.0
    K_c: float = 7.0
    c_d: float = 1.0
    objective: str = ""
    limit_gain: float = 60.0
    backend: str = "proxqp"
    levels: Sequence[LevelOfTasks] | None = None
    limits: Sequence[Limit] | None = None
    _levels: tuple[LevelOfTasks, ...] = field(init=False, repr=False)
    _limits: tuple[Limit, ...] = field(init=False, repr=False)
    _hierarchy: Hierarchy = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the options; make levels, limits and the solver.

        Raises:
            OptionError: an option's value is not allowed.
            UnknownName: there is no such objective or backend.
            SolverNotInstalled: the backend's package is missing.
        """
        super().__post_init__()
        check_gain("gain", self.gain, self.period)
        check_gain("limit_gain", 2.0 * self.limit_gain, self.period)
        check_not_negative("K_c", self.K_c)
        levels, limits = self.levels, self.limits
        if levels is None:
            levels = _levels(self)
        if limits is None:
            limits = default_limits(self.insertion, self.period, self.limit_gain)
        object.__setattr__(self, "_levels", tuple(levels))
        object.__setattr__(self, "_limits", tuple(limits))
        object.__setattr__(self, "_hierarchy", Hierarchy(self.backend))

    @property
    def options(self) -> dict[str, Any]:
        """The options; levels and limits that were given, by their names."""
        given = {"levels": self.levels, "limits": self.limits}
        names = {key: value and [item.name for item in value] for key, value in given.items()}
        return super().options | names

    def reset(self) -> None:
        """Forget the solver's warm start."""
        self._hierarchy.reset()

    def step(self, state: ArmState, reference: Reference) -> Command:
        """One lexicographic optimum; see Controller.step(). Raises nothing."""
        levels, stop = self._levels, 0.0
        try:
            reference = checked_reference(reference, rates=True)
        except InvalidCommand:
            levels, stop = (), 1.0
            reference = Reference(state.x, np.zeros(8), state.oMe.translation, np.zeros(3))
        solution = self._hierarchy.solve(
            [level.level(state, reference) for level in levels],
            combine(self._limits, state, reference, self.insertion.arm.joints),
        )
        return Command(solution.v, self._account(solution, stop), solution)

    def _account(self, solution: HierarchySolution, stop: float) -> dict[str, float]:
        """The numbers that a run records, the same names each cycle."""
        found = {level.name: np.linalg.norm(level.residual) for level in solution.levels}
        bounded = solution.at_lower.sum() + solution.at_upper[: len(solution.v)].sum()
        return {
            **{
                f"{level.name}_residual": float(found.get(level.name, np.nan))
                for level in self._levels
            },
            "safe_stop": stop,
            "exact": float(solution.exact),
            "joints_at_limit": float(bounded),
            "violation": float(np.max(solution.violation, initial=0.0)),
            "kkt": max((level.kkt for level in solution.levels), default=0.0),
        }


def default_limits(insertion: Insertion, period: float, gain: float) -> tuple[Limit, ...]:
    """Joint limits, and the trocar's cone and depth range."""
    return (
        JointLimits(insertion.arm, period),
        TrocarCone(insertion.trocar, gain=gain, deceleration=CONE_DECELERATION),
        TrocarDepth(
            insertion.trocar, insertion.tip_depth, gain=gain, deceleration=DEPTH_DECELERATION
        ),
    )


def _levels(controller: HierarchicalQP) -> tuple[LevelOfTasks, ...]:
    insertion, gain = controller.insertion, controller.gain
    tool = (
        RcmTask(gain=gain),
        TipTask(insertion.tip_depth, gain=gain),
        RollTask(gain=gain),
    )
    if controller.K_c == 0.0:
        return tool
    options = {"objective": controller.objective} if controller.objective else {}
    own = ObjectiveTask.made_for(insertion, c_d=controller.c_d, K_c=controller.K_c, **options)
    return (*tool, own)
