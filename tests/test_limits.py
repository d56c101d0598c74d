from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, cast

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, derivative, random_placement

from rcmqp import load_arm
from rcmqp.errors import RcmqpError
from rcmqp.limits import (
    LIMITS,
    Constraint,
    Damper,
    EntrySphere,
    KeepIn,
    KeepOut,
    Limit,
    SphereLimit,
    TrocarCone,
    TrocarDepth,
    combine,
    make_limit,
)
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp.problem import InvalidProblem
from rcmqp.references.view import STILL, Reference
from rcmqp.world.arm import Arm, ArmState
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Instrument, Trocar

ARMS = ("lwa3", "kinova", "panda", "ur5", "z1")
T = 1e-3
SCOPE = Instrument(length=0.33, radius=0.005)


def reference(pivot: Array, pivot_dot: Array = STILL) -> Reference:
    return Reference(dq.IDENTITY, np.zeros(8), pivot, pivot_dot)


@functools.cache
def insertion(arm: str) -> Insertion:
    loaded = load_arm(arm)
    return Insertion.on_shaft(loaded, SCOPE, loaded.random_angles(np.random.default_rng(11)))


def gantry() -> Insertion:
    """Three prismatic joints along the world's axes: every point moves straight."""
    model, place = pin.Model(), pin.SE3.Identity()
    parent = 0
    for joint in (pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ()):
        parent = model.addJoint(parent, joint, place, f"slide_{parent}")
    model.addFrame(pin.Frame("flange", parent, 0, place, pin.FrameType.OP_FRAME))
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -1.0, 1.0
    model.velocityLimit[:] = 1.0
    return Insertion.on_shaft(Arm(model, "flange", name="gantry"), SCOPE)


# Dampers: what each keeps positive, measured in the world ----------------------------------

Room = Callable[[pin.SE3, Array, float], list[float]]
"""The quantities s >= 0 of a damper: of the effector's placement, the trocar, and time."""


def point(oMe: pin.SE3, s: float) -> Array:
    return np.asarray(oMe.act(np.array([0.0, 0.0, s])))


def segment_distance(oMe: pin.SE3, ends: tuple[float, float], centre: Array) -> float:
    mount, tip = point(oMe, ends[0]), point(oMe, ends[1])
    share = (centre - mount) @ (tip - mount) / ((tip - mount) @ (tip - mount))
    return float(np.linalg.norm(centre - mount - np.clip(share, 0.0, 1.0) * (tip - mount)))


def cone_room(trocar: Trocar) -> Room:
    def room(oMe: pin.SE3, pivot: Array, t: float) -> list[float]:
        chord = float(np.linalg.norm(oMe.rotation[:, 2] - np.array(trocar.axis)))
        return [trocar.cone_half_angle - 2.0 * math.asin(chord / 2.0)]

    return room


def depth_room(trocar: Trocar, tip_depth: float) -> Room:
    def room(oMe: pin.SE3, pivot: Array, t: float) -> list[float]:
        depth = float((point(oMe, tip_depth) - pivot) @ oMe.rotation[:, 2])
        return [trocar.depth_range[1] - depth, depth - trocar.depth_range[0]]

    return room


def sphere_room(limit: SphereLimit) -> Room:
    tip, mount = limit.tip_depth, limit.tip_depth - limit.instrument.length
    part = getattr(limit, "part", "shaft")

    def room(oMe: pin.SE3, pivot: Array, t: float) -> list[float]:
        centre = np.array(limit.centre) + t * np.array(limit.velocity)
        if limit.on_trocar:
            centre = centre + pivot
        to_tip, to_mount = (
            float(np.linalg.norm(point(oMe, end) - centre)) for end in (tip, mount)
        )
        nearest = to_tip if part == "tip" else segment_distance(oMe, (mount, tip), centre)
        if isinstance(limit, KeepOut):
            return [nearest - limit.radius - limit.instrument.radius]
        inner = limit.radius - limit.instrument.radius
        if isinstance(limit, KeepIn) and part == "shaft":
            return [inner - to_tip, inner - to_mount]
        return [inner - nearest]

    return room


def spheres(insertion: Insertion, b: Array, oMe: pin.SE3, pivot: Array) -> list[SphereLimit]:
    """Every sphere limit, centred at b in the effector's axes; moving, and riding the trocar."""
    common: dict[str, Any] = {"radius": 0.06, "gain": 40.0}
    still = common | {"centre": tuple(oMe.act(b)), "velocity": (0.3, -0.2, 0.5)}
    riding = common | {"centre": tuple(oMe.act(b) - pivot), "on_trocar": True}
    made = [
        make_limit(name, insertion, T, **options, **part)
        for options in (still, riding)
        for name, part in (
            ("keep_out", {"part": "tip"}),
            ("keep_out", {"part": "shaft"}),
            ("keep_in", {"part": "tip"}),
            ("keep_in", {"part": "shaft"}),
            ("entry_sphere", {}),
        )
    ]
    return [limit for limit in made if isinstance(limit, SphereLimit)]


def dampers(insertion: Insertion, oMe: pin.SE3, pivot: Array) -> list[tuple[Damper, Room]]:
    rng = np.random.default_rng(5)
    depth, found = insertion.tip_depth, list[tuple[Damper, Room]]()
    for angle in (0.02, 0.3, 1.2, 2.5):  # from the cone's axis, on which the first two lie inside
        aside = pin.exp3(angle * np.array([0.6, -0.8, 0.0]))
        axis = oMe.rotation @ aside @ np.array([0.0, 0.0, 1.0])
        trocar = replace(insertion.trocar, axis=tuple(axis), depth_range=(0.02, 0.13))
        found.append((TrocarCone(trocar, gain=40.0), cone_room(trocar)))
    found.append((TrocarDepth(trocar, depth, gain=40.0), depth_room(trocar, depth)))
    for z in (depth + 0.05, depth - 0.1, depth - SCOPE.length - 0.05):  # beyond the ends, beside
        for aside in (0.05, 0.1):  # sphere inside, outside
            b = np.array([*rng.normal(size=2), 0.0])
            b = aside * b / np.linalg.norm(b) + np.array([0.0, 0.0, z])
            found += [(x, sphere_room(x)) for x in spheres(insertion, b, oMe, pivot)]
    return found


@pytest.mark.parametrize("arm", ARMS)
def test_a_dampers_row_is_the_derivative_of_what_it_keeps(arm: str) -> None:
    kinds = set()
    for seed in (7, 8):
        kinds |= check_rows(insertion(arm), np.random.default_rng(seed))
    assert {cls for cls in LIMITS.values() if issubclass(cls, Damper)} == kinds


def check_rows(inserted: Insertion, rng: np.random.Generator) -> set[type[Damper]]:
    model = inserted.arm.model
    q = inserted.arm.configuration(inserted.arm.random_angles(rng))
    state = inserted.state(q)
    pivot, pivot_dot = state.oMe.act(np.array([0.002, -0.003, 0.01])), rng.normal(size=3)

    def along(t: float, v: Array, room: Room) -> list[float]:
        return room(inserted.state(pin.integrate(model, q, t * v)).oMe, pivot, 0.0)

    def in_time(t: float, room: Room) -> list[float]:
        return room(state.oMe, pivot + t * pivot_dot, t)

    kinds = set()
    for damper, room in dampers(inserted, state.oMe, pivot):
        found = damper.evaluate(state, reference(pivot, pivot_dot))
        slopes = [
            derivative(functools.partial(along, v=v, room=room), 1e-4) for v in np.eye(model.nv)
        ]
        assert_allclose(found.C, -np.column_stack(slopes), rtol=0, atol=1e-9)
        drift = found.d - damper.gain * np.array(room(state.oMe, pivot, 0.0))
        expected = derivative(functools.partial(in_time, room=room), 1e-4)
        assert_allclose(drift, expected, rtol=0, atol=1e-9)
        assert np.isinf(found.lower).all()
        assert np.isinf(found.upper).all()
        kinds.add(type(damper))
    return kinds


@pytest.mark.parametrize("name", sorted(set(LIMITS) - {"joints"}))
def test_every_damper_keeps_its_braking_distance(name: str) -> None:
    inserted = insertion("lwa3")
    state, now = inserted.state(inserted.q_start), reference(np.array(inserted.trocar.pivot))
    limits = [
        make_limit(name, inserted, T, gain=50.0, deceleration=A, **NEEDED.get(name, {}))
        for A in (math.inf, 0.1)
    ]
    free, braking = (limit.evaluate(state, now).d for limit in limits)
    assert isinstance(limits[1], Damper)
    assert_allclose(braking, [limits[1].pace(d / 50.0) for d in free], rtol=1e-12)
    assert (np.abs(braking) < np.abs(free)).any()


def test_rows_where_a_direction_is_missing_are_harmless_or_lead_out() -> None:
    inserted = insertion("lwa3")
    state = inserted.state(inserted.q_start)
    z, now = state.oMe.rotation[:, 2], reference(np.array(inserted.trocar.pivot))
    along = TrocarCone(replace(inserted.trocar, axis=tuple(z)), gain=2.0)
    found = along.evaluate(state, now)
    assert_allclose(found.C, 0.0, rtol=0, atol=0)
    assert_allclose(found.d, 2.0 * inserted.trocar.cone_half_angle, rtol=1e-6)
    against = TrocarCone(replace(inserted.trocar, axis=tuple(-z)), gain=2.0).evaluate(state, now)
    assert np.linalg.norm(against.C) > 0.1
    assert against.d[0] < 0.0
    tip = tuple(inserted.tip(inserted.x_rcm))
    out = make_limit("keep_out", inserted, T, centre=tip, radius=0.01).evaluate(state, now)
    assert np.linalg.norm(out.C) > 0.1
    assert out.d[0] == pytest.approx(60.0 * -0.015)
    for name in ("keep_in", "entry_sphere"):
        found = make_limit(name, inserted, T, centre=tip, radius=0.01).evaluate(state, now)
        assert_allclose(found.C, 0.0, rtol=0, atol=0)
        assert found.d[0] == pytest.approx(60.0 * 0.005)


def test_the_pace_is_the_gains_near_the_limit_and_leaves_the_distance_to_brake() -> None:
    period, gain, A = 1e-4, 60.0, 2.0
    damper = TrocarCone(insertion("ur5").trocar, gain=gain, deceleration=A)
    plain = TrocarCone(insertion("ur5").trocar, gain=gain)
    s, speed = 1.5, damper.pace(1.5)
    for _ in range(30000):
        assert damper.pace(-s) == -speed
        assert speed <= gain * s == plain.pace(s)
        s -= period * speed
        slower = damper.pace(s)
        assert 0.0 < s
        assert 0.0 < speed - slower <= A * period * (1.0 + gain * period)
        speed = slower
    assert s < 1e-6
    assert speed == gain * s
    assert damper.pace(1.5) == pytest.approx(math.sqrt(2.0 * A * 1.5), rel=1e-3)


# Dampers in a loop -------------------------------------------------------------------------


def obeyed(constraint: Constraint, wish: Array) -> Array:
    """The wish, taken back along the row that it breaks most."""
    excess = constraint.C @ wish - constraint.d
    worst = int(np.argmax(excess))
    row = constraint.C[worst]
    return wish - max(0.0, excess[worst]) * row / (row @ row) if row.any() else wish


def loop(
    inserted: Insertion,
    damper: Damper,
    room_of: Callable[[Damper], Room],
    wish: Callable[[int, Constraint], Array],
    period: float,
    cycles: int,
    pivot_dot: Array = STILL,
) -> tuple[float, float]:
    """Run Euler steps.

    Returns:
        The least s, and the largest rho, what s lost in a cycle beyond T times its derivative,
        of those cycles that began near the limit, s < 0.002.
    """
    q, pivot, least, rho = inserted.q_start, np.array(inserted.trocar.pivot), np.inf, 0.0
    for k in range(cycles):
        here = damper
        if isinstance(damper, SphereLimit) and not damper.on_trocar:
            moved = np.array(damper.centre) + k * period * np.array(damper.velocity)
            here = replace(damper, centre=tuple(moved))
        state = inserted.state(q)
        found = here.evaluate(state, reference(pivot, pivot_dot))
        v = obeyed(found, wish(k, found))
        s = np.array(room_of(here)(state.oMe, pivot, 0.0))
        q, pivot = inserted.arm.integrate(q, v, period), pivot + period * pivot_dot
        s_next = np.array(room_of(here)(inserted.state(q).oMe, pivot, period))
        s_dot = (found.d - damper.gain * s) - found.C @ v
        rho = max(rho, float(np.max(np.where(s < 2e-3, s + period * s_dot - s_next, 0.0))))
        least = min(least, float(s_next.min()))
    return least, rho


@pytest.mark.parametrize("share", [0.05, 0.5, 1.0])  # gain T
def test_a_damper_on_straight_motion_keeps_its_limit(share: float) -> None:
    inserted = gantry()
    start = inserted.tip(inserted.x_rcm)
    options: dict[str, Any] = {"gain": share / T, "radius": 0.05}
    push = np.array([0.8, 0.1, 0.3])
    cases: list[tuple[Damper, Room | None, Array, Array]] = [
        (
            TrocarDepth(replace(inserted.trocar, depth_range=(0.05, 0.12)), 0.1, gain=share / T),
            depth_room(replace(inserted.trocar, depth_range=(0.05, 0.12)), 0.1),
            sign * push,
            np.array([0.1, 0.2, 0.05]),
        )
        for sign in (-1.0, 1.0)
    ]
    for part, ahead in (("tip", push / 5.0), ("shaft", np.array([0.1, 0.0, -0.1]))):
        coming = options | {"centre": tuple(start + ahead), "velocity": (-0.4, 0.1, 0.0)}
        limit = make_limit("keep_out", inserted, T, part=part, **coming)
        assert isinstance(limit, KeepOut)
        cases.append((limit, None, push, STILL))
    for name in ("keep_in", "entry_sphere"):
        limit = make_limit(name, inserted, T, centre=tuple(start), **options)
        assert isinstance(limit, SphereLimit)
        straight = np.array([0.0, 0.7, 0.0])  # along a radius, the tip and the shaft alike
        cases.append((limit, None, straight, STILL))
    for damper, room, wish, pivot_dot in cases:

        def room_of(d: Damper, room: Room | None = room) -> Room:
            return room or sphere_room(d)  # type: ignore[arg-type]

        def wished(k: int, found: Constraint, wish: Array = wish) -> Array:
            return wish

        least, _ = loop(inserted, damper, room_of, wished, T, 400, pivot_dot)
        assert least >= -1e-9, damper
        assert least < 1e-3, damper  # it came to the limit


@pytest.mark.parametrize("arm", ["lwa3", "kinova", "panda"])
def test_a_damper_on_an_arm_keeps_its_limit_to_second_order(arm: str) -> None:
    """Joints at 1 rad/s: rho is at most 2 T^2, and the limit is kept to rho / (gain T)."""
    inserted = insertion(arm)
    oMe = inserted.state(inserted.q_start).oMe
    tilted = tuple(oMe.rotation @ np.array([math.sin(0.05), 0.0, math.cos(0.05)]))
    trocar = Trocar(inserted.trocar.pivot, tilted, 0.1, (0.09, 0.12))
    beside = oMe.act(np.array([0.05, 0.03, 0.0]))
    tip = oMe.act(np.array([0.0, 0.0, inserted.tip_depth]))
    pivot = np.array(trocar.pivot)
    ball: dict[str, Any] = {"radius": 0.02, "gain": 200.0}

    def sphere(name: str, **options: Any) -> SphereLimit:
        limit = make_limit(name, inserted, T, **(ball | options))
        assert isinstance(limit, SphereLimit)
        return limit

    cases: list[tuple[Damper, Callable[[Any], Room]]] = [
        (TrocarCone(trocar, gain=200.0), lambda d: cone_room(trocar)),
        (TrocarDepth(trocar, 0.1, gain=200.0), lambda d: depth_room(trocar, 0.1)),
        (sphere("keep_out", centre=tuple(beside), velocity=(0.0, 0.05, 0.02)), sphere_room),
        (sphere("keep_out", centre=tuple(beside - pivot), on_trocar=True), sphere_room),
        (sphere("keep_in", centre=tuple(tip + 0.004)), sphere_room),
        (
            sphere("entry_sphere", centre=tuple(0.1 * (beside - pivot)), on_trocar=True),
            sphere_room,
        ),
    ]
    for damper, room_of in cases:
        for period in (2 * T, T):
            rng = np.random.default_rng(7)
            direction = rng.normal(size=inserted.arm.nv)

            def wish(
                k: int, found: Constraint, direction: Array = direction, period: float = period
            ) -> Array:
                into = found.C[int(k * period / 0.2) % len(found.C)]
                wanted = direction / 3.0 + 5.0 * into / (np.linalg.norm(into) + 1e-3)
                return np.asarray(wanted / np.linalg.norm(wanted))

            cycles = round(0.4 / period)
            breath = np.array([0.02, 0.03, -0.01])
            least, rho = loop(inserted, damper, room_of, wish, period, cycles, breath)
            assert least >= -rho / (damper.gain * period) - 1e-9, damper
            assert least < 1e-3, damper
            assert rho <= 3.0 * period**2, damper


@pytest.mark.parametrize("name", ["trocar_cone", "trocar_depth", "keep_out", "keep_in"])
def test_beyond_its_limit_a_damper_asks_to_come_back_at_its_gain(name: str) -> None:
    inserted = insertion("lwa3")
    oMe = inserted.state(inserted.q_start).oMe
    aside = tuple(oMe.rotation @ np.array([math.sin(0.5), 0.0, math.cos(0.5)]))
    trocar = Trocar(inserted.trocar.pivot, aside, 0.3, (0.12, 0.2))
    options: dict[str, dict[str, Any]] = {
        "trocar_cone": {"trocar": trocar},
        "trocar_depth": {"trocar": trocar},
        "keep_out": {"centre": tuple(oMe.act(np.array([0.01, 0.0, 0.0]))), "radius": 0.03},
        "keep_in": {"centre": tuple(oMe.translation), "radius": 0.03},
    }
    rooms: dict[str, Callable[[Any], Room]] = {
        "trocar_cone": lambda d: cone_room(trocar),
        "trocar_depth": lambda d: depth_room(trocar, inserted.tip_depth),
    }
    damper = make_limit(name, inserted, T, gain=10.0, **options[name])
    assert isinstance(damper, Damper)
    room_of: Callable[[Any], Room] = rooms.get(name, sphere_room)
    room = room_of(damper)
    q, pivot = inserted.q_start, np.array(inserted.trocar.pivot)
    before = min(room(oMe, pivot, 0.0))
    assert before < -0.01
    for _ in range(200):  # 0.2 s: a factor of e^-2
        found = damper.evaluate(inserted.state(q), reference(pivot))
        q = inserted.arm.integrate(q, obeyed(found, np.zeros(7)), T)
    after = min(room(inserted.state(q).oMe, pivot, 0.0))
    assert after == pytest.approx(before * (1.0 - 10.0 * T) ** 200, rel=0.05)


# All limits --------------------------------------------------------------------------------

NEEDED: dict[str, dict[str, Any]] = {
    "keep_out": {"centre": (0.4, 0.1, 0.3), "radius": 0.02, "part": "tip"},
    "keep_in": {"centre": (0.4, 0.1, 0.3), "radius": 0.2, "part": "shaft"},
    "entry_sphere": {"centre": (0.0, 0.0, 0.0), "radius": 0.01, "on_trocar": True},
}


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("name", sorted(LIMITS))
def test_every_limit_is_sound_read_only_repeatable_and_remembers_nothing(
    name: str, arm: str
) -> None:
    inserted, rng = insertion(arm), np.random.default_rng(7)
    limit = make_limit(name, inserted, T, **NEEDED.get(name, {}))
    nv, starts = inserted.arm.nv, [inserted.angles_start, inserted.arm.random_angles(rng)]
    for angles in starts:
        state = inserted.state(inserted.arm.configuration(angles), rng.normal(size=nv))
        now = reference(np.array(inserted.trocar.pivot), rng.normal(size=3))
        found = limit.evaluate(state, now)
        kept = [array.copy() for array in arrays(found)]
        limit.evaluate(replace(state, v=state.v + 1.0), reference(now.pivot + 1.0))
        again = limit.evaluate(state, now)
        assert (found.lower <= found.upper).all()
        assert np.isfinite(found.C).all()
        assert np.isfinite(found.d).all()
        assert len(set(found.names)) == len(found.d) == len(found.C)
        for array, copy, rerun in zip(arrays(found), kept, arrays(again), strict=True):
            assert np.array_equal(array, copy)
            assert np.array_equal(array, rerun)
            assert not array.flags.writeable
            for shared in (*arrays(again), state.v, state.J_local, inserted.arm.velocity):
                assert not np.shares_memory(array, shared)


def arrays(found: Constraint) -> tuple[Array, Array, Array, Array]:
    return found.lower, found.upper, found.C, found.d


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_a_limit_at_rest_inside_allows_rest(name: str) -> None:
    """A standing arm inside every limit, over a still patient, may go on standing."""
    inserted = insertion("panda")
    tip = inserted.tip(inserted.x_rcm)
    inside: dict[str, Any] = {
        "keep_out": {"centre": tuple(tip + 0.2), "radius": 0.02},
        "keep_in": {"centre": tuple(tip), "radius": 0.2},
        "entry_sphere": {"centre": inserted.trocar.pivot, "radius": 0.01},
    }
    limit = make_limit(name, inserted, T, **inside.get(name, {}))
    state = inserted.state(inserted.q_start)
    found = limit.evaluate(state, reference(np.array(inserted.trocar.pivot)))
    assert (found.lower <= 0.0).all()
    assert (found.upper >= 0.0).all()
    assert (found.d >= 0.0).all()


@dataclass(frozen=True, eq=False)
class Box(Limit):
    """A user's limit: the same box for every joint."""

    name: ClassVar[str] = "box"

    low: float
    high: float

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        n = state.angles.size
        return Constraint.box(np.full(n, self.low), np.full(n, self.high))


def test_limits_combine_to_one_box_and_all_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LIMITS, Box.name, Box)
    inserted = insertion("ur5")
    state, now = inserted.state(inserted.q_start), reference(np.ones(3))
    depth, cone = (make_limit(name, inserted, T) for name in ("trocar_depth", "trocar_cone"))
    wide, left, right = Box(-1.0, 1.0), Box(-2.0, 0.3), Box(0.1, 5.0)
    user = make_limit("box", inserted, T, low=0.5, high=0.7)
    assert_allclose(user.evaluate(state, now).upper, 0.7)

    bounds = combine([wide, depth, left, cone, right], state, now, inserted.arm.joints)
    assert_allclose(bounds.lower, 0.1, rtol=0, atol=0)
    assert_allclose(bounds.upper, 0.3, rtol=0, atol=0)
    parts = [limit.evaluate(state, now) for limit in (depth, cone)]
    assert_allclose(bounds.C, np.vstack([part.C for part in parts]), rtol=0, atol=0)
    assert_allclose(bounds.d, np.concatenate([part.d for part in parts]), rtol=0, atol=0)
    assert bounds.names[5:] == (
        "wrist_3_joint",
        "trocar depth, deepest",
        "trocar depth, shallowest",
        "trocar cone",
    )
    for first, then, held in ((left, user, 0.3), (user, left, 0.5)):  # the first listed wins
        bounds = combine([first, then], state, now)
        assert_allclose(bounds.lower, held, rtol=0, atol=0)
        assert_allclose(bounds.upper, held, rtol=0, atol=0)
    free = combine([], state, now)
    assert np.isposinf(free.upper - free.lower).all()
    assert free.C.shape == (0, 6)
    assert free.names[0] == "v[0]"


# What is refused ---------------------------------------------------------------------------

BALL: dict[str, Any] = {"centre": (0.0, 0.0, 0.0), "radius": 0.1}


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("trocar_con", {}, r"unknown limit 'trocar_con'; did you mean trocar_cone"),
        ("trocar_cone", {"gian": 1.0}, r"unknown option of trocar_cone 'gian'; did you mean gain"),
        ("trocar_cone", {"gain": 0.0}, r"gain = 0.0 1/s; it must be positive"),
        ("trocar_cone", {"deceleration": 0.0}, r"deceleration = 0.0; it must be positive, inf"),
        ("trocar_depth", {"gain": 1001.0}, r"= 1; a damper keeps its limit up to 1: lower the"),
        ("trocar_depth", {"tip_depth": np.nan}, r"tip_depth = nan m; it must be a finite number"),
        ("keep_out", {"radius": 0.1}, r"KeepOut needs centre; give a value"),
        ("keep_in", {}, r"KeepIn needs centre and radius; give a value for each"),
        ("keep_out", BALL | {"radius": 0.0}, r"radius = 0.0 m; it must be positive"),
        ("keep_out", BALL | {"centre": (0.0, 1.0)}, r"centre = \(0.0, 1.0\), it must be three"),
        ("keep_out", BALL | {"velocity": (0.0, 1.0, np.nan)}, r"velocity = .* three finite"),
        ("keep_out", BALL | {"part": "shft"}, r"unknown part .* 'shft'; did you mean shaft"),
        ("keep_in", BALL | {"part": "x"}, r"unknown part .*known: shaft, tip"),
        ("keep_in", BALL | {"radius": 0.005}, r"radius = 0.005 m leaves no room for a shaft of"),
        ("entry_sphere", BALL | {"radius": 0.004}, r"radius = 0.004 m leaves no room for a shaft"),
    ],
)
def test_a_bad_name_or_option_is_refused(name: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(RcmqpError, match=message):
        make_limit(name, insertion("ur5"), T, **options)


def test_a_constraint_of_parts_that_do_not_fit_is_refused() -> None:
    with pytest.raises(InvalidProblem, match=r"\(2, 6\), \(1,\)\); they must be .* \(m, nv\) and"):
        Constraint(np.zeros(6), np.ones(6), np.zeros((2, 6)), np.zeros(1), ("one",))
    for names in ((), ("one", "two")):
        with pytest.raises(InvalidProblem, match=f"1 rows, and there are {len(names)} names"):
            Constraint.rows(np.zeros((1, 6)), np.zeros(1), names)


@pytest.mark.parametrize("low", [2.0, np.nan])
def test_an_empty_box_is_refused(low: float) -> None:
    with pytest.raises(InvalidProblem, match=rf"lower = \[.*{low:g}.*leave an empty box"):
        Constraint.box([-1.0, low], [1.0, 1.0])


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, r"^Given\.evaluate\(\) returned None, it must be a Constraint$"),
        (Constraint.box(-np.ones(5), np.ones(5)), r"^Given is for 5 joints, the arm has 6$"),
        (Constraint.rows(np.ones((1, 7)), [1.0], ["x"]), r"^Given is for 7 joints"),
        (InvalidProblem("wrong"), r"^Given: wrong$"),
    ],
    ids=["nothing", "box", "row", "error"],
)
def test_what_is_no_constraint_is_refused_by_the_limits_name(answer: Any, message: str) -> None:
    class Given(Limit):
        def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
            if isinstance(answer, Exception):
                raise answer
            return cast(Constraint, answer)

    inserted = insertion("ur5")
    with pytest.raises(InvalidProblem, match=message):
        combine([Given()], inserted.state(inserted.q_start), reference(np.ones(3)))


def test_a_constraint_copies_what_it_is_given() -> None:
    given = -np.ones(6), np.ones(6), np.zeros((1, 6)), np.zeros(1)
    for mine, kept in zip(given, arrays(Constraint(*given, names=("row",))), strict=True):
        assert mine.flags.writeable
        assert not np.shares_memory(mine, kept)


def test_entry_sphere_bounds_the_rcm_error() -> None:
    """Marinho's tube: a shaft inside it misses the trocar by the sphere's radius at the most."""
    inserted = insertion("panda")
    rng = np.random.default_rng(7)
    state = inserted.state(inserted.q_start)
    pivot = np.array(inserted.trocar.pivot)
    limit = make_limit("entry_sphere", inserted, T, centre=(0, 0, 0), radius=0.01, on_trocar=True)
    assert isinstance(limit, EntrySphere)
    for _ in range(20):
        oMe = state.oMe * random_placement(rng)
        seen = oMe.actInv(pivot)
        moved = replace(state, oMe=oMe, x=dq.from_se3(oMe))
        found = limit.evaluate(moved, reference(pivot))
        if limit.mount_depth < seen[2] < limit.tip_depth:
            miss = math.hypot(seen[0], seen[1])
            assert found.d[0] == pytest.approx(60.0 * (0.005 - miss))
