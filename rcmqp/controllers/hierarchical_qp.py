"""The RCM as a task: levels of least squares inside hard limits, the RCM's strict."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from rcmqp.controllers.base import Accounted, Command, Controller
from rcmqp.controllers.checks import bounded_gain
from rcmqp.controllers.given import JOINT_LIMITS, Given
from rcmqp.controllers.stack import LevelOfTasks, Stack
from rcmqp.errors import OptionError
from rcmqp.limits import JointLimits, KeepOut, Limit, TrocarCone, TrocarDepth, TrocarSpeed
from rcmqp.maths.options import at_least, finite, from_to
from rcmqp.qp import Bounds, Level
from rcmqp.references.view import Reference
from rcmqp.tasks import (
    ObjectiveTask,
    OrientationTask,
    RcmTask,
    RollTask,
    Task,
    TipTask,
    Together,
)
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion

CONE_DECELERATION = 1.0
"""What the shaft may be slowed down with before the cone's edge [rad/s^2]."""

CONE_LEVER = 0.1
"""How far from the trocar the cone gives way as the depth range does: about where the tip is [m].

With 1, an arm whose joints were all at their limits kept the cone and went 13 mm too deep.
"""

DEPTH_DECELERATION = 0.2
"""What the tip may be slowed down with before the end of its depth range [m/s^2]."""

OBSTACLE_DECELERATION = 0.2
"""What the instrument may be slowed down with before an obstacle [m/s^2]."""

SLOWING = 20.0
"""Gain of TrocarSpeed [1/s]."""

EASING = 0.5
"""Share of the joints' jerk that these decelerations begin and end with."""

ABLE = 3.5
"""Acceleration limit of the weakest joint from which an arm can do these [rad/s^2].

The decelerations of a weaker arm are in proportion: its joints' limits come first, and with 0.2
m/s^2 the LWA3 (1.7 rad/s^2) went 0.5 mm past the end of its depth range. Those of an arm without
limits of acceleration are not limited.
"""


NUMBERS = {
    "exact": ("1", "1 where every level is the optimum to rounding"),
    "joints_at_limit": ("1", "joints at a bound of their box"),
    "violation": ("m/s, rad/s", "largest excess of a hard row"),
    "kkt": ("1", "largest residual of the levels' optimality conditions"),
}
"""What is recorded of a step, beside a residual for each level: unit and meaning."""


@dataclass(frozen=True, eq=False)
class HierarchicalQP(Controller):
    """Limits, then the RCM, then the tool, then what is left, one priority below the other.

        lexmin_v  |A_1 v - b_1|, |A_2 v - b_2|, ...   within  lower <= v <= upper,  C v <= d

    with A and b of each level from its tasks: A v = b says that the error e goes as e' = -K e,
    the motion of the reference and of the trocar included. When the arm runs out of speed or
    range, the lower levels give way and the higher ones do not notice.

    The levels, unless ``levels`` gives others: RcmTask; TipTask; RollTask, or OrientationTask
    where the instrument has a wrist; ObjectiveTask. Any order is one expression:

        levels = [RcmTask(period=T), TipTask() + RollTask(weight=0.01)]
        HierarchicalQP(insertion, T, levels=levels)

    The limits, unless ``limits`` gives others: JointLimits (position, speed, acceleration, jerk,
    braking distance counted), TrocarSpeed, TrocarCone, TrocarDepth, KeepOut for each obstacle.

    The joints' limits always hold. The RCM is strict where it can be reached. The levels below it
    weigh joint speed against what it buys (Task.damping), so that v does not jump and the arm
    comes to rest. The table in docs/explanation/levels.md says what is strict, what is damped, and
    what the exceptions are.

    ``exact`` is 1 where every level is proved to be the optimum of that problem, with its damping,
    to rounding; see Hierarchy for the proof.

    An error is approached no faster than the joints can stop it (``approach``), so the tip comes
    to rest without overshoot, also where the reference stops, jumps, or turns back.

    Attributes:
        gain: K of every task [1/s]; K T must be below 2.
        K_c: gain of the objective, see ObjectiveTask; 0 leaves it out.
        c_d: desired value of the objective.
        objective: its name in OBJECTIVES; empty for the arm's own.
        limit_gain: how fast the trocar's limits may be approached [1/s].
        approach: share of the joints' acceleration and jerk limits that is counted on to stop an
            error at zero, see kernel/approach.c; 0 approaches in proportion, and overshoots.
        backend: ``active_set``, the hierarchy's own, has the shortest worst step; ``proxqp``,
            ``daqp`` or any solver of qpsolvers propose active sets to it: the answer is the same.
        levels: tasks, the first the most important; replaces default_levels(); only from Python.
        limits: replaces default_limits(); only from Python.
    """

    name: ClassVar[str] = "hierarchical_qp"
    moves_wrist: ClassVar[bool] = True
    feed_forward: ClassVar[bool] = True
    gain: float = field(default=60.0, metadata=bounded_gain())
    K_c: float = field(default=7.0, metadata=at_least(0.0))
    c_d: float = field(default=1.0, metadata=finite())
    objective: str = ""
    limit_gain: float = field(default=60.0, metadata=bounded_gain(below=1.0))
    approach: float = field(default=0.8, metadata=from_to(0.0, 1.0))
    backend: str = "active_set"
    levels: Sequence[LevelOfTasks] | None = None
    limits: Sequence[Limit] | None = None

    def __post_init__(self) -> None:
        """Check the options; make levels, limits and the solver.

        Raises:
            OptionError: an option's value is not allowed.
            UnknownName: there is no such objective or backend.
            SolverNotInstalled: the backend's package is missing.
        """
        super().__post_init__()
        _check_list("levels", self.levels, "tasks, such as [RcmTask(), TipTask()]")
        _check_list("limits", self.limits, "limits")
        if self.levels is not None and not len(self.levels):
            raise OptionError(
                "levels is empty; give at least one task, or None for the usual ones"
            )
        for kinds, items in (((Task, Together), self.levels), ((Limit,), self.limits)):
            for item in items or ():
                if not isinstance(item, kinds):
                    wanted = " or ".join(kind.__name__ for kind in kinds)
                    hint = "levels are tasks, limits are limits"
                    if isinstance(item, list | tuple) and Task in kinds:
                        hint = "for several tasks on one level, add them: TipTask() + RollTask()"
                    raise OptionError(f"{item!r:.80} is not a {wanted}; {hint}")
        _ = self._stack  # made now, so that errors in it are raised now

    def default_levels(self) -> Sequence[LevelOfTasks]:
        """The levels unless ``levels`` gives others; a law of one's own may return its own."""
        insertion, gain = self.insertion, self.gain
        wrist = insertion.arm.wrist
        tool = (
            RcmTask(gain=gain, period=self.period),
            TipTask.made_for(insertion, gain=gain),
            RollTask(gain=gain)
            if wrist is None
            else OrientationTask.made_for(insertion, gain=gain),
        )
        if self.K_c == 0.0:
            return tool
        options = {"objective": self.objective} if self.objective else {}
        own = ObjectiveTask.made_for(insertion, c_d=self.c_d, K_c=self.K_c, **options)
        return (*tool, own)

    @functools.cached_property
    def _stack(self) -> Stack:
        levels = self.default_levels() if self.levels is None else self.levels
        limits = self.limits
        if limits is None:
            limits = default_limits(self.insertion, self.period, self.limit_gain)
        return Stack(
            levels,
            limits,
            self.insertion.arm,
            self.period,
            approach=self.approach,
            backend=self.backend,
            guarded=int(isinstance(levels[0], RcmTask)),
            numbers=tuple(_diagnostics(levels)),
        )

    @property
    def diagnostics(self) -> Mapping[str, tuple[str, str]]:  # type: ignore[override]
        """Unit and meaning of what is recorded of a step: one residual a level, and NUMBERS."""
        return _diagnostics(self._stack.levels)

    @property
    def options(self) -> dict[str, Any]:
        """The options; levels and limits that were given, by their names."""
        given = {"levels": self.levels, "limits": self.limits}
        names = {key: value and [item.name for item in value] for key, value in given.items()}
        return super().options | names

    @property
    def given(self) -> Given:
        """The limits are those of its JointLimits; levels of one's own may be anything else."""
        boxes = [limit for limit in self._stack.limits if isinstance(limit, JointLimits)]
        count = max((4 if box.acceleration else 2 for box in boxes), default=0)
        usual = type(self).default_levels is HierarchicalQP.default_levels
        own = self.levels is not None or not usual
        return dataclasses.replace(
            super().given,
            limits=JOINT_LIMITS[:count],
            gain=None if own else self.gain,
            roll=None if own else True,
        )

    def reset(self) -> None:
        """Forget the solver's warm start."""
        self._stack.reset()

    def problem(self, state: ArmState, reference: Reference) -> tuple[list[Level], Bounds]:
        """Levels and bounds of a step, number for number, as ``Hierarchy.solve()`` takes them."""
        return self._stack.problem(state, reference)

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """One lexicographic optimum."""
        return Accounted.by(self._stack.step(state, reference))


def _diagnostics(levels: Sequence[LevelOfTasks]) -> dict[str, tuple[str, str]]:
    """NUMBERS, and before them each level's residual, its unit and meaning; no name twice."""
    found: dict[str, tuple[str, str]] = {}
    for level in levels:
        unit = "as weighted" if isinstance(level, Together) else f"{level.unit or 1}/s"
        name, turn = f"{level.name}_residual", 2
        while name in found:
            name, turn = f"{level.name}_{turn}_residual", turn + 1
        found[name] = unit, f"|A v - b| of the rows of {level.name}"
    return found | NUMBERS


def _check_list(name: str, items: object, what: str) -> None:
    """Refuse an option that is neither None nor a list.

    Raises:
        OptionError: it is something else, such as one task.
    """
    if items is not None and (isinstance(items, str) or not isinstance(items, Sequence)):
        raise OptionError(f"{name} must be a list of {what}; got {items!r:.80}")


def default_limits(insertion: Insertion, period: float, gain: float = 60.0) -> tuple[Limit, ...]:
    """Joint limits, speed that the trocar allows, its cone and depth range, and obstacles."""
    arm = insertion.arm
    bare = insertion.bare  # a wrist does not move the shaft, and a rail has other units
    acceleration, jerk = bare.acceleration[bare.turns], bare.jerk[bare.turns]
    weakest = float(np.min(acceleration, initial=np.inf))
    share = min(1.0, weakest / ABLE) if weakest < np.inf else np.inf
    limited = np.isfinite(acceleration) & np.isfinite(jerk)
    eased = EASING * np.min(jerk[limited] / acceleration[limited], initial=np.inf)

    def rates(most: float) -> dict[str, float]:
        jerk = share * most * float(eased)
        return {"gain": gain, "deceleration": share * most, "jerk": jerk, "period": period}

    return (
        JointLimits(arm, period),
        TrocarSpeed(arm, period, gain=min(SLOWING, float(eased), 1.0 / period)),
        TrocarCone(insertion.trocar, lever=CONE_LEVER, **rates(CONE_DECELERATION)),
        TrocarDepth(insertion.trocar, arm.wrist, **rates(DEPTH_DECELERATION)),
        *KeepOut.obstacles(insertion, **rates(OBSTACLE_DECELERATION)),
    )
