"""The base classes of limits, and how limits become the bounds of a hierarchy."""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.errors import InvalidProblem, OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import allowed, check, positive, positive_or_inf
from rcmqp.qp.levels import Bounds
from rcmqp.references.view import Reference, cycle
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion, filled_in


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Constraint:
    """The joint velocities that a limit allows: lower <= v <= upper and C v <= d.

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

    def __new__(
        cls,
        lower: ArrayLike,
        upper: ArrayLike,
        C: ArrayLike,
        d: ArrayLike,
        names: Sequence[str],
    ) -> Self:
        """Copy, protect and check the shapes."""
        low, up = _kernel.frozen(lower, -1), _kernel.frozen(upper, -1)
        rows, most = _kernel.frozen(C, -1, -1), _kernel.frozen(d, -1)
        if (
            low is None
            or up is None
            or rows is None
            or most is None
            or low.shape != up.shape
            or rows.shape != most.shape + low.shape
        ):
            shapes = np.shape(lower), np.shape(upper), np.shape(C), np.shape(d)
            raise InvalidProblem(
                f"lower, upper, C and d have shapes {shapes}; they must be (nv,), (nv,), (m, nv) "
                "and (m,)"
            )
        names = tuple(names)
        if len(names) != len(most):
            raise InvalidProblem(
                f"C has {len(most)} rows, and there are {len(names)} names, {names}; give a "
                "list with a name for each row"
            )
        if not (low <= up).all():
            raise InvalidProblem(
                f"lower = {low} and upper = {up} leave an empty box; give numbers "
                "with lower <= upper"
            )
        return _kernel.record(cls, low, up, rows, most, names)

    def __reduce__(self) -> tuple[type[Self], tuple[Array, Array, Array, Array, tuple[str, ...]]]:
        """Make copies by __new__(), which checks."""
        return type(self), (self.lower, self.upper, self.C, self.d, self.names)

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

    def __post_init__(self) -> None:
        """Check every option by its rule."""
        check(self)

    @classmethod
    def made_for(cls, insertion: Insertion, period: float, **options: Any) -> Self:
        """The limit for an insertion and a sampling period T [s].

        Fields called arm, instrument, trocar, wrist and period fill in.
        """
        return cls(**filled_in(cls, insertion, options, period=period))

    @abc.abstractmethod
    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """The constraint at ``state``."""

    def constraint(self, state: ArmState, reference: Reference) -> Constraint:
        """Call evaluate() and check what it returns.

        Raises:
            InvalidProblem: it is not a Constraint for this arm; the message names the limit.
        """
        kind, n = type(self).__name__, state.angles.size
        try:
            constraint = self.evaluate(state, reference)
        except InvalidProblem as error:
            raise InvalidProblem(f"{kind}: {error}") from error
        if not isinstance(constraint, Constraint):
            raise InvalidProblem(
                f"{kind}.evaluate() returned {constraint!r}, it must be a Constraint"
            )
        if constraint.lower.size != n:
            raise InvalidProblem(f"{kind} is for {constraint.lower.size} joints, the arm has {n}")
        return constraint

    def __getstate__(self) -> dict[str, Any]:
        """Return only the options; what is computed from them is computed again."""
        return {item.name: getattr(self, item.name) for item in dataclasses.fields(self)}


@dataclass(frozen=True, eq=False, kw_only=True)
class CompiledLimit(Limit):
    """A limit whose rows are compiled: those of its ``block``."""

    def __init_subclass__(cls, **options: Any) -> None:
        """Refuse a pace() that the compiled rows would not call.

        Raises:
            TypeError: a class has one, without an evaluate() that asks it.
        """
        super().__init_subclass__(**options)
        if "pace" in vars(cls) and "evaluate" not in vars(cls):
            raise TypeError(
                f"{cls.__name__} has a pace() of its own, which the compiled rows of its base do "
                "not ask; give it an evaluate(), too"
            )

    @property
    @abc.abstractmethod
    def block(self) -> _kernel.Block:
        """The box, or the rows, made once of the options."""

    def __post_init__(self) -> None:
        """Make the rows now, since arrays among the options may change later."""
        super().__post_init__()
        _ = self.block

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the rows, for messages."""
        return ()

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """The constraint at ``state``."""
        rows = self.block.rows(*cycle(state, reference))
        return _kernel.record(Constraint, *rows, self.row_names)


@dataclass(frozen=True, eq=False, kw_only=True)
class Damper(Limit):
    """A limit s >= 0 on a quantity s(q, t), by the velocity damper ds/dt >= -pace(s).

    pace(s) = gain s (Faverjon and Tournassoud 1987): while s is positive it may shrink as
    exp(-gain t) at most; where it is negative it must come back at that pace. In cycles of
    T,

        s(k+1) >= (1 - gain T) s(k) - rho,   rho <= (T^2 / 2) max |d^2 s / dt^2| in the cycle,

    so with gain T <= 1 a limit that holds at the start is kept to rho / (gain T): exactly for
    an s that changes evenly during a cycle, to second order in T for others. The controller,
    which knows T, checks gain T.

    To slow down as gain s does takes gain^2 s, which joints with acceleration limits may not
    have. The rows are hard, but not magic: the solver then violates them as little as it can,
    at the cost of every task, the RCM too. ``deceleration`` keeps the braking distance: pace
    goes over into the root sqrt(2 A s) where gain s would need more than A, see pace(). With
    ``jerk``, ds/dt is moreover no faster than a speed from which s can stop at zero, if its
    deceleration grows by jerk T a cycle, up to A, and falls as slowly. How s changes now is
    known: by state.v and state.a, and by the bend of the way, which is what s is accelerated by
    while the joints go on as they do (kernel/bend.c); what a wrist's own joints add to it is not
    counted. If s comes too fast for that, the row asks for a deceleration that still grows by
    jerk T a cycle, beyond A if need be; an acceleration a towards the limit, above A / 4, falls
    4 a / A times as fast. On the way back from beyond the limit it asks for A at most. A jerk T
    of 2 A or more is not counted.

    Attributes:
        gain: [1/s].
        deceleration: A, how fast ds/dt may be asked to change [unit of s / s^2]; inf, the
            default, for joints without acceleration limits. It is for all joints together, in
            the worst direction, and what the RCM needs goes off.
        jerk: how fast that may change [unit of s / s^3]; inf, the default, for joints without
            jerk limits.
        period: sampling period T [s]; only ``jerk`` asks for it.

    Raises:
        OptionError: gain, deceleration or jerk is not positive, or there is a jerk without a
            deceleration or a period.
    """

    gain: float = field(default=60.0, metadata=positive("1/s"))
    deceleration: float = field(default=math.inf, metadata=positive_or_inf())
    jerk: float = field(default=math.inf, metadata=positive_or_inf())
    period: float = 0.0

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        if self.jerk < math.inf:
            allowed("period", self.period, positive("s"))
            if self.deceleration == math.inf:
                raise OptionError(f"jerk = {self.jerk} without a deceleration; give both")

    @property
    def rates(self) -> dict[str, float]:
        """The options that every damper's _kernel.Block has."""
        names = ("gain", "deceleration", "jerk", "period")
        return {name: getattr(self, name) for name in names}

    def pace(self, s: float) -> float:
        """How fast s may shrink; negative, how fast it must grow, where s is.

            gain s                            up to s = A / gain^2,
            sqrt(2 A (s - A / (2 gain^2)))    beyond: its slope times itself is A.

        Continuous with its slope, never above gain s, and odd.
        """
        return _kernel.paced(self.gain, self.deceleration, s)


def check_gain(gain: float, period: float) -> None:
    """Refuse a gain [1/s] at which a limit is overrun in cycles of a period [s].

    Raises:
        OptionError: their product is above 1.
    """
    if gain * period > 1.0:
        raise OptionError(
            f"gain * period = {gain} 1/s * {period} s = {gain * period:.3g}; a damper keeps its "
            "limit up to 1: lower the gain or sample faster"
        )


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
        InvalidProblem: a limit returns something else than a Constraint for this arm.
    """
    n = state.angles.size
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    constraints = [limit.constraint(state, reference) for limit in limits]
    for constraint in constraints:
        lower, upper = intersect(lower, upper, constraint.lower, constraint.upper)
    rows = [name for constraint in constraints for name in constraint.names]
    return Bounds(
        lower,
        upper,
        np.vstack([np.zeros((0, n)), *(constraint.C for constraint in constraints)]),
        np.concatenate([np.zeros(0), *(constraint.d for constraint in constraints)]),
        (*(joints or [f"v[{i}]" for i in range(n)]), *rows),
    )


def intersect(
    lower: Array, upper: Array, next_lower: Array, next_upper: Array
) -> tuple[Array, Array]:
    """The part of a second box (n,) that lies in a first one; its nearest face if none does."""
    return np.clip(next_lower, lower, upper), np.clip(next_upper, lower, upper)
