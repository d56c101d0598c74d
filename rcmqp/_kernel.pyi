from collections.abc import Callable
from typing import Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

T = TypeVar("T")
Array = NDArray[np.float64]
Ints = NDArray[np.int64]
ToolAt = tuple[float] | tuple[float, Array, Array]
# x, J_local, angles, v, a, x_d, x_d_dot, pivot, pivot_dot, tool_at: see references/view.py
Cycle = tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array, ToolAt]
Backend = Callable[[int, Array, Array, Array, Array, Array], Array]

HELIX: int
CIRCLE: int
LISSAJOUS: int
SETS: int

class Block:
    @property
    def joints(self) -> int: ...
    @property
    def bends(self) -> float: ...
    def __new__(cls, kind: str, /, **options: object) -> Self: ...
    def rows(
        self,
        x: ArrayLike,
        J_local: ArrayLike,
        angles: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        x_d: ArrayLike,
        x_d_dot: ArrayLike,
        pivot: ArrayLike,
        pivot_dot: ArrayLike,
        tool_at: tuple[float] | tuple[float, Array, Array],
        /,
    ) -> tuple[Array, ...]: ...
    def goal(self, *cycle_and_gain: *tuple[*Cycle, float]) -> tuple[Array, Array]: ...
    def interval(
        self, angles: ArrayLike, v: ArrayLike, a: ArrayLike, /
    ) -> tuple[Array, Array]: ...
    def value(self, J_local: Array, angles: Array, /) -> tuple[float, Array]: ...

class Account:
    @property
    def numbers(self) -> Array: ...
    @property
    def summary(self) -> dict[str, float] | None: ...

class Stack:
    def __new__(
        cls,
        *,
        levels: tuple[tuple[float, tuple[tuple[Block | None, float, float], ...]], ...],
        limits: tuple[Block | None, ...],
        acceleration: Array,
        jerk: Array,
        share: float,
        period: float,
        guarded: int,
        max_rounds: int,
        names: tuple[str, ...],
    ) -> Self: ...
    def step(
        self, *cycle_and_more: *tuple[*Cycle, list[tuple[Array, ...]], Backend | None]
    ) -> tuple[Array, Account, Ints, int] | None: ...
    def problem(
        self, *cycle_and_given: *tuple[*Cycle, list[tuple[Array, ...]]]
    ) -> tuple[Array, Array, Ints, Array, Array, Array, Array] | None: ...
    def reset(self) -> None: ...

def solve(
    A: Array,
    b: Array,
    ends: Ints,
    damping: Array,
    lower: Array,
    upper: Array,
    C: Array,
    d: Array,
    guarded: int,
    sluggish: int,
    max_rounds: int,
    v: Array | None,
    sets: Array,
    backend: Backend | None,
    /,
) -> tuple[Array, Account]: ...
def usable(
    J_local: Array,
    x: Array,
    angles: Array,
    q: Array,
    v: Array,
    a: Array,
    x_d: Array,
    x_d_dot: Array,
    pivot: Array,
    pivot_dot: Array,
    tolerance: float,
    /,
) -> bool: ...
def frozen(values: ArrayLike, /, *shape: int) -> Array | None: ...
def record(cls: type[T], /, *fields: object) -> T: ...
def state(
    cls: type[T],
    q: Array,
    angles: Array,
    oMe: object,
    placement: Array,
    J_local: Array,
    v: ArrayLike | None,
    a: ArrayLike | None,
    still: Array,
    tool_at: ToolAt,
    /,
) -> T | None: ...
def moved(q: ArrayLike, v: ArrayLike, dt: float, size: int, /) -> Array | None: ...
def all_finite(values: ArrayLike, below: float = ..., /) -> bool: ...
def law(
    x: Array,
    J_local: Array,
    angles: Array,
    x_d: Array,
    x_d_dot: Array,
    objective: Block | tuple[float, Array],
    numbers: Array,
    limits: Array,
    feed_forward: bool,
    limited: int,
    /,
) -> tuple[Array, float, float, float, float]: ...
def paced(gain: float, deceleration: float, s: float, /) -> float: ...
def least_singular_values(J: Array, /) -> Array: ...
def in_order(
    levels: tuple[tuple[Array, Array], ...], inverse: Array, rest: Array | None, /
) -> tuple[Array, float]: ...
def manipulability(*cycle: *Cycle) -> tuple[float, Array]: ...
def from_xyzquat(placement: Array, /) -> Array: ...
def carried(x: Array, offset: Array, /) -> Array: ...
def view_pose(
    cls: type[T],
    x_rcm: ArrayLike,
    alpha: float,
    beta: float,
    gamma: float,
    t_z: float,
    alpha_dot: float,
    beta_dot: float,
    gamma_dot: float,
    t_z_dot: float,
    pivot_dot: ArrayLike,
    /,
) -> T | None: ...
def approach(
    x_rcm: Array,
    pivot_0: Array,
    x: Array,
    target: Array,
    left: int,
    parts: int,
    period: float,
    x_wanted: Array,
    pivot: Array,
    pivot_dot: Array,
    far_angle: float,
    far_depth: float,
    /,
) -> tuple[Array, Array, int, Array, Array, bool]: ...
def store(table: Array, k: int, /, *arrays: Array) -> None: ...
def views(
    figure: int,
    numbers: Array,
    duration: float,
    ramp: float,
    times: Array,
    tip_depth: float,
    /,
) -> Array: ...
def view_poses(
    x_rcm: Array, views: Array, offsets: Array, pivot_dots: Array, /
) -> tuple[Array, Array, Array]: ...
def observed(
    x: Array, x_d: Array, pivots: Array, axis: Array, tip_depth: float, /
) -> tuple[Array, Array, Array]: ...
def contour(
    points: Array, vertices: Array, along: Array, first: int, since: int, /
) -> tuple[Array, Array]: ...
