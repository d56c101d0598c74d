"""What a hierarchy is asked and what it answers."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rcmqp.dualquaternion import Array
from rcmqp.qp.problem import InvalidProblem, Status, checked

Flags: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Level:
    """One priority: make |A v - b| least.

    Attributes:
        A: (m, n); m may be zero.
        b: (m,), in the rows' unit per second for an unknown v in rad/s.
        name: for messages.
    """

    A: Array
    b: Array
    name: str

    def __init__(self, A: ArrayLike, b: ArrayLike, name: str = "") -> None:
        matrix = checked(A, (-1, -1), f"A of level {name!r}")
        object.__setattr__(self, "A", matrix)
        object.__setattr__(self, "b", checked(b, (len(matrix),), f"b of level {name!r}"))
        object.__setattr__(self, "name", name)


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

    def __init__(
        self,
        lower: ArrayLike,
        upper: ArrayLike,
        C: ArrayLike | None = None,
        d: ArrayLike | None = None,
        names: Sequence[str] = (),
    ) -> None:
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
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", checked(upper, (n,), "upper", np.inf))
        object.__setattr__(self, "C", rows)
        d = np.zeros(0) if d is None else d
        object.__setattr__(self, "d", checked(d, (len(rows),), "d", np.inf))
        object.__setattr__(self, "names", names)


class Route(enum.Enum):
    """How a level was answered, and how far that can be relied on."""

    CLOSED_FORM = "closed form"
    """No bound is in the way. Exact."""
    POLISHED = "polished"
    """The backend's active set, optimum on it in closed form, verified. Exact."""
    ACTIVE_SET = "active set"
    """Own active-set rounds, because there is no backend or its answer failed. Exact."""
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
    """What became of one level.

    Attributes:
        name: the level's.
        route: how it was answered.
        residual: (m,) A v - b at the final v.
        reached: |A v - b| is zero to 1e-9 of the level's size.
        kkt: residual of the level's optimality conditions at the final v, see
            ``Hierarchy``.
        multipliers: (n + m,) of box and hard rows at this level, in the rows' own units,
            positive at upper bounds: what they keep the level from. Zero for the rest.
        rounds: active-set rounds spent after the backend.
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


@dataclass(frozen=True, slots=True, eq=False)
class HierarchySolution:
    """The lexicographic optimum and an account of it.

    Attributes:
        v: (n,) inside the box, always finite.
        limits: level 0, the hard rows; its residual is ``violation``.
        levels: one for each level asked.
        rest: the last level, min |v - v_rest|.
        violation: (m,) by how much each hard row is exceeded, at least zero, row's unit.
        at_lower: (n,) unknowns at their lower bound.
        at_upper: (n + m,) unknowns, then hard rows, at their upper bound (or beyond it).
        crossed: (n,) unknowns whose lower bound was above the upper one.
        names: (n + m,) of the bounds.
        solve_time: wall-clock time [s]; not reproducible, everything else is.
    """

    v: Array
    limits: LevelResult
    levels: tuple[LevelResult, ...]
    rest: LevelResult
    violation: Array
    at_lower: Flags
    at_upper: Flags
    crossed: Flags
    names: tuple[str, ...]
    solve_time: float

    @property
    def exact(self) -> bool:
        """Whether every level is answered exactly."""
        return all(x.route.exact for x in (self.limits, *self.levels, self.rest))

    @property
    def limits_hold(self) -> bool:
        """Whether no box bound was crossed and no hard row is exceeded."""
        return not self.crossed.any() and self.limits.reached

    def active(self) -> dict[str, str]:
        """Names of the bounds that v touches: ``{"joint_2": "upper", "cone 4": "upper"}``."""
        lower = {self.names[i]: "lower" for i in np.flatnonzero(self.at_lower)}
        return lower | {self.names[i]: "upper" for i in np.flatnonzero(self.at_upper)}

    def blocking(self, level: LevelResult) -> dict[str, float]:
        """What keeps a level from its goal, heaviest first: names and multipliers."""
        order = np.argsort(-np.abs(level.multipliers), kind="stable")
        weights = ((self.names[i], float(level.multipliers[i])) for i in order)
        return {name: weight for name, weight in weights if weight}
