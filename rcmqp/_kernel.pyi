from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Backend = Callable[[int, Array, Array, Array, Array, Array], Array]

RCM: int
TIP: int
ROLL: int
POSTURE: int
SRS_PRODUCT: int
MANIPULABILITY: int
JOINTS: int
TROCAR_CONE: int
TROCAR_DEPTH: int
KEEP_OUT: int
TASK_NUMBERS: int
LIMIT_NUMBERS: int

def solve(
    A: Array,
    b: Array,
    ends: Ints,
    C: Array,
    d: Array,
    guarded: int,
    max_rounds: int,
    guess: Array,
    numbers: Array,
    backend: Backend | None,
    /,
) -> tuple[float, ...]: ...
def step(
    tasks: Array,
    vectors: Array,
    ends: Ints,
    limits: Array,
    joints: Array,
    guarded: int,
    max_rounds: int,
    x: Array,
    J_local: Array,
    angles: Array,
    v: Array,
    x_d: Array,
    x_d_dot: Array,
    pivot: Array,
    pivot_dot: Array,
    guess: Array,
    numbers: Array,
    backend: Backend | None,
    /,
) -> tuple[float, ...]: ...
def usable(
    q: Array,
    v: Array,
    x_d: Array,
    x_d_dot: Array,
    pivot: Array,
    pivot_dot: Array,
    tolerance: float,
    /,
) -> bool: ...
