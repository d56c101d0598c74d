"""Levels of tasks below limits, solved cycle by cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

from rcmqp import _kernel
from rcmqp.errors import OptionError
from rcmqp.limits import Constraint, Limit, SphereLimit, TrocarDepth
from rcmqp.limits.base import CompiledLimit
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp import Hierarchy, HierarchySolution, InvalidProblem, Level, WrongShape
from rcmqp.qp.hierarchy import NO_VERDICTS
from rcmqp.qp.levels import Answer, Bounds
from rcmqp.references.view import Reference, cycle
from rcmqp.tasks import ObjectiveTask, Residual, Task, Together
from rcmqp.tasks.base import block_of
from rcmqp.world.arm import Arm, ArmState

LevelOfTasks: TypeAlias = Task | Together

Evaluated: TypeAlias = tuple[list[Residual], list[Constraint], list[tuple[Array, ...]]]
"""What is written in Python gives in a cycle, and the same as compiled code takes it."""

NOTHING: Evaluated = ([], [], [])

WRIST_LIMITS = TrocarDepth, SphereLimit
"""Limits that count each joint of a wrist, so that they are for one instrument only."""

MOST_ROWS = 4000
"""Rows of tasks, and of limits, that are written in Python; compiled ones have their own room."""


class Stack:
    """Tasks in levels and limits of an arm, with the scratch and the warm start of their solver.

    In each cycle the tasks and limits that are written in Python are evaluated first, and their
    rows are handed over. All other rows are made in compiled code, which then solves the whole.

    Attributes:
        levels: highest priority first.
        limits: in the order in which they narrow the box.
    """

    def __init__(
        self,
        levels: Sequence[LevelOfTasks],
        limits: Sequence[Limit],
        arm: Arm,
        period: float,
        *,
        approach: float,
        backend: str,
        guarded: int,
        numbers: Sequence[str],
    ) -> None:
        """Make the compiled part.

        Args:
            levels: see the attribute.
            limits: see the attribute.
            arm: whose joints the unknowns are.
            period: sampling period T [s].
            approach: share of the joints' limits that errors brake with, see HierarchicalQP.
            backend: see Hierarchy.
            guarded: see Hierarchy.solve().
            numbers: names of what is recorded of a step, four more than there are levels.

        Raises:
            OptionError: a task or a limit of the library is for another number of joints, or
                another wrist, or one has a method of its own that would not be asked.
            UnknownName, SolverNotInstalled: the backend is not known, or its package is missing.
        """
        self.levels, self.limits = tuple(levels), tuple(limits)
        members = [_tasks_of(level) for level in self.levels]
        tasks = [task for level in members for task in level]
        for asked in (*self.levels, *tasks, *self.limits):
            _check_asked(asked)
        for item in (*tasks, *self.limits):
            block = block_of(item)
            if block and block.joints not in (0, arm.nv):
                raise OptionError(
                    f"{type(item).__name__} is for {block.joints} joints, {arm.name} has "
                    f"{arm.nv}; make it for this arm"
                )
            has = len(arm.wrist.joints) if arm.wrist else 0
            if block and isinstance(item, WRIST_LIMITS) and block.bends != has:
                raise OptionError(
                    f"{type(item).__name__} is for an instrument {_wrist(int(block.bends))}, here "
                    f"it is one {_wrist(has)}; make it for this insertion: made_for(insertion, "
                    "period)"
                )
        self._hierarchy = hierarchy = Hierarchy(backend)
        self._has_backend = hierarchy.asks is not None
        self._joints, self._nv = arm.joints, arm.nv
        self._level_names = tuple(level.name for level in self.levels)
        self._tasks = [task for task in tasks if block_of(task) is None]
        self._given = [limit for limit in self.limits if block_of(limit) is None]
        self._row_names = [
            limit.row_names if isinstance(limit, CompiledLimit) and block_of(limit) else None
            for limit in self.limits
        ]
        self._asks = bool(self._tasks or self._given)
        self._names = () if self._given else self._all_names(())
        self._compiled = _kernel.Stack(
            levels=tuple(
                (level.speed_damping, tuple(_member(task, level) for task in shared))
                for level, shared in zip(self.levels, members, strict=True)
            ),
            limits=tuple(block_of(limit) for limit in self.limits),
            acceleration=arm.acceleration,
            jerk=arm.jerk,
            share=approach,
            period=period,
            guarded=guarded,
            max_rounds=hierarchy.max_rounds,
            names=tuple(numbers),
        )

    def reset(self) -> None:
        """Forget the warm start."""
        self._hierarchy.reset()
        self._compiled.reset()

    def step(
        self, state: ArmState, reference: Reference, evaluated: Evaluated | None = None
    ) -> HierarchySolution:
        """Solve one step; its account is made when somebody asks for a number of it.

        Args:
            state: of the arm.
            reference: what the tasks are asked for.
            evaluated: the rows of tasks and limits in Python, if they are evaluated already.

        Raises:
            InvalidProblem: what a task or a limit in Python gives is not usable.
            WrongShape: they give more rows than there is room for.
        """
        if evaluated is None:
            evaluated = self._rows(state, reference) if self._asks else NOTHING
        residuals, constraints, given = evaluated
        hierarchy = self._hierarchy if self._has_backend else None
        found = self._compiled.step(
            state.x,
            state.J_local,
            state.angles,
            state.v,
            state.a,
            reference.x_d,
            reference.x_d_dot,
            reference.pivot,
            reference.pivot_dot,
            state.tool_at,
            given,
            None if hierarchy is None else hierarchy.asks,
        )
        if found is None:
            raise self._refusal(residuals, constraints)
        v, account, ends, m = found
        names = self._all_names(constraints) if constraints else self._names
        answer = _kernel.record(Answer, account, ends, self._nv, m)
        asked = NO_VERDICTS if hierarchy is None else hierarchy.verdicts()
        return _kernel.record(HierarchySolution, v, names, answer, self._level_names, asked)

    def problem(self, state: ArmState, reference: Reference) -> tuple[list[Level], Bounds]:
        """The problem that step() solves, with the same numbers, for Hierarchy.solve().

        Raises:
            InvalidProblem: what a task or a limit in Python gives is not usable.
        """
        residuals, constraints, given = self._rows(state, reference)
        found = self._compiled.problem(*cycle(state, reference), given)
        if found is None:
            raise self._refusal(residuals, constraints)
        A, b, ends, lower, upper, C, d = found
        starts = [0, *ends[:-1].tolist()]
        levels = [
            Level(A[start:end], b[start:end], level.name, damping=level.speed_damping)
            for start, end, level in zip(starts, ends.tolist(), self.levels, strict=False)
        ]
        return levels, Bounds(lower, upper, C, d, self._all_names(constraints))

    def _rows(self, state: ArmState, reference: Reference) -> Evaluated:
        """Evaluate the tasks and limits that are written in Python."""
        residuals = [task.residual(state, reference) for task in self._tasks]
        constraints = [limit.constraint(state, reference) for limit in self._given]
        _check_rows(self._tasks, [len(r.error) for r in residuals])
        _check_rows(self._given, [len(c.d) for c in constraints])
        arrays: list[tuple[Array, ...]] = [(r.error, r.jacobian, r.drift) for r in residuals]
        arrays += [(c.lower, c.upper, c.C, c.d) for c in constraints]
        return residuals, constraints, arrays

    def _all_names(self, constraints: Sequence[Constraint]) -> tuple[str, ...]:
        """Names of the joints, then of the hard rows."""
        asked, names = iter(constraints), list(self._joints)
        for known in self._row_names:
            names += next(asked).names if known is None else known
        return tuple(names)

    def _refusal(
        self, residuals: Sequence[Residual], constraints: Sequence[Constraint]
    ) -> InvalidProblem:
        """Say why compiled code does not accept some rows."""
        kind = ""
        try:
            for task, residual in zip(self._tasks, residuals, strict=True):
                kind = type(task).__name__
                level = Level(residual.jacobian, -residual.error - residual.drift, task.name)
                unknowns = level.A.shape[1]
                if unknowns != self._nv and len(level.A):
                    return InvalidProblem(
                        f"level {task.name!r} has {unknowns} unknowns, the bounds have {self._nv}"
                    )
            for limit, found in zip(self._given, constraints, strict=True):
                kind = type(limit).__name__
                Bounds(found.lower, found.upper, found.C, found.d)
        except InvalidProblem as error:
            return InvalidProblem(f"{kind}: {error}")
        return InvalidProblem("a task or a limit gives rows that cannot be used")


def _wrist(joints: int) -> str:
    return f"whose wrist has {joints} joints" if joints else "without a wrist"


def _tasks_of(level: LevelOfTasks) -> tuple[Task, ...]:
    return level.tasks if isinstance(level, Together) else (level,)


def _member(task: Task, level: LevelOfTasks) -> tuple[_kernel.Block | None, float, float]:
    """A task as compiled code takes it: its rows, gain and the root of its weight.

    A weight means nothing on a level of its own, and an objective has no error to reduce.
    """
    gain = 0.0 if isinstance(task, ObjectiveTask) else task.gain
    return block_of(task), gain, 1.0 if task is level else math.sqrt(task.weight)


def _check_rows(items: Sequence[Task] | Sequence[Limit], counts: Sequence[int]) -> None:
    """Refuse more rows than compiled code has room for.

    Raises:
        WrongShape: with the task or limit that gives most of them.
    """
    if sum(counts) > MOST_ROWS:
        most = max(counts)
        raise WrongShape(
            f"{type(items[counts.index(most)]).__name__}.evaluate() gives {most} rows, "
            f"{sum(counts)} with those of the others; at most {MOST_ROWS} are allowed: give "
            "fewer, for example only the worst"
        )


NOT_ASKED = ("level", "residual", "constraint", "interval")
"""Methods of tasks and limits that a step does not ask: compiled code does the same."""


def _check_asked(item: object) -> None:
    """Refuse a class of a user's with a method that would be passed over.

    Raises:
        OptionError: it has one.
    """
    for cls in type(item).__mro__:
        if cls.__module__.startswith("rcmqp."):
            return
        for name in NOT_ASKED:
            if name in vars(cls):
                raise OptionError(
                    f"{cls.__name__} has a {name}() of its own, which a step does not ask; give "
                    "it an evaluate()"
                )
