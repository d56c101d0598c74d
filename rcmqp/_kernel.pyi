from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

T = TypeVar("T")
Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Backend = Callable[[int, Array, Array, Array, Array, Array], Array]

RCM: int
TIP: int
ROLL: int
POSE: int
POSTURE: int
SRS_PRODUCT: int
MANIPULABILITY: int
JOINTS: int
TROCAR_CONE: int
TROCAR_DEPTH: int
KEEP_OUT: int
HELIX: int
CIRCLE: int
LISSAJOUS: int
TASK_NUMBERS: int
LIMIT_NUMBERS: int
JOINT_NUMBERS: int

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
    max_rounds: int,
    v: Array | None,
    guess: Array,
    backend: Backend | None,
    /,
) -> tuple[Array, Array]: ...
def step(
    tasks: Array,
    vectors: Array,
    ends: Ints,
    damping: Array,
    limits: Array,
    joints: Array,
    braking: Array,
    guarded: int,
    max_rounds: int,
    x: Array,
    J_local: Array,
    angles: Array,
    v: Array,
    a: Array,
    x_d: Array,
    x_d_dot: Array,
    pivot: Array,
    pivot_dot: Array,
    guess: Array,
    backend: Backend | None,
    names: tuple[str, ...],
    /,
) -> tuple[Array, Array, dict[str, float]]: ...
def approached(
    above: Array,
    A: Array,
    e: Array,
    carried: Array,
    gain: float,
    damping: float,
    v: Array,
    a: Array,
    acceleration: Array,
    jerk: Array,
    braking: Array,
    /,
) -> Array: ...
def joint_bounds(
    line: Array, joints: Array, angles: Array, v: Array, a: Array, /
) -> tuple[Array, Array]: ...
def usable(
    J_local: Array,
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
def moved(q: ArrayLike, v: ArrayLike, dt: float, /) -> Array | None: ...
def all_finite(values: ArrayLike, /) -> bool: ...
def law(
    x: Array,
    J_local: Array,
    angles: Array,
    x_d: Array,
    x_d_dot: Array,
    objective: tuple[int, *tuple[Array, ...]] | tuple[None, float, Array],
    numbers: Array,
    limits: Array,
    feed_forward: bool,
    limited: int,
    /,
) -> tuple[Array, float, float, float, float]: ...
def singularity_product(angles: Array, offsets: Array, /) -> tuple[float, Array]: ...
def manipulability_measure(J_local: Array, /) -> tuple[float, Array]: ...
def least_singular_values(J: Array, /) -> Array: ...
def from_xyzquat(placement: Array, /) -> Array: ...
def carried(x: Array, offset: Array, /) -> Array: ...
def view_pose(
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
) -> tuple[Array, Array, Array, Array] | None: ...
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
