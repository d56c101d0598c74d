"""The base class of controllers, and the report of one step in words."""

from __future__ import annotations

import abc
import dataclasses
import functools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy import ndarray  # numpy's own look-up of a name takes some 30 ns

from rcmqp import _kernel
from rcmqp.controllers.braking import Brake
from rcmqp.controllers.checks import as_numbers, check_gains, fault, is_usable
from rcmqp.controllers.given import Given
from rcmqp.errors import InvalidCommand, OptionError
from rcmqp.limits.joints import JointLimits
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import check, positive, refused
from rcmqp.maths.smooth import braking_speed
from rcmqp.qp import HierarchySolution, InvalidProblem, LevelResult, WrongShape
from rcmqp.references.view import Reference
from rcmqp.tasks import TASKS
from rcmqp.tasks.objectives import own_objective
from rcmqp.world.arm import Arm, ArmState
from rcmqp.world.insertion import Insertion

MOST_NAMES = 3
"""Limits that a level's line names, the heaviest first."""

TOUCHING = 1e-9
"""How far a bound may be from the limit that it comes from, relative to it; and by how much a row
may be exceeded, in its unit."""

NOISE = 1e-9
"""Share of the heaviest multiplier below which another is rounding."""

_SHOWN = {"m": (1e3, "mm/s"), "rad": (1e3, "mrad/s")}


def explained(solution: HierarchySolution, arm: Arm, state: ArmState, period: float) -> str:
    """A line for each level and for each hard row that is exceeded.

        rcm: reached
        tip: 3.2 mm/s short, held back by panda_joint4 (upper speed limit)
        trocar cone: exceeded by 0.02 m/s or rad/s

    Args:
        solution: of a hierarchy whose unknowns are the arm's joints.
        arm: whose limits the joints are at.
        state: that the step was made for.
        period: [s].
    """
    lines = [_level(level, solution, arm, state, period) for level in solution.levels]
    for i, joint in enumerate(arm.joints):
        if solution.crossed[i]:
            lines.append(f"{joint}: its lower bound is above its upper one, held between them")
    rows = solution.names[len(solution.v) :]
    for name, excess in zip(rows, solution.violation, strict=True):
        if excess > TOUCHING:
            lines.append(f"{name}: exceeded by {_number(excess)} m/s or rad/s")
    return "\n".join(lines)


def _level(
    level: LevelResult, solution: HierarchySolution, arm: Arm, state: ArmState, period: float
) -> str:
    doubt = "" if level.route.exact else f" ({level.route.value}, KKT residual {level.kkt:.1g})"
    if level.reached:
        return f"{level.name}: reached{doubt}"
    factor, unit = _SHOWN.get(_unit(level.name), (1.0, "per second"))
    short = f"{_number(factor * float(np.linalg.norm(level.residual)))} {unit}"
    weights = solution.blocking(level)
    heaviest = max(map(abs, weights.values()), default=0.0)
    held = []
    for name, weight in weights.items():
        i = solution.names.index(name)
        touched = solution.at_upper[i] if weight > 0.0 else solution.at_lower[i : i + 1].any()
        if touched and abs(weight) > NOISE * heaviest:
            which = f" ({_which(solution, i, arm, state, period)})" if i < arm.nv else ""
            held.append(name + which)
    why = "the rest is taken by the levels above"
    if held:
        why = f"held back by {', '.join(held[:MOST_NAMES])}"
    return f"{level.name}: {short} short, {why}{doubt}"


def _number(x: float) -> str:
    return f"{x:.3g}" if x < 1e3 else f"{x:.0f}"


def _unit(name: str) -> str:
    """Unit of the error of a registered task; empty for others."""
    return TASKS[name].unit if name in TASKS else ""


def _which(solution: HierarchySolution, i: int, arm: Arm, state: ArmState, period: float) -> str:
    """Which of its limits joint i is at."""
    side = "upper" if solution.at_upper[i] else "lower"
    v, change = solution.v[i], (solution.v[i] - state.v[i]) / period
    towards = 1.0 if solution.at_upper[i] else -1.0
    room, easing = arm.velocity[i] - towards * state.v[i], JointLimits.easing * arm.jerk[i]
    kinds = {
        "speed": (abs(v), arm.velocity[i]),
        "acceleration": (abs(change), arm.acceleration[i]),
        "jerk": (abs(change - state.a[i]), period * arm.jerk[i]),
        "speed ": (towards * change, float(braking_speed(room, easing, period))),  # ahead of it
    }
    for kind, (given, allowed) in kinds.items():
        if math.isclose(given, allowed, rel_tol=TOUCHING):
            return f"{side} {kind.strip()} limit"
    return f"{side} position limit"


ABSURD = 1e9
"""A joint velocity above this comes of absurd numbers, and counts as none [rad/s]."""

SAFE_STOP = {"safe_stop": ("1", "1 where the joints brake instead of following")}
"""The diagnostic that every controller has."""


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """The command of one cycle.

    Attributes:
        v: (nv,) joint velocity [rad/s], finite.
        diagnostics: numbers that the run records, the same names each cycle; step() adds
            ``safe_stop``.
        account: the solver's report on the step, or None.
        stop: why this is the safe stop, in words; empty if it is not the safe stop.
        error: what the law raised, where that is why.
    """

    v: Array
    diagnostics: dict[str, float] = field(default_factory=dict)
    account: object | None = None
    stop: str = ""
    error: Exception | None = None

    @classmethod
    def of(cls, v: Array, diagnostics: dict[str, float], account: object | None = None) -> Self:
        """Command(v, diagnostics, account), in a third of the time."""
        return _kernel.record(cls, v, diagnostics, account, "", None)


class Accounted(Command):
    """A Command whose account is a HierarchySolution, and its diagnostics what that has recorded.

    They are made when somebody asks for them. A copy is a plain Command, and so is what
    dataclasses.replace() makes of it.
    """

    __slots__ = ()

    @classmethod
    def by(cls, solution: HierarchySolution) -> Command:
        """The command of a solution; without Python's constructor."""
        return _kernel.record(cls, solution.v, ..., solution, "", None)

    def __new__(cls, *args: Any, **options: Any) -> Command:  # type: ignore[misc]
        """A plain Command."""
        return Command(*args, **options)

    def __reduce__(self) -> tuple[type[Command], tuple[object, ...]]:
        """A plain Command, for copies."""
        return Command, (self.v, self.diagnostics, self.account, self.stop, self.error)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> dict[str, float]:
            """The diagnostics, the same dictionary each time."""
            if name != "diagnostics":
                raise AttributeError(f"a Command has no attribute {name!r}")
            recorded = self.account.recorded
            recorded.setdefault("safe_stop", 0.0)
            return recorded


@dataclass(frozen=True, eq=False)
class Controller(abc.ABC):
    """Joint velocities from arm states and references.

    A step depends on its two arguments and on a solver's warm start, nothing else; after
    reset() a rerun gives the same bits.

    A step always answers, with numbers. Where a joint reading is not finite, the reference not
    finite or no pose, or the law finds no finite velocity, it answers with the safe stop: the
    joints slow down as fast as their limits of acceleration and jerk allow, the shaft staying on
    the trocar where they let it, see Brake; the command says why, and the diagnostic ``safe_stop``
    is 1.
    A derived class gives the law, in _step(), and need not look after any of this.

    Attributes:
        name: in CONTROLLERS; a class that gives none has its own, MyLaw that of my_law.
        diagnostics: unit and meaning of each number that a Command's diagnostics hold.
        enforces: which of the arm's joint limits the law enforces, of JOINT_LIMITS; None does not
            say. Tables name them, see ``given``.
        holds_roll: whether the law controls the instrument's roll about its shaft, likewise.
        remark: a sentence that a reader of its numbers needs; it stands below tables of them.
        law_file: FILE.py:CLASS of a law that settings.registered() took out of a file.
        insertion: what is controlled.
        moves_wrist: whether the law knows of a tool that a wrist turns.
        period: sampling period T [s].
    """

    name: ClassVar[str]
    moves_wrist: ClassVar[bool] = False
    diagnostics: ClassVar[Mapping[str, tuple[str, str]]] = {}
    enforces: ClassVar[tuple[str, ...] | None] = None
    holds_roll: ClassVar[bool | None] = None
    remark: ClassVar[str] = ""
    law_file: ClassVar[str] = ""

    insertion: Insertion
    period: float = field(metadata=positive("s"))

    def __init_subclass__(cls, **options: Any) -> None:
        """Give each subclass a ``name`` of its own; it is never inherited."""
        super().__init_subclass__(**options)
        if "name" not in vars(cls):
            cls.name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", cls.__name__).lower()

    def __post_init__(self) -> None:
        """Check that each option is of its default's kind, and as its field declares.

        Raises:
            OptionError, UnknownName: one is not; or the instrument has a wrist that the law does
                not know.
        """
        if self.insertion.arm.wrist is not None and not self.moves_wrist:
            raise OptionError(
                f"{self.name} is for an instrument whose tool is fixed to the shaft; use "
                "hierarchical_qp with a wrist"
            )
        for item in dataclasses.fields(self):
            if item.init and isinstance(item.default, bool | float | str):
                _check_kind(item.name, getattr(self, item.name), type(item.default))
        check(self)
        check_gains(self, self.period)

    def __getstate__(self) -> dict[str, Any]:
        """What a copy keeps: all but what is made when first needed. It begins as if reset."""
        kind, made = type(self), functools.cached_property
        return {
            k: v for k, v in vars(self).items() if not isinstance(getattr(kind, k, None), made)
        }

    @property
    def options(self) -> dict[str, Any]:
        """The options that this controller runs with."""
        names = [item.name for item in dataclasses.fields(self) if item.init]
        return {name: getattr(self, name) for name in names if name not in ("insertion", "period")}

    @property
    def given(self) -> Given:
        """What the controller is given; every table, page and figure of its runs says it.

        It is known of ``feed_forward``, ``gain``, ``enforces``, ``holds_roll``, and of
        ``objective`` and ``K_c``, where it is 0 and not by default. A law whose options change
        more than that overrides this property.
        """
        gain = getattr(self, "gain", None)
        ahead = getattr(self, "feed_forward", None)
        objective = getattr(self, "objective", "")
        if getattr(self, "K_c", 1.0) == 0.0 != getattr(type(self), "K_c", 0.0):
            objective = "none"
        if not isinstance(objective, str) or objective == own_objective(self.insertion.arm):
            objective = ""
        return Given(
            ahead,
            self.enforces,
            gain=gain,
            roll=self.holds_roll,
            objective=objective,
            file=self.law_file,
        )

    def reset(self) -> None:  # noqa: B027  (most controllers keep nothing)
        """Forget the run so far."""

    def step(self, state: ArmState, reference: Reference) -> Command:
        """The joint velocity to hold until the next cycle: the law's, or the safe stop.

        Raises:
            WrongShape: the law, a task or a limit has an array of a wrong shape.
            InvalidCommand: the law did not return a Command, or its v is not an array.
        """
        if not is_usable(state, reference):
            state, reference = as_numbers(state, reference)
            wrong = fault(state, reference)
            if wrong:
                return self.safe_stop(state, wrong)
        try:
            answer = self._step(state, reference)
        except WrongShape:
            raise
        except (ArithmeticError, np.linalg.LinAlgError, InvalidProblem) as error:
            stop = self.safe_stop(state, f"{type(error).__name__}: {error}")
            return dataclasses.replace(stop, error=error)
        if not isinstance(getattr(answer, "v", None), ndarray):
            raise InvalidCommand(f"{self.name}: {_wrong_kind(answer)}")
        if not _kernel.all_finite(answer.v, ABSURD):
            return self.safe_stop(state, "the law has no finite velocity here")
        if type(answer) is not Accounted:
            answer.diagnostics["safe_stop"] = 1.0 if answer.stop else 0.0
        return answer

    @functools.cached_property
    def _brake(self) -> Brake:
        return Brake(self.insertion, self.period)

    @abc.abstractmethod
    def _step(self, state: ArmState, reference: Reference) -> Command:
        """The law. State and reference are finite, and x_d is a pose; see step()."""

    def report(self, state: ArmState, command: Command) -> str:
        """Report a step in words: why it stopped; each level, and the bounds that block it.

        Args:
            state: that the step was made for.
            command: what it answered.
        """
        lines = [f"safe stop: {command.stop}"] if command.stop else []
        if isinstance(command.account, HierarchySolution):
            lines.append(explained(command.account, self.insertion.arm, state, self.period))
        return "\n".join(lines) or f"{self.name}: a law without levels, nothing to report"

    def safe_stop(
        self,
        state: ArmState,
        reason: str,
        diagnostics: Mapping[str, float] | None = None,
        account: object | None = None,
    ) -> Command:
        """Return the safe stop, see Brake, as a Command with the reason.

        Args:
            state: of the arm.
            reason: a few words, always the same for the same reason.
            diagnostics: those that are known; the controller's others become NaN.
            account: as in Command.
        """
        numbers = dict.fromkeys(self.diagnostics, math.nan) | dict(diagnostics or {})
        brake = self._brake
        brake.reset()
        v = brake.velocity(state.angles, state.v, state.a, state)
        return Command(v, numbers | {"safe_stop": 1.0}, account, reason)


def _wrong_kind(answer: object) -> str:
    """Error text for a _step() that returned something other than a Command."""
    got = f"a {type(answer).__name__}"
    if isinstance(answer, Command):
        got = f"a Command whose v is a {type(answer.v).__name__}"
    return (
        f"_step() returned {got}; it must return Command(v), v an array of joint velocities, such "
        "as np.zeros(state.v.size)"
    )


def _check_kind(name: str, value: object, kind: type) -> None:
    allowed: dict[type, tuple[type, ...]] = {bool: (bool,), float: (float, int), str: (str,)}
    if not isinstance(value, allowed[kind]) or (kind is float and isinstance(value, bool)):
        raise refused(name, value, f"a {kind.__name__}")
