"""What every limit is, and how limits become the bounds of a hierarchy."""

from __future__ import annotations

import abc
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp.levels import Bounds
from rcmqp.qp.problem import InvalidProblem
from rcmqp.references.view import Reference
from rcmqp.tasks.base import check_positive, filled_in
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion


@dataclass(frozen=True, slots=True, eq=False)
class Constraint:
    """What a limit allows: lower <= v <= upper and C v <= d.

    The arrays are copied in and read-only.

    Attributes:
        lower: (nv,) -inf for none.
        upper: (nv,) inf for none.
        C: (m, nv) hard rows.
        d: (m,) in the rows' unit per second.
        names: of the rows, for messages.

    Raises:
        InvalidProblem: sizes that do not belong together, or an empty box.
    """

    lower: Array
    upper: Array
    C: Array
    d: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        """Copy, protect and check the shapes."""
        for name in ("lower", "upper", "C", "d"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "names", tuple(self.names))
        n, m = self.lower.size, self.d.size
        found = self.lower.shape, self.upper.shape, self.C.shape, self.d.shape
        if found != ((n,), (n,), (m, n), (m,)):
            raise InvalidProblem(
                f"lower, upper, C and d have shapes {found}; they must be (nv,), (nv,), (m, nv) "
                "and (m,)"
            )
        if len(self.names) != m:
            raise InvalidProblem(
                f"C has {m} rows, and there are {len(self.names)} names, {self.names}; give a "
                "list with a name for each row"
            )
        if not (self.lower <= self.upper).all():
            raise InvalidProblem(
                f"lower = {self.lower} and upper = {self.upper} leave an empty box; give numbers "
                "with lower <= upper"
            )

    @classmethod
    def box(cls, lower: ArrayLike, upper: ArrayLike) -> Constraint:
        """No rows."""
        lower = np.asarray(lower, dtype=float)
        return cls(lower, np.asarray(upper), np.zeros((0, lower.size)), np.zeros(0), ())

    @classmethod
    def rows(cls, C: ArrayLike, d: ArrayLike, names: Sequence[str]) -> Constraint:
        """No box."""
        C = np.asarray(C, dtype=float)
        free = np.full(C.shape[-1], np.inf)
        return cls(-free, free, C, np.asarray(d), tuple(names))


@dataclass(frozen=True, eq=False, kw_only=True)
class Limit(abc.ABC):
    """Something that v must never do, whatever the tasks want.

    A new limit is a frozen dataclass with evaluate(), and a name if it goes into LIMITS. It
    depends on the state and the reference, nothing else.
    """

    name: ClassVar[str] = "limit"

    @classmethod
    def made_for(cls, insertion: Insertion, period: float, **options: Any) -> Self:
        """The limit for an insertion and a sampling period T [s].

        Fields called arm, instrument, trocar, tip_depth and period fill in.
        """
        return cls(**filled_in(cls, insertion, options, period=period))

    @abc.abstractmethod
    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """What is allowed at ``state``."""

    def program(self) -> tuple[float, ...] | None:
        """The limit for compiled code, see rcmqp/kernel/rows.h; None: evaluate() is called."""
        return None

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the rows, for messages; as in evaluate()."""
        return ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Damper(Limit):
    """A limit s >= 0 on a quantity s(q, t), by the velocity damper ds/dt >= -pace(s).

    pace(s) = gain s (Faverjon and Tournassoud 1987): while s is positive it may shrink as
    exp(-gain t) at the most; where it is negative it must come back at that pace. In cycles of
    T,

        s(k+1) >= (1 - gain T) s(k) - rho,   rho <= (T^2 / 2) max |d^2 s / dt^2| in the cycle,

    so with gain T <= 1 a limit that holds at the start is kept to rho / (gain T): exactly for
    an s that changes evenly during a cycle, to second order in T for others. Whoever knows T
    checks gain T.

    To slow down as gain s does takes gain^2 s, which joints with acceleration limits may not
    have. The rows are hard, but not magic: the solver then violates them as little as it can,
    at the cost of every task, the RCM too. ``deceleration`` keeps the braking distance: pace
    goes over into the root sqrt(2 A s) where gain s would need more than A, see pace().

    Attributes:
        gain: [1/s].
        deceleration: A, how fast ds/dt may be asked to change [unit of s / s^2]; inf, the
            default, for joints without acceleration limits. It is for all joints together, in
            the worst direction, and what the RCM needs goes off.

    Raises:
        OptionError: gain or deceleration is not positive.
    """

    gain: float = 60.0
    deceleration: float = math.inf

    def __post_init__(self) -> None:
        """Check the options."""
        check_positive("gain", self.gain, "1/s")
        if not self.deceleration > 0.0:
            raise OptionError(
                f"deceleration = {self.deceleration}; it must be positive, inf for none"
            )

    def pace(self, s: float) -> float:
        """How fast s may shrink; negative, how fast it must grow, where s is.

            gain s                            up to s = A / gain^2,
            sqrt(2 A (s - A / (2 gain^2)))    beyond: its slope times itself is A.

        Continuous with its slope, never above gain s, and odd.
        """
        A, size = self.deceleration, abs(s)
        if self.gain**2 * size <= A:
            return self.gain * s
        return math.copysign(math.sqrt(2.0 * A * size - (A / self.gain) ** 2), s)


def combine(
    limits: Iterable[Limit],
    state: ArmState,
    reference: Reference,
    joints: Sequence[str] = (),
) -> Bounds:
    """Every limit at once, as the bounds of a hierarchy.

    Boxes are intersected and rows are stacked. Where the box of a limit lies apart from those
    before it, in a joint, the joint is held at the nearest velocity that those allow: the limit
    listed first wins, and the box is never empty because limits disagree.

    Args:
        limits: any number.
        state: of the arm, with its velocity.
        reference: where the trocar is and how it moves.
        joints: (nv,) names for messages; ``v[0]``, ``v[1]``, ... if not given.

    Raises:
        InvalidProblem: what a limit gives is no Constraint for this arm; with its name.
    """
    n = state.angles.size
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    found = [_checked(limit, state, reference) for limit in limits]
    for constraint in found:
        lower, upper = intersect(lower, upper, constraint.lower, constraint.upper)
    rows = [name for constraint in found for name in constraint.names]
    return Bounds(
        lower,
        upper,
        np.vstack([np.zeros((0, n)), *(constraint.C for constraint in found)]),
        np.concatenate([np.zeros(0), *(constraint.d for constraint in found)]),
        (*(joints or [f"v[{i}]" for i in range(n)]), *rows),
    )


def _checked(limit: Limit, state: ArmState, reference: Reference) -> Constraint:
    """What a limit allows."""
    kind, n = type(limit).__name__, state.angles.size
    try:
        found = limit.evaluate(state, reference)
    except InvalidProblem as error:
        raise InvalidProblem(f"{kind}: {error}") from error
    if not isinstance(found, Constraint):
        raise InvalidProblem(f"{kind}.evaluate() returned {found!r}, it must be a Constraint")
    if found.lower.size != n:
        raise InvalidProblem(f"{kind} is for {found.lower.size} joints, the arm has {n}")
    return found


def intersect(
    lower: Array, upper: Array, next_lower: Array, next_upper: Array
) -> tuple[Array, Array]:
    """The part of a second box (n,) that lies in a first one; its nearest face if none does."""
    return np.clip(next_lower, lower, upper), np.clip(next_upper, lower, upper)
