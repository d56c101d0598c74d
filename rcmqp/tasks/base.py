"""What every task is, and how tasks share a level."""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp.levels import Level
from rcmqp.qp.problem import InvalidProblem
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion

Program: TypeAlias = tuple[tuple[float, ...], tuple[ArrayLike, ...]]
"""Kind, root of the weight and parameters; vectors (nv,)."""


@dataclass(frozen=True, slots=True, eq=False)
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

    def __post_init__(self) -> None:
        """Copy, protect and check the shapes."""
        for name in self.__slots__:
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        m = self.error.shape
        if (
            len(m) != 1
            or self.jacobian.ndim != 2
            or not m == self.jacobian.shape[:1] == self.drift.shape
        ):
            raise InvalidProblem(
                f"error {m}, jacobian {self.jacobian.shape} and drift {self.drift.shape} do not "
                "belong together; a task of m rows has (m,), (m, nv) and (m,)"
            )


DAMPING = {"m": 0.01, "rad": 0.03}
"""What 1 rad/s must gain to be worth it, by the unit of a task's error: 10 mm/s, 30 mrad/s."""

DAMPINGS = 1e-6, 1e3
"""Least and largest damping of a level that is not strict: beyond them rounding decides."""


@dataclass(frozen=True, slots=True, eq=False)
class Approach:
    """How fast an error may be reduced if the joints are still to stop it at zero.

    A task wants the rate -gain e. Where |e| is large the joints could not stop from that in
    time, and the error would overshoot. With n = e / |e| and w = [above; A]^+ [0; n] the joints'
    part in it, damped by the level's damping, they can slow it down at min_j a_j / |w_j| at the
    most, and change that at min_j j_j / |w_j|. So the rate is at most that from which a stop ends
    at zero, at ``share`` of that acceleration and half of that jerk. Where jerk is limited, a new
    rate is approached no faster than at the acceleration that can be eased off by the time it is
    there; see kernel/approach.c. All this is continuous in the state, and changes nothing where
    errors are small and the joints' acceleration leads to the wanted rate, as in following a path.

    Attributes:
        v: (nv,) the last command.
        a: (nv,) its last change over the period.
        acceleration: (nv,) limits, inf for none.
        jerk: (nv,) limits, inf for none.
        share: of the acceleration limits that is counted on; 0 for -gain e throughout.
        period: sampling period T [s].
        above: (m, nv) rows of the levels above, which the task has to leave as they are.
    """

    v: Array
    a: Array
    acceleration: Array
    jerk: Array
    share: float
    period: float
    above: Array

    def rate(
        self, rows: Array, error: Array, carried: Array, gain: float, damping: float
    ) -> Array:
        """Rate (m,) that a task may ask for.

        Args:
            rows: (m, nv) of the task.
            error: (m,).
            carried: (m,) minus what the error changes by while the joints stand still.
            gain: [1/s].
            damping: of the level; 0 where it is strict.
        """
        braking = np.array([self.period, self.share])
        task = self.above, np.ascontiguousarray(rows), error, carried, gain, damping
        return _kernel.approached(*task, self.v, self.a, self.acceleration, self.jerk, braking)


@dataclass(frozen=True, eq=False, kw_only=True)
class Task(abc.ABC):
    """A quantity to bring to zero: wants jacobian @ v = -gain error - drift.

    A new task is a frozen dataclass with evaluate(), and a name if it goes into TASKS. It
    depends on the state and the reference, nothing else.

    Attributes:
        unit: of the error, ``"m"`` or ``"rad"``; empty for another or none.
        gain: how fast the error goes [1/s]: as exp(-gain t). With a sampling period T the
            error shrinks by 1 - gain T in a cycle, so gain T above 1 overshoots and above 2
            diverges: whoever knows T checks that.
        weight: of its squared residual against those of the tasks it shares a level with; it
            means nothing on a level of its own.
        damping: what a joint speed of 1 rad/s must gain to be worth it [unit of the error]; 0
            makes the level strict, see ``Hierarchy``. None, the default, is DAMPING of the unit.

    Raises:
        OptionError: gain or weight is not positive, or damping negative.
    """

    name: ClassVar[str] = "task"
    unit: ClassVar[str] = ""

    gain: float = 60.0
    weight: float = 1.0
    damping: float | None = None

    def __post_init__(self) -> None:
        """Check gain, weight and damping."""
        check_positive("gain", self.gain, "1/s")
        check_positive("weight", self.weight)
        if self.damping is not None and self.damping != 0.0:
            low, high = DAMPINGS
            if not low <= self.damping <= high:
                raise OptionError(
                    f"damping = {self.damping}; it must be 0 for a strict level, or from {low:g} "
                    f"to {high:g}"
                )

    @property
    def speed_damping(self) -> float:
        """The damping in force, [unit of the error] a radian."""
        return DAMPING.get(self.unit, 0.0) if self.damping is None else self.damping

    @classmethod
    def made_for(cls, insertion: Insertion, **options: Any) -> Self:
        """The task for an insertion; fields called arm, instrument, trocar, tip_depth fill in."""
        return cls(**filled_in(cls, insertion, options))

    @abc.abstractmethod
    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error, Jacobian and drift at ``state``."""

    def program(self) -> Program | None:
        """The task for compiled code, see rcmqp/kernel/rows.h; None: evaluate() is called."""
        return None

    def level(
        self, state: ArmState, reference: Reference, approach: Approach | None = None
    ) -> Level:
        """The task as a level of a hierarchy, in the error's unit per second.

        Args:
            state: of the arm.
            reference: what is asked.
            approach: how fast errors may be reduced; without one, in proportion.

        Raises:
            InvalidProblem: what evaluate() gives does not belong together, or is no Residual.
        """
        residual, damping = self.residual(state, reference), self.speed_damping
        wanted = self._wanted(residual, 1.0, damping, approach)
        return Level(residual.jacobian, wanted, self.name, damping=damping)

    def residual(self, state: ArmState, reference: Reference) -> Residual:
        """What evaluate() gives, checked.

        Raises:
            InvalidProblem: it does not belong together, or is no Residual.
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

    def _wanted(
        self, residual: Residual, root: float, damping: float, approach: Approach | None
    ) -> Array:
        """The rate asked for, minus drift (m,); all rows are multiplied by ``root`` for it."""
        if approach is None or residual.jacobian.shape[1] != approach.v.size:
            return -self.gain * residual.error - residual.drift
        rows, error, carried = (
            root * part for part in (residual.jacobian, residual.error, -residual.drift)
        )
        rate = approach.rate(rows, error, carried, self.gain, damping)
        return rate / root - residual.drift

    def __add__(self, other: Task | Together) -> Together:
        """Both on one level."""
        return Together((self,)) + other


@dataclass(frozen=True, eq=False)
class Together:
    """Tasks on one level: min sum of weight |jacobian @ v + gain error + drift|^2.

    Made by adding tasks: ``TipTask(0.1) + RollTask(weight=0.01)``. Errors in metres and in
    radians are added up as they stand; the weights say what a radian is worth.

    Attributes:
        tasks: at least one.
    """

    tasks: tuple[Task, ...]

    def __post_init__(self) -> None:
        """Check that there is something to do."""
        if not self.tasks:
            raise OptionError("a level without tasks; give it one, or leave it out")

    @property
    def name(self) -> str:
        """Names of the tasks."""
        return " + ".join(task.name for task in self.tasks)

    @property
    def speed_damping(self) -> float:
        """The largest of the tasks', each multiplied by the root of its weight."""
        return max(math.sqrt(task.weight) * task.speed_damping for task in self.tasks)

    def level(
        self, state: ArmState, reference: Reference, approach: Approach | None = None
    ) -> Level:
        """All rows, each multiplied by the root of its task's weight; see Task.level()."""
        damping, A, b = self.speed_damping, [], []
        for task in self.tasks:
            residual, root = task.residual(state, reference), math.sqrt(task.weight)
            A.append(root * residual.jacobian)
            b.append(root * task._wanted(residual, root, damping, approach))
        return Level(np.vstack(A), np.concatenate(b), self.name, damping=damping)

    def __add__(self, other: Task | Together) -> Together:
        """All on one level."""
        if not isinstance(other, Task | Together):
            return NotImplemented
        more = other.tasks if isinstance(other, Together) else (other,)
        return Together((*self.tasks, *more))


def filled_in(
    cls: type, insertion: Insertion, options: Mapping[str, Any], **more: Any
) -> dict[str, Any]:
    """Options of a dataclass, with what an insertion, and whoever asks, knows by name.

    Raises:
        OptionError: an option without a default is still missing.
    """
    known = more | {
        "arm": insertion.arm,
        "instrument": insertion.instrument,
        "trocar": insertion.trocar,
        "tip_depth": insertion.tip_depth,
    }
    fields = [field for field in dataclasses.fields(cls) if field.init]
    found = {field.name: known[field.name] for field in fields if field.name in known}
    found.update(options)
    missing = [
        field.name
        for field in fields
        if field.name not in found
        and field.default is field.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise OptionError(f"{cls.__name__} needs {' and '.join(missing)}; give a value for each")
    return found


def check_name(kind: str, name: str, registry: Mapping[str, type], options: Iterable[str]) -> None:
    """Check a name of a registry, and the names of its options.

    Raises:
        UnknownName: the registry, or the dataclass of that name, does not have it.
    """
    if name not in registry:
        raise UnknownName(kind, name, registry)
    known = [field.name for field in dataclasses.fields(registry[name]) if field.init]
    for option in options:
        if option not in known:
            raise UnknownName(f"option of {name}", option, known)


def check_positive(name: str, value: float, unit: str = "") -> None:
    """Refuse what is not a positive, finite number.

    Raises:
        OptionError: with the name and the value.
    """
    if not 0.0 < value < math.inf:
        given = f"{name} = {value} {unit}".rstrip()
        raise OptionError(f"{given}; it must be positive and finite")


def check_finite(name: str, value: float, unit: str = "") -> None:
    """Refuse NaN and infinity.

    Raises:
        OptionError: with the name and the value.
    """
    if not math.isfinite(value):
        given = f"{name} = {value} {unit}".rstrip()
        raise OptionError(f"{given}; it must be a finite number")
