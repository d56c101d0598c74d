"""Cone, depth and spheres hold at speed: on the way, and where the way of the shaft bends."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, derivative
from limit_parts import insertion

from rcmqp import ArmState, Reference, arm_names, load_scenario, make_controller, simulate
from rcmqp.limits import Damper, EntrySphere, KeepIn, KeepOut, SphereLimit, TrocarCone, TrocarDepth
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths import ViewMoves
from rcmqp.world.insertion import Insertion

T = 1e-3

JUMPS = (
    (0.5, 0.2, 1.0, 0.03),
    (-0.5, -0.3, -1.0, -0.03),
    (0.4, -0.5, 1.0, 0.04),
    (-0.4, 0.5, 0.0, -0.04),
)
"""Views beyond the cone and the depth range, each on the other side of the axis."""


@pytest.mark.parametrize("arm", arm_names())
def test_cone_and_depth_hold_while_views_jump_from_side_to_side(arm: str) -> None:
    path = ViewMoves(views=JUMPS, move=0.4)
    scenario = load_scenario("cone_and_depth", arm, path=path, duration=2.0, period=0.002)
    insertion = scenario.insertion()
    run = simulate(scenario, make_controller("hierarchical_qp", insertion, scenario.period))
    shallowest, deepest = insertion.trocar.depth_range
    assert run.tilt.max() < insertion.trocar.cone_half_angle + 2e-5
    assert run.depth.max() < deepest + 1e-5
    assert run.depth.min() > shallowest - 1e-5
    assert run.rcm_error.max() < 1e-6


@pytest.mark.parametrize("degrees", [60.0, 170.0])
def test_the_sides_do_not_hinder_a_shaft_on_its_way_back(degrees: float) -> None:
    """Beyond 90 degrees from the axis, and for a cone that wide, a side means nothing."""
    inserted = insertion("lwa3")
    away = pin.exp3(np.array([math.radians(120.0), 0.0, 0.0]))
    axis = tuple(inserted.state(inserted.q_start).oMe.rotation @ away[:, 2])
    half = math.radians(degrees)
    cone = TrocarCone(replace(inserted.trocar, axis=axis, cone_half_angle=half), deceleration=1.0)
    state = inserted.state(inserted.q_start, np.ones(inserted.arm.nv))
    rows = cone.evaluate(state, standing(inserted, state))
    assert rows.C[0].any()
    assert not rows.C[1:].any()
    assert (rows.d[1:] > 0.0).all()


def test_the_sides_of_the_cone_are_leans_to_fixed_directions() -> None:
    """Six, 60 degrees apart: C by differences, d by the pace."""
    inserted = insertion("ur5")
    cone = TrocarCone(inserted.trocar, deceleration=0.7, lever=0.1)
    rng, nv = np.random.default_rng(4), inserted.arm.nv
    first = inserted.trocar.axis
    for _ in range(4):
        angles = inserted.arm.angles(inserted.q_start) + 0.2 * rng.normal(size=nv)
        q = inserted.arm.configuration(angles)
        state = inserted.state(q)
        rows = cone.evaluate(state, standing(inserted, state))
        assert cone.row_names == ("trocar cone", *(f"trocar cone, side {k}" for k in range(1, 7)))
        leans = cone.trocar.cone_half_angle - np.array(
            [unpaced(cone, d / 0.1) for d in rows.d[1:]]
        )
        z, axis = state.oMe.rotation[:, 2], np.array(first)
        square = z - (z @ axis) * axis
        assert_allclose(np.sum(np.sin(leans) ** 2), 3.0 * (square @ square), rtol=1e-9)
        assert_allclose(np.sin(leans[:3]), -np.sin(leans[3:]), rtol=0, atol=1e-12)

        def lean(t: float, v: Array, q: Array = q) -> Array:
            moved = inserted.state(inserted.arm.integrate(q, v, t))
            found = cone.evaluate(moved, standing(inserted, moved))
            return np.array([-unpaced(cone, d / 0.1) for d in found.d])

        slopes = [derivative(functools.partial(lean, v=v), 1e-4) for v in np.eye(nv)]
        assert_allclose(rows.C, 0.1 * np.transpose(slopes), rtol=0, atol=1e-7)


def unpaced(cone: TrocarCone, d: float) -> float:
    """The room s of which ``d`` is the pace."""
    A, gain = cone.deceleration, cone.gain
    s = d / gain
    return s if gain**2 * abs(s) <= A else math.copysign((d**2 + (A / gain) ** 2) / (2 * A), d)


def standing(inserted: Insertion, state: ArmState) -> Reference:
    pivot = np.array(inserted.trocar.pivot)
    return Reference(state.x, np.zeros(8), pivot, np.zeros(3))


def dampers(inserted: Insertion, rng: np.random.Generator) -> Iterator[Damper]:
    """With bounds that are far away, so that a row lets s shrink at its pace."""
    rates: dict[str, Any] = {"deceleration": 1e6, "jerk": 1e12, "period": T}
    tip = np.array(inserted.tip(inserted.x_rcm))
    ball: dict[str, Any] = {"centre": tuple(tip + rng.normal(size=3) * 0.05)}
    ball |= {"instrument": inserted.instrument, "velocity": (0.1, -0.2, 0.05)}
    yield TrocarDepth(inserted.trocar, **rates)
    yield TrocarCone(replace(inserted.trocar, cone_half_angle=1.3), **rates)
    yield EntrySphere(radius=2.0, **ball, **rates)
    for part in ("tip", "shaft"):
        yield KeepIn(radius=2.0, part=part, **ball, **rates)
        yield KeepOut(radius=0.001, part=part, **ball, **rates)


@pytest.mark.parametrize("arm", ["lwa3", "ur10"])
def test_rows_with_a_jerk_know_how_the_way_bends(arm: str) -> None:
    """What a row counts on, over T, is how C v - drift changes while the joints go on at v."""
    inserted, rng = insertion(arm), np.random.default_rng(2)
    pivot_dot = np.array([0.05, -0.02, 0.1])
    for _ in range(3):
        angles = inserted.arm.angles(inserted.q_start) + 0.1 * rng.normal(size=inserted.arm.nv)
        q, v = inserted.arm.configuration(angles), rng.normal(size=inserted.arm.nv)
        pivot = np.array(inserted.trocar.pivot) + 0.01 * rng.normal(size=3)
        for damper in dampers(inserted, rng):
            check_bend(inserted, damper, q, v, pivot, pivot_dot)


def check_bend(
    inserted: Insertion, damper: Damper, q: Array, v: Array, pivot: Array, pivot_dot: Array
) -> None:
    plain = replace(damper, deceleration=math.inf, jerk=math.inf, period=0.0)

    def rows(limit: Damper, t: float, *, still: bool = False) -> tuple[Array, Array]:
        state, moves = inserted.state(inserted.arm.integrate(q, v, t), v), 0.0 if still else 1.0
        if isinstance(limit, SphereLimit):
            speed = np.array(limit.velocity)
            centre = tuple(np.array(limit.centre) + t * speed)
            limit = replace(limit, centre=centre, velocity=tuple(moves * speed))
        moved = Reference(state.x, np.zeros(8), pivot + t * pivot_dot, moves * pivot_dot)
        found = limit.evaluate(state, moved)
        return found.C, found.d

    def shrinking(t: float) -> Array:
        C = rows(damper, t)[0]
        d, still = rows(plain, t)[1], rows(plain, t, still=True)[1]
        drift = np.zeros(len(C))
        drift[: len(d)] = d - still
        return np.asarray(C @ v - drift)

    state = inserted.state(q)
    free = damper.evaluate(state, Reference(state.x, np.zeros(8), pivot, pivot_dot)).d.copy()
    known = rows(plain, 0.0)[1]
    free[: len(known)] = known  # the sides of the cone are not among them
    counted = (free - rows(damper, 0.0)[1]) / T
    expected = derivative(shrinking, 1e-4)
    if isinstance(damper, KeepOut):  # going about the centre leads away from it
        assert (counted > expected - 1e-5).all()
    else:
        assert_allclose(counted, expected, rtol=1e-6, atol=1e-5)
