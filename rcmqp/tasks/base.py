"""The base classes of tasks, and how tasks share a level."""

from __future__ import annotations

import abc
import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.errors import InvalidProblem, OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import check, or_none, positive, refused, rule
from rcmqp.qp.levels import Level
from rcmqp.references.view import Reference, cycle
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion, filled_in


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Residual:
    """Linear model of a task's error: d(error)/dt = jacobian @ v + drift.

    The arrays are copied in and read-only.

    Attributes:
        error: (m,) zero where the task is done.
        jacobian: (m, nv) its derivative by the joints.
        drift: (m,) its change while the joints stand still [1/s]: the reference and the trocar
            move.

    Raises:
        InvalidProblem: the three do not belong together.
    """

    error: Array
    jacobian: Array
    drift: Array

    def __new__(cls, error: ArrayLike, jacobian: ArrayLike, drift: ArrayLike) -> Self:
        """Copy, protect and check the shapes."""
        e, J, d = (
            _kernel.frozen(error, -1),
            _kernel.frozen(jacobian, -1, -1),
            _kernel.frozen(drift, -1),
        )
        if e is None or J is None or d is None or not e.size == len(J) == d.size:
            raise InvalidProblem(
                f"error {np.shape(error)}, jacobian {np.shape(jacobian)} and drift "
                f"{np.shape(drift)} do not belong together; a task of m rows has (m,), (m, nv) "
                "and (m,)"
            )
        return _kernel.record(cls, e, J, d)

    def __reduce__(self) -> tuple[type[Self], tuple[Array, Array, Array]]:
        """Make copies by __new__(), which checks."""
        return type(self), (self.error, self.jacobian, self.drift)


DAMPING = {"m": 0.01, "rad": 0.03}
"""What 1 rad/s must gain to be worth it, by the unit of a task's error: 10 mm/s, 30 mrad/s."""

DAMPINGS = 1e-6, 1e3
"""Least and largest damping of a level that is not strict: beyond them rounding decides."""


def _damping(name: str, value: float) -> float:
    low, high = DAMPINGS
    if not (value == 0.0 or low <= value <= high):
        raise refused(name, value, f"0 for a strict level, or from {low:g} to {high:g}")
    return value


def block_of(item: object) -> _kernel.Block | None:
    """The compiled rows of a task or a limit, or value of an objective; None without any.

    A derived class that has an evaluate() of its own is asked that, whatever it derives from.
    """
    for cls in type(item).__mro__:
        if "block" in vars(cls):
            found: _kernel.Block | None = getattr(item, "block")  # noqa: B009  (not every item has one)
            return found
        if "evaluate" in vars(cls):
            return None
    return None


@dataclass(frozen=True, eq=False, kw_only=True)
class Task(abc.ABC):
    """A quantity to bring to zero: wants jacobian @ v = -gain error - drift.

    A new task is a frozen dataclass with evaluate(), and a name if it goes into TASKS. It
    depends on the state and the reference, nothing else.

    Attributes:
        unit: of the error, ``"m"`` or ``"rad"``; empty for another or none.
        gain: how fast the error goes [1/s]: as exp(-gain t). With a sampling period T the
            error shrinks by 1 - gain T in a cycle, so gain T above 1 overshoots and above 2
            diverges: the controller, which knows T, checks that.
        weight: of its squared residual against those of the tasks it shares a level with; it
            means nothing on a level of its own.
        damping: what a joint speed of 1 rad/s must gain to be worth it [unit of the error]; 0
            makes the level strict, see ``Hierarchy``. None, the default, is DAMPING of the unit.

    Raises:
        OptionError: gain or weight is not positive, or damping negative.
    """

    name: ClassVar[str] = "task"
    unit: ClassVar[str] = ""

    gain: float = field(default=60.0, metadata=positive("1/s"))
    weight: float = field(default=1.0, metadata=positive())
    damping: float | None = field(default=None, metadata=or_none(rule(_damping)))

    def __post_init__(self) -> None:
        """Check every option by its rule."""
        check(self)

    @property
    def speed_damping(self) -> float:
        """The damping in use [unit of the error per radian]."""
        return DAMPING.get(self.unit, 0.0) if self.damping is None else self.damping

    @classmethod
    def made_for(cls, insertion: Insertion, **options: Any) -> Self:
        """The task for an insertion; fields called arm, instrument, trocar and wrist fill in."""
        return cls(**filled_in(cls, insertion, options))

    @abc.abstractmethod
    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error, Jacobian and drift at ``state``."""

    def level(self, state: ArmState, reference: Reference) -> Level:
        """The task as a level of a hierarchy, errors reduced in proportion, at its gain.

        The rows are in the error's unit per second.

        Raises:
            InvalidProblem: evaluate() returns sizes that do not fit, or not a Residual.
        """
        residual = self.residual(state, reference)
        wanted = -self.gain * residual.error - residual.drift
        return Level(residual.jacobian, wanted, self.name, damping=self.speed_damping)

    def residual(self, state: ArmState, reference: Reference) -> Residual:
        """Call evaluate() and check what it returns.

        Raises:
            InvalidProblem: its sizes do not fit, or it is not a Residual.
        """
        try:
            residual = self.evaluate(state, reference)
        except InvalidProblem as error:
            raise InvalidProblem(f"{type(self).__name__}: {error}") from error
        if not isinstance(residual, Residual):
            raise InvalidProblem(
                f"{type(self).__name__}.evaluate() returned {residual!r}, it must be a Residual"
            )
        return residual

    def __getstate__(self) -> dict[str, Any]:
        """Return only the options; what is computed from them is computed again."""
        return {item.name: getattr(self, item.name) for item in dataclasses.fields(self)}

    def __add__(self, other: Task | Together) -> Together:
        """Put both tasks on one level."""
        return Together((self,)) + other


@dataclass(frozen=True, eq=False, kw_only=True)
class CompiledTask(Task):
    """A task whose rows are compiled: those of its ``block``."""

    @property
    @abc.abstractmethod
    def block(self) -> _kernel.Block | None:
        """The rows, made once of the options."""

    def __post_init__(self) -> None:
        """Make the rows now: what was given may be written to later."""
        super().__post_init__()
        _ = self.block

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error, Jacobian and drift at ``state``."""
        assert self.block is not None
        return _kernel.record(Residual, *self.block.rows(*cycle(state, reference)))


@dataclass(frozen=True, eq=False)
class Together:
    """Tasks on one level: min sum of weight |jacobian @ v + gain error + drift|^2.

    Made by adding tasks: ``TipTask() + RollTask(weight=0.01)``. Errors in metres and in
    radians are added up as they stand; the weights say what a radian is worth.

    Attributes:
        tasks: at least one.
    """

    tasks: tuple[Task, ...]

    def __post_init__(self) -> None:
        """Check that there is at least one task."""
        if not self.tasks:
            raise OptionError("a level without tasks; give it one, or leave it out")

    @property
    def name(self) -> str:
        """Names of the tasks, with a plus sign between them."""
        return " + ".join(task.name for task in self.tasks)

    @property
    def speed_damping(self) -> float:
        """The largest of the tasks', each multiplied by the root of its weight."""
        return max(math.sqrt(task.weight) * task.speed_damping for task in self.tasks)

    def level(self, state: ArmState, reference: Reference) -> Level:
        """All rows, each multiplied by the root of its task's weight; see Task.level()."""
        parts = [(math.sqrt(task.weight), task.level(state, reference)) for task in self.tasks]
        A = np.vstack([root * part.A for root, part in parts])
        b = np.concatenate([root * part.b for root, part in parts])
        return Level(A, b, self.name, damping=self.speed_damping)

    def __add__(self, other: Task | Together) -> Together:
        """Put all tasks on one level."""
        if not isinstance(other, Task | Together):
            return NotImplemented
        more = other.tasks if isinstance(other, Together) else (other,)
        return Together((*self.tasks, *more))
