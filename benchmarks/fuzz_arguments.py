"""Arguments of the kernel's bindings: right ones, and what stands in their place in fuzz.py."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from rcmqp import ArmState, Reference, _kernel

Arguments: TypeAlias = list[Any]

MOST_JOINTS = 12

PLAIN: tuple[Any, ...] = (None, "x", b"", (), [], {}, 1j, -1)


class Pair:
    """A record, as dataclass makes it."""

    __slots__ = ("a", "b")
    __match_args__ = ("a", "b")

    a: object
    b: object


class Hostile:
    """An object that Python code turns into a number or an array, and does harm meanwhile."""

    def __init__(self, rng: np.random.Generator, victims: Arguments) -> None:
        self.victims, self.does = victims, int(rng.integers(4))

    def strike(self) -> float:
        """Do it, and give a number."""
        if self.does == 0:
            raise RuntimeError("no")
        if self.does == 1:
            for victim in self.victims:
                if isinstance(victim, np.ndarray) and victim.flags.owndata:
                    try:
                        victim.resize((0,), refcheck=False)
                    except ValueError:
                        continue
        if self.does == 2:
            law = right_law(np.random.default_rng(5))
            _kernel.law(*law)
            _kernel.solve(*right_solve(np.random.default_rng(5)))
        return 1.0

    def __float__(self) -> float:
        return self.strike()

    def __index__(self) -> int:
        return int(self.strike())

    def __bool__(self) -> bool:
        return bool(self.strike())

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        return np.full(8, self.strike())


class Number(float):
    """A float of a class of its own."""

    def __float__(self) -> float:
        raise RuntimeError("no")


def hostile(rng: np.random.Generator, given: Any, others: Arguments) -> Any:
    """Something in place of what was given."""
    size = int(rng.integers(0, 40))
    kinds: list[Callable[[], Any]] = [
        *(functools.partial(copy.copy, value) for value in PLAIN),
        *(functools.partial(float, value) for value in ("nan", "inf", "-inf", "1e308", "-0.0")),
        lambda: 2 ** int(rng.integers(1, 90)),
        lambda: bool(rng.integers(2)),
        lambda: Hostile(rng, others),
        lambda: Number(1.0),
        lambda: np.float32(1.0),
        lambda: np.complex64(1.0),
        lambda: np.complex128(1.0 + 1.0j),
        lambda: np.int64(rng.integers(-3, 40)),
        lambda: rng.normal(size=size),
        lambda: rng.normal(size=(6, size)),
        lambda: rng.normal(size=(size, size)),
        lambda: np.zeros((0, size)),
        lambda: np.full(size, np.nan),
        lambda: np.array(rng.normal()),
        lambda: np.array([None, 3.0, "x"], dtype=object),
        lambda: rng.integers(-5, 40, size=size),
        lambda: others[int(rng.integers(len(others)))] if others else None,
    ]
    if isinstance(given, np.ndarray) and given.size and given.dtype.kind in "fi":
        kinds = [*kinds, *spoilt(rng, given)] if rng.integers(3) else spoilt(rng, given)[:3]
    if isinstance(given, tuple | list) and given:
        part = int(rng.integers(len(given)))

        def inside() -> Any:
            worse = [*given]
            worse[part] = hostile(rng, given[part], others)
            return type(given)(worse)

        kinds += 4 * [inside] + [lambda: type(given)(given[:-1])]
    return kinds[int(rng.integers(len(kinds)))]()


def spoilt(rng: np.random.Generator, given: np.ndarray) -> list[Callable[[], Any]]:
    """The same array in other forms, or with numbers that are not usual."""

    def with_numbers(*numbers: float) -> np.ndarray:
        worse = given.copy()
        at = rng.integers(worse.size, size=1 + worse.size // 3)
        worse.flat[at] = rng.choice(numbers) if worse.dtype.kind == "f" else int(numbers[-1])
        return worse

    misaligned = np.frombuffer(b"\0" + given.tobytes(), np.uint8)[1:].view(given.dtype)
    return [
        lambda: with_numbers(np.nan, np.inf, -np.inf, -7),
        lambda: with_numbers(1e300, -1e300, 1e-300, 2**40),
        lambda: with_numbers(0.0, 0),
        lambda: given.astype(np.float32),
        lambda: given.astype(given.dtype.newbyteorder()),
        lambda: np.asfortranarray(given),
        lambda: np.repeat(given, 2, axis=-1)[..., ::2],
        lambda: np.append(given.ravel(), 1),
        lambda: given.ravel()[:-1],
        lambda: given.reshape(1, *given.shape),
        lambda: misaligned.reshape(given.shape),
    ]


def copies(options: dict[str, Any]) -> dict[str, Any]:
    """Options whose arrays are not those of others."""
    arrays = {key: value.copy() for key, value in options.items() if isinstance(value, np.ndarray)}
    return options | arrays


def pose(rng: np.random.Generator) -> np.ndarray:
    """A unit dual quaternion."""
    r, t = rng.normal(size=(2, 4))
    r /= np.linalg.norm(r)
    return np.concatenate([r, t - (t @ r) * r])


def joints(rng: np.random.Generator) -> int:
    """How many there are."""
    return int(rng.integers(6, MOST_JOINTS))


def cycle(rng: np.random.Generator, n: int) -> Arguments:
    """What a step is given of a state and a reference."""
    tool: tuple[Any, ...] = (0.1,)
    if rng.integers(2):
        tool = (0.1, pose(rng), rng.normal(size=(6, n)))
    vectors = [rng.normal(size=n) for _ in range(3)]
    x, x_d, J = pose(rng), pose(rng), rng.normal(size=(6, n))
    return [x, J, *vectors, x_d, rng.normal(size=8), *rng.normal(size=(2, 3)), tool]


def right_block(rng: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """A kind of block and its options."""
    n = joints(rng)
    damper = {"gain": 60.0, "deceleration": 0.2, "jerk": 5.0, "period": 1e-3}
    wrist = {"wrist": rng.normal(size=24), "bends": float(rng.integers(4)), "last": -0.01}
    ball = {"centre": np.zeros(3), "velocity": np.zeros(3), "on_trocar": 1.0, "reach": 0.02}
    sphere = damper | ball | wrist | {"first": -0.3}
    lines = "lowest highest velocity acceleration jerk braking easing".split()
    kinds: dict[str, dict[str, Any]] = {
        "rcm": {"period": 1e-3},
        "tip": {},
        "depth": {},
        "roll": {},
        "direction": {},
        "pose": {},
        "at_trocar": {},
        "entry": {"reach": 1e-3},
        "rotation": {},
        "still": {},
        "orientation": {"orientation": np.eye(4)[0]},
        "posture": {"posture": rng.normal(size=n), "continuous": np.zeros(n)},
        "objective": {"K_c": 1.0, "c_d": 0.1, "objective": _kernel.Block("manipulability")},
        "joints": {"period": 1e-3} | {name: 1.0 + rng.uniform(size=n) for name in lines},
        "trocar_speed": {
            **{"gain": 20.0, "share": 0.5, "period": 1e-3},
            "acceleration": 1.0 + rng.uniform(size=n),
        },
        "trocar_cone": damper | {"half_angle": 1.0, "axis": np.eye(3)[2], "lever": 0.1},
        "trocar_depth": damper | wrist | {"shallowest": 0.0, "deepest": 0.2},
        "keep_out": sphere,
        "keep_in": sphere,
        "entry_sphere": sphere,
        "singularity_product": {"offsets": np.zeros(7)},
        "manipulability": {},
        "least_singular_value": {},
        "joint_centring": {"middle": np.zeros(n), "half_range": np.ones(n)},
    }
    name = sorted(kinds)[int(rng.integers(len(kinds)))]
    return name, kinds[name]


def right_stack(rng: np.random.Generator) -> tuple[int, dict[str, Any]]:
    """Joints of a stack, and what it is made of; a task and a limit are given cycle by cycle."""
    n, block = joints(rng), _kernel.Block
    tip, rcm = block("tip"), block("rcm", period=1e-3)
    posture = block("posture", posture=np.zeros(n), continuous=np.zeros(n))
    cone = block(
        "trocar_cone",
        **{"gain": 60.0, "deceleration": 0.2, "jerk": 5.0, "period": 1e-3},
        **{"half_angle": 1.0, "axis": np.eye(3)[2], "lever": 0.1},
    )
    levels = ((0.0, ((rcm, 60.0, 1.0),)), (0.01, ((tip, 60.0, 1.0), (None, 1.0, 0.5))))
    return n, {
        "levels": (*levels, (0.03, ((posture, 1.0, 1.0),))),
        "limits": (cone, None),
        "acceleration": rng.uniform(1.0, 9.0, n),
        "jerk": np.full(n, 500.0),
        "share": 0.5,
        "period": 1e-3,
        "guarded": 1,
        "max_rounds": 100,
        "names": tuple("abcdefg"),
    }


def given_rows(rng: np.random.Generator, n: int) -> Arguments:
    """Rows of a task and of a limit."""
    m = int(rng.integers(0, 5))
    task = rng.normal(size=m), rng.normal(size=(m, n)), rng.normal(size=m)
    return [task, (-np.ones(n), np.ones(n), rng.normal(size=(m, n)), rng.uniform(size=m))]


def right_solve(rng: np.random.Generator) -> Arguments:
    """Two levels and the rest, in a box and under hard rows."""
    n, m, rows = joints(rng), int(rng.integers(0, 6)), [2, 5]
    rows.append(rows[-1] + n)
    A = np.vstack([rng.normal(size=(5, n)), np.eye(n)])
    return [
        *(A, rng.normal(size=rows[-1]), np.array(rows), np.array([0.0, 0.01, 0.03])),
        *(-np.ones(n), np.ones(n), rng.normal(size=(m, n)), rng.uniform(size=m)),
        *(1, 0, 100, None, np.zeros((4, _kernel.SETS, n + m)), None),
    ]


def right_law(rng: np.random.Generator) -> Arguments:
    """A cycle of the paper's law."""
    n = joints(rng)
    aim = _kernel.Block("manipulability") if rng.integers(2) else (0.5, rng.normal(size=n))
    x, x_d, numbers = pose(rng), pose(rng), np.array([1.0, 0.1, 0.1, 1e-9, 0.01, 0.01, 1e-9])
    J, angles = rng.normal(size=(6, n)), rng.normal(size=n)
    return [x, J, angles, x_d, rng.normal(size=8), aim, numbers, np.ones(n), True, 1]


def right(name: str, rng: np.random.Generator) -> Arguments:
    """Arguments that a function of the module takes."""
    n, m = joints(rng), int(rng.integers(1, 20))
    vectors = rng.normal(size=(3, n))
    if name in ("law", "solve"):
        return right_law(rng) if name == "law" else right_solve(rng)
    table: dict[str, Callable[[], Arguments]] = {
        "usable": lambda: [
            *(rng.normal(size=(6, n)), rng.normal(size=8), vectors[0]),
            *(*vectors, *cycle(rng, n)[5:9], 1e-6),
        ],
        "frozen": lambda: [rng.normal(size=(6, n)), 6, -1],
        "record": lambda: [Pair, 1, "x"],
        "state": lambda: [
            *(ArmState, vectors[0], vectors[0], "oMe", rng.normal(size=7)),
            *(rng.normal(size=(6, n)), vectors[1], None, vectors[2], (0.1,)),
        ],
        "moved": lambda: [*vectors[:2], 1e-3, n],
        "all_finite": lambda: [vectors, 1e6],
        "paced": lambda: [60.0, 0.2, 0.01],
        "least_singular_values": lambda: [rng.normal(size=(m, 6, n))],
        "in_order": lambda: [
            tuple((rng.normal(size=(k, n)), rng.normal(size=k)) for k in (2, 3)),
            *(np.ones(4), vectors[0]),
        ],
        "manipulability": lambda: [*cycle(rng, n)[:-1], (0.1,)],
        "from_xyzquat": lambda: [rng.normal(size=7)],
        "carried": lambda: [pose(rng), rng.normal(size=3)],
        "view_pose": lambda: [
            *(Reference, pose(rng), *rng.normal(size=8).tolist(), rng.normal(size=3)),
        ],
        "approach": lambda: [
            *(pose(rng), rng.normal(size=3), pose(rng), pose(rng), 5, 20, 1e-3),
            *(pose(rng), rng.normal(size=3), rng.normal(size=3), 0.01, 0.001),
        ],
        "store": lambda: [np.zeros((m, 3 * n)), m - 1, *vectors],
        "views": lambda: [
            int(rng.integers(3)), rng.uniform(0.01, 0.02, 4), 8.0, 1.0, rng.uniform(size=m), 0.1,
        ],
        "view_poses": lambda: [
            pose(rng), rng.normal(size=(m, 8)), *rng.normal(size=(2, m, 3)),
        ],
        "observed": lambda: [
            np.array([pose(rng) for _ in range(m)]), np.array([pose(rng) for _ in range(m)]),
            *(rng.normal(size=(m, 3)), np.eye(3)[2], 0.1),
        ],
        "contour": lambda: [
            *(rng.normal(size=(m, 3)), rng.normal(size=(m + 3, 3)), np.arange(m + 3.0), 2, 1),
        ],
    }  # fmt: skip
    return table[name]()
