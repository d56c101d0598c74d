"""The input of a hierarchy, levels and bounds, and its solution."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rcmqp import _kernel
from rcmqp.errors import InvalidProblem
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp.problem import Status, checked

Flags: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Level:
    """One priority: make |A v - b| least.

    Attributes:
        A: (m, n); m may be zero.
        b: (m,), in the rows' unit per second for an unknown v in rad/s.
        name: for messages.
        damping: what a unit of speed must gain to be worth it, in the rows' unit; zero for a
            strict level. See ``Hierarchy``.

    Raises:
        InvalidProblem: the sizes do not belong together, a number is not finite, or the damping
            is neither zero nor from 1e-9 to 1e3.
    """

    A: Array
    b: Array
    name: str
    damping: float

    def __new__(cls, A: ArrayLike, b: ArrayLike, name: str = "", damping: float = 0.0) -> Self:
        """Copy, protect and check the numbers."""
        matrix = checked(A, (-1, -1), f"A of level {name!r}")
        vector = checked(b, (len(matrix),), f"b of level {name!r}")
        if damping != 0.0 and not 1e-9 <= damping <= 1e3:
            raise InvalidProblem(
                f"damping of level {name!r} is {damping}; give 0, or a number from 1e-9 to 1e3"
            )
        return _kernel.record(cls, matrix, vector, name, float(damping))

    def __reduce__(self) -> tuple[type[Self], tuple[Array, Array, str, float]]:
        """Make copies by __new__(), which checks."""
        return type(self), (self.A, self.b, self.name, self.damping)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Bounds:
    """The limits above every level: a box that always holds, and rows C v <= d.

    Where rows contradict each other or the box, they are violated least in the least-squares
    sense, in their own units. A joint with lower > upper is held in the middle of the two.

    Attributes:
        lower: (n,), -inf for none.
        upper: (n,), inf for none.
        C: (m, n) hard rows.
        d: (m,), inf for none.
        names: (n + m,) names of the unknowns, then of the rows, for messages.
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
        C: ArrayLike | None = None,
        d: ArrayLike | None = None,
        names: Sequence[str] = (),
    ) -> Self:
        """Copy, protect and check the numbers."""
        lower = checked(lower, (-1,), "lower", -np.inf)
        n = lower.size
        rows = checked(np.zeros((0, n)) if C is None else C, (-1, n), "C")
        names = tuple(names) or (
            *(f"v[{i}]" for i in range(n)),
            *(f"row {i}" for i in range(len(rows))),
        )
        if len(names) != n + len(rows):
            raise InvalidProblem(
                f"{len(names)} names for {n} unknowns and {len(rows)} rows; give {n + len(rows)}"
            )
        upper = checked(upper, (n,), "upper", np.inf)
        most = checked(np.zeros(0) if d is None else d, (len(rows),), "d", np.inf)
        return _kernel.record(cls, lower, upper, rows, most, names)

    def __reduce__(self) -> tuple[type[Self], tuple[Array, Array, Array, Array, tuple[str, ...]]]:
        """Make copies by __new__(), which checks."""
        return type(self), (self.lower, self.upper, self.C, self.d, self.names)


class Route(enum.Enum):
    """How a level was answered, and how far that can be relied on."""

    CLOSED_FORM = "closed form"
    """No bound is in the way. Exact."""
    POLISHED = "polished"
    """The active set of the last cycle, or the backend's, was right at once. Exact."""
    ACTIVE_SET = "active set"
    """Own active-set rounds found the optimum. Exact."""
    UNVERIFIED = "unverified"
    """The best feasible point found; its optimality conditions miss the tolerance."""
    KEPT = "kept"
    """Numbers beyond double precision: the level changed nothing."""

    @property
    def exact(self) -> bool:
        """Whether the answer is the optimum to rounding."""
        return self in (Route.CLOSED_FORM, Route.POLISHED, Route.ACTIVE_SET)


@dataclass(frozen=True, slots=True, eq=False)
class LevelResult:
    """The result of one level.

    Attributes:
        name: the level's.
        route: how it was answered.
        residual: (m,) A v - b at the final v.
        reached: |A v - b| is zero to 1e-9 of the level's size, or to a hundredth of its damping.
        kkt: residual of the level's optimality conditions, see ``Hierarchy``. Of a damped level
            and those below it, at its own optimum, and of the problem that it became: inside
            bounds with the goal of its last proximal step, and of a strict one below with what is
            left of b. So an exact level may have a large residual.
        multipliers: (n + m,) of box and hard rows at this level, in the rows' own units,
            positive at upper bounds: what they keep the level from. Zero for the rest.
        rounds: of the active set, in all steps of the level; without those of a guess that was
            given up.
        backend: the backend's verdict, None if it was not asked.
    """

    name: str
    route: Route
    residual: Array
    reached: bool
    kkt: float
    multipliers: Array
    rounds: int
    backend: Status | None


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class HierarchySolution:
    """The lexicographic optimum and an account of it, made when it is asked for.

    Attributes:
        v: (n,) inside the box, always finite.
        names: (n + m,) of the bounds.
    """

    v: Array
    names: Sequence[str]
    _answer: Answer
    _level_names: Sequence[str]
    _asked: Mapping[int, Status]

    @property
    def violation(self) -> Array:
        """(m,) by how much each hard row is exceeded, at least zero, row's unit."""
        return self._answer.violation

    @property
    def summary(self) -> tuple[float, ...]:
        """The numbers of a step that a run records.

        |A v - b| of each level but the rest; whether all is exact; joints at a bound; largest
        excess of a hard row; largest KKT residual of a level.
        """
        norms = (float(np.linalg.norm(level.residual)) for level in self.levels)
        bounded = self.at_lower | self.at_upper[: self.v.size]
        excess = float(self.violation.max(initial=0.0))
        kkt = float(self._answer.info[1:, 2].max())
        return (*norms, float(self.exact), float(bounded.sum()), excess, kkt)

    @property
    def recorded(self) -> dict[str, float]:
        """The summary by name, the same dictionary each time; empty for Hierarchy.solve()."""
        return self._answer.account.summary or {}

    @property
    def limits(self) -> LevelResult:
        """The hard rows; its residual is ``violation``."""
        return self._result(0, "limits", self.violation)

    @property
    def levels(self) -> tuple[LevelResult, ...]:
        """The results of the levels, in their order."""
        ends = [0, *(int(end) for end in self._answer.ends)]
        return tuple(
            self._result(k + 1, name, self._answer.residual[ends[k] : ends[k + 1]])
            for k, name in enumerate(self._level_names)
        )

    @property
    def rest(self) -> LevelResult:
        """The last level, min |v - v_rest|."""
        n = self.v.size
        return self._result(len(self._answer.info) - 1, "rest", self._answer.residual[-n:])

    @property
    def lower(self) -> Array:
        """(n,) the box as asked."""
        return self._answer.lower

    @property
    def upper(self) -> Array:
        """(n,)."""
        return self._answer.upper

    @property
    def at_lower(self) -> Flags:
        """(n,) unknowns at their lower bound."""
        return np.asarray(self._answer.touching[0, : self.v.size] > 0.0, dtype=bool)

    @property
    def at_upper(self) -> Flags:
        """(n + m,) unknowns, then hard rows, at their upper bound (or beyond it)."""
        return np.asarray(self._answer.touching[1] > 0.0, dtype=bool)

    @property
    def crossed(self) -> Flags:
        """(n,) unknowns whose lower bound was above the upper one."""
        return np.asarray(self._answer.lower > self._answer.upper, dtype=bool)

    @property
    def exact(self) -> bool:
        """Whether every level is answered exactly."""
        return self._answer.exact

    @property
    def limits_hold(self) -> bool:
        """Whether no box bound was crossed and no hard row is exceeded."""
        return not self.crossed.any() and self.limits.reached

    def active(self) -> dict[str, str]:
        """Names of the bounds that v touches: ``{"joint_2": "upper", "cone 4": "upper"}``."""
        lower = {self.names[i]: "lower" for i in np.flatnonzero(self.at_lower).tolist()}
        return lower | {self.names[i]: "upper" for i in np.flatnonzero(self.at_upper).tolist()}

    def blocking(self, level: LevelResult) -> dict[str, float]:
        """Names and multipliers of the bounds that block a level, largest multiplier first."""
        order = np.argsort(-np.abs(level.multipliers), kind="stable")
        weights = ((self.names[i], float(level.multipliers[i])) for i in order)
        return {name: weight for name, weight in weights if weight}

    def _result(self, k: int, name: str, residual: Array) -> LevelResult:
        route, rounds, kkt, reached = self._answer.info[k]
        return LevelResult(
            name,
            ROUTES[int(route)],
            residual,
            bool(reached),
            float(kkt),
            self._answer.multipliers[k],
            int(rounds),
            self._asked.get(k),
        )


ROUTES = tuple(Route)
"""In the order of their numbers in compiled code."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Answer:
    """Numbers of one solve, as compiled code leaves them; read-only.

    Attributes:
        account: makes them when one of them is asked for.
        ends: (levels,) where each level's rows end; the last level is the rest.
        n: unknowns.
        m: hard rows.
    """

    account: _kernel.Account
    ends: NDArray[np.int64]
    n: int
    m: int

    @property
    def numbers(self) -> Array:
        """All of them in one array, in the order of the properties below."""
        return self.account.numbers

    @property
    def lower(self) -> Array:
        """(n,) the box as asked."""
        return self.numbers[: self.n]

    @property
    def upper(self) -> Array:
        """(n,)."""
        return self.numbers[self.n : 2 * self.n]

    @property
    def residual(self) -> Array:
        """(rows,) A v - b of all levels."""
        return self._part(3 * self.n, int(self.ends[-1]))

    @property
    def violation(self) -> Array:
        """(m,) by how much each hard row is exceeded."""
        return self._part(3 * self.n + int(self.ends[-1]), self.m)

    @property
    def touching(self) -> Array:
        """(2, n + m) 1 where v is at the lower, at the upper bound."""
        bounds = self.n + self.m
        return self._part(3 * self.n + int(self.ends[-1]) + self.m, 2 * bounds).reshape(2, bounds)

    @property
    def multipliers(self) -> Array:
        """(levels + 1, n + m); index 0 is the hard rows."""
        bounds, count = self.n + self.m, self.ends.size + 1
        start = self.numbers.size - count * (bounds + 4)
        return self._part(start, count * bounds).reshape(count, bounds)

    @property
    def info(self) -> Array:
        """(levels + 1, 4) route, rounds, KKT residual, whether reached."""
        count = self.ends.size + 1
        return self.numbers[-4 * count :].reshape(count, 4)

    @property
    def exact(self) -> bool:
        """Whether every level is answered exactly."""
        return bool((self.info[:, 0] < ROUTES.index(Route.UNVERIFIED)).all())

    def _part(self, start: int, size: int) -> Array:
        return self.numbers[start : start + size]
