"""The joints stay slow enough to hold the shaft on the trocar, whatever the views ask for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rcmqp import (
    ArmState,
    Insertion,
    Reference,
    Run,
    Scenario,
    load_scenario,
    make_controller,
    simulate,
)
from rcmqp.controllers.hierarchical_qp import default_limits
from rcmqp.limits import Constraint, TrocarSpeed
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths import ViewMoves

VIEWS = (
    (-0.541, 0.537, 0.228, -0.031),
    (0.579, -0.398, 1.365, 0.013),
    (-0.291, -0.144, -0.113, -0.002),
    (-0.304, -0.101, -0.385, 0.039),
)
"""In between, an xArm7 with weak joints came to speeds at which it lost the trocar by 62 mm."""


@pytest.fixture(scope="module")
def weak() -> Scenario:
    path = ViewMoves(views=VIEWS, move=1.5)
    scenario = load_scenario("view_steps", "xarm7", acceleration=1.0, jerk=50.0)
    return replace(scenario, path=path, duration=6.5, period=0.004)


def run(scenario: Scenario, *, limited: bool = True) -> Run:
    insertion, T = scenario.insertion(), scenario.period
    limits = [
        limit
        for limit in default_limits(insertion, T)
        if limited or not isinstance(limit, TrocarSpeed)
    ]
    return simulate(scenario, make_controller("hierarchical_qp", insertion, T, limits=limits))


def needed(insertion: Insertion, q: Array, v: Array) -> float:
    """Share of the acceleration limits that holding the trocar takes: s of TrocarSpeed.

    Of two limits, the row of each allows a step ahead of v in proportion to its share less s.
    """
    state = insertion.state(q, v)
    half, whole = (
        row_of(TrocarSpeed(arm=insertion.arm, period=1e-3, share=share), state, insertion)
        for share in (0.5, 1.0)
    )
    room, more = float(half.d[0] - half.C[0] @ v), float(whole.d[0] - half.d[0])
    assert more > 0.0 or np.abs(v).max() < 1e-3
    return 0.5 - 0.5 * room / more if more > 0.0 else 0.0


def row_of(limit: TrocarSpeed, state: ArmState, insertion: Insertion) -> Constraint:
    """Its row where the trocar stands still."""
    pivot = np.array(insertion.trocar.pivot)
    return limit.evaluate(state, Reference(state.x, np.zeros(8), pivot, np.zeros(3)))


def test_the_trocar_is_not_lost_at_speed(weak: Scenario) -> None:
    free, limited = run(weak, limited=False), run(weak)
    assert free.rcm_error.max() > 0.05, "without the limit, or this shows nothing"
    assert limited.rcm_error.max() < 1e-6
    insertion = weak.insertion()
    most = [
        max(needed(insertion, q, v) for q, v in zip(made.q[::10], made.v[::10], strict=True))
        for made in (free, limited)
    ]
    assert most[0] > 1.2
    assert most[1] < 0.65  # a half, and what the limit does not see of the way


@pytest.mark.parametrize("arm", ["lwa3", "ur5"])
def test_an_ordinary_run_does_not_notice(arm: str) -> None:
    helix = load_scenario("conical_helix", arm, duration=2.0)
    assert np.abs(run(helix).q - run(helix, limited=False).q).max() < 1e-13


@pytest.mark.parametrize("speed", [0.0, 1e200])
def test_the_row_allows_everything_at_rest_and_at_absurd_speeds(
    weak: Scenario, speed: float
) -> None:
    insertion = weak.insertion()
    state = insertion.state(insertion.q_start, np.full(insertion.arm.nv, speed))
    row = row_of(TrocarSpeed(arm=insertion.arm, period=weak.period), state, insertion)
    assert not row.C.any()
    assert row.d[0] > 0.0


def test_joints_without_acceleration_limits_may_move_at_any_speed() -> None:
    insertion = load_scenario("view_steps", "ur5", acceleration=np.inf).insertion()
    arm = insertion.arm
    for sign in (1.0, -1.0):
        state = insertion.state(insertion.q_start, sign * arm.velocity)
        row = row_of(TrocarSpeed(arm=arm, period=1e-3), state, insertion)
        assert row.C.any()
        assert float(np.abs(row.C[0]) @ arm.velocity) < float(row.d[0])
