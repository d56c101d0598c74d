"""Dampers: each keeps its limit, measured in the world."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, derivative
from limit_parts import ARMS, NEEDED, SCOPE, T, insertion, reference

from rcmqp._kernel import Block
from rcmqp.limits import (
    LIMITS,
    Constraint,
    Damper,
    KeepIn,
    KeepOut,
    SphereLimit,
    TrocarCone,
    TrocarDepth,
    make_limit,
)
from rcmqp.limits.instrument import bends
from rcmqp.maths.dualquaternion import Array, from_se3
from rcmqp.references.view import STILL
from rcmqp.world.arm import Arm
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Trocar

DEPTH = 0.1
"""Of the tip at the start, as Insertion.on_shaft() has it [m]."""


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


def depth_room(trocar: Trocar) -> Room:
    def room(oMe: pin.SE3, pivot: Array, t: float) -> list[float]:
        depth = float((point(oMe, DEPTH) - pivot) @ oMe.rotation[:, 2])
        return [trocar.depth_range[1] - depth, depth - trocar.depth_range[0]]

    return room


def sphere_room(limit: SphereLimit) -> Room:
    tip, mount = DEPTH, DEPTH - limit.instrument.length
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
    found = list[tuple[Damper, Room]]()
    for angle in (0.02, 0.3, 1.2, 2.5):  # from the cone's axis, on which the first two lie inside
        aside = pin.exp3(angle * np.array([0.6, -0.8, 0.0]))
        axis = oMe.rotation @ aside @ np.array([0.0, 0.0, 1.0])
        trocar = replace(insertion.trocar, axis=tuple(axis), depth_range=(0.02, 0.13))
        found.append((TrocarCone(trocar, gain=40.0), cone_room(trocar)))
    found.append((TrocarDepth(trocar, gain=40.0), depth_room(trocar)))
    for z in (DEPTH + 0.05, DEPTH - 0.1, DEPTH - SCOPE.length - 0.05):  # beyond the ends, beside
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


@pytest.mark.parametrize(
    "name", sorted(name for name, kind in LIMITS.items() if issubclass(kind, Damper))
)
def test_every_damper_keeps_its_braking_distance(name: str) -> None:
    inserted = insertion("lwa3")
    state, now = inserted.state(inserted.q_start), reference(np.array(inserted.trocar.pivot))
    limits = [
        make_limit(name, inserted, T, gain=50.0, deceleration=A, **NEEDED.get(name, {}))
        for A in (math.inf, 0.1)
    ]
    free, braking = (limit.evaluate(state, now).d for limit in limits)
    assert isinstance(limits[1], Damper)
    sides = braking[len(free) :]  # of the cone, where a stop takes time
    assert_allclose(braking[: len(free)], [limits[1].pace(d / 50.0) for d in free], rtol=1e-12)
    assert_allclose(sides, braking[0], rtol=1e-6)  # the shaft is on the axis
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


def driven(
    wish: float, v: float, cycles: int, *, depth: float = 0.0, most: float = 1.0
) -> tuple[Array, Array]:
    """Rooms and speeds of a slide that wants to go on at ``wish`` and obeys one depth row.

    It begins at ``depth`` [m], and changes its own speed by at most ``most`` [m/s^2], and that by
    at most 20 times as much in a second.
    """
    block = Block(
        "trocar_depth",
        **{"gain": 60.0, "deceleration": 0.2, "jerk": 5.0, "period": T},
        **{"shallowest": -1.0, "deepest": 0.05, **bends(None)},
    )
    J, still, rooms, speeds = np.eye(6)[:, 2:3], np.zeros(3), [], []
    a = 0.0
    for _ in range(cycles):
        x = from_se3(pin.SE3(np.eye(3), np.array([0.0, 0.0, depth])))
        now = np.zeros(1), np.array([v]), np.array([a])
        C, d = block.rows(x, J, *now, x, np.zeros(8), still, still, (0.0,))[2:]
        assert np.array_equal(C[:, 0], [1.0, -1.0])
        own = v + T * np.clip(
            np.clip((wish - v) / T, -most, most), a - 20.0 * most * T, a + 20.0 * most * T
        )
        before, v = v, min(own, d[0])
        a, depth = (v - before) / T, depth + T * v
        rooms.append(0.05 - depth)
        speeds.append(v)
    return np.array(rooms), np.array(speeds)


def test_a_damper_with_jerk_slows_down_as_gently_as_it_says_and_stops_at_the_limit() -> None:
    rooms, speeds = driven(wish=0.08, v=0.08, cycles=2000)
    a = np.diff(speeds, prepend=0.08) / T
    assert rooms.min() > -1e-12
    assert rooms[-1] < 1e-7
    assert speeds[-1] < 1e-6
    assert a.min() >= -0.2 * (1.0 + 60.0 * T)  # as pace() in cycles
    assert np.diff(a).min() >= -5.0 * T * (1.0 + 1e-6)
    braking = 0.08**2 / (2.0 * 0.2) + 0.5 * 0.08 * 0.2 / 5.0
    assert 0.98 * braking < rooms[int(np.flatnonzero(a < 0.0)[0])] < 1.05 * braking


def test_a_damper_with_jerk_brings_back_as_gently_as_it_says() -> None:
    """What obeys the row, and can do anything, comes back from 1 mm beyond the limit."""
    rooms, speeds = driven(wish=1.0, v=0.0, cycles=2000, depth=0.051, most=1e9)
    a = np.diff(speeds, prepend=0.0) / T
    assert rooms[0] < -0.9e-3
    assert np.abs(rooms[-1]) < 1e-6
    assert a.min() >= -0.2 * (1.0 + 60.0 * T)
    assert np.diff(a).min() >= -5.0 * T * (1.0 + 1e-6)


def test_a_damper_with_jerk_that_comes_too_late_is_left_at_its_jerk() -> None:
    rooms, speeds = driven(wish=0.3, v=0.3, cycles=2000)
    a = np.diff(speeds, prepend=0.3) / T
    assert rooms.min() < -0.01  # a stop of 0.2 m/s^2 from 0.3 m/s takes 0.225 m
    assert np.diff(a[: int(np.argmin(rooms))]).min() >= -5.0 * T * (1.0 + 1e-6)
    assert abs(rooms[-1]) < 1e-6
    assert abs(speeds[-1]) < 1e-6


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
            TrocarDepth(replace(inserted.trocar, depth_range=(0.05, 0.12)), gain=share / T),
            depth_room(replace(inserted.trocar, depth_range=(0.05, 0.12))),
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
        (TrocarDepth(trocar, gain=200.0), lambda d: depth_room(trocar)),
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
        "trocar_depth": lambda d: depth_room(trocar),
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
