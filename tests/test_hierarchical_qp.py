"""The RCM as a task: strict while the arm runs out of speed, and always an answer."""

from __future__ import annotations

import dataclasses
import math
import re
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import (
    Run,
    Scenario,
    arm_names,
    compute_metrics,
    load_scenario,
    make_controller,
    simulate,
)
from rcmqp.controllers import HierarchicalQP
from rcmqp.errors import OptionError, UnknownName
from rcmqp.limits import JointLimits, braking_speed
from rcmqp.qp import HierarchySolution, SolverNotInstalled
from rcmqp.references.paths import ViewMoves
from rcmqp.tasks import RcmTask, RollTask, Task, TipTask, Together

ARMS = ("lwa3", "meka_a2")


def ran(scenario: Scenario, name: str = "hierarchical_qp", **options: Any) -> Run:
    made = make_controller(name, scenario.insertion(), scenario.period, **options)
    return simulate(scenario, made)


def fast(arm: str, duration: float = 1.5) -> Scenario:
    return load_scenario("fast_helix", arm, duration=duration)


@pytest.mark.parametrize("arm", ARMS)
def test_on_the_helix_tip_and_rcm_are_exact_to_second_order(arm: str) -> None:
    found = compute_metrics(ran(load_scenario("conical_helix", arm, duration=2.0)))
    assert found.tip_rms_mm < 0.03
    assert found.rcm_max_mm < 0.001
    assert found.speed_ratio_max < 1.0


@pytest.mark.parametrize("arm", arm_names())
def test_when_the_arm_runs_out_of_speed_the_tip_lags_and_the_rcm_does_not_move(arm: str) -> None:
    run = ran(fast(arm, 3.5 if arm == "meka_a2" else 1.5), backend="active_set")
    found = compute_metrics(run)
    accelerations = found.acceleration_ratio_max
    assert max(found.speed_ratio_max, accelerations if accelerations > 0.0 else 0.0) > 0.99
    assert found.tip_max_mm > 1.0
    assert found.rcm_max_mm < 0.01
    assert found.speed_ratio_max <= 1.0
    assert math.isnan(found.acceleration_ratio_max) == np.isinf(run.acceleration_limit).all()
    assert not found.acceleration_ratio_max > 1.0 + 1e-9  # NaN where no limit is known
    assert found.limit_margin_min_rad >= -1e-12
    assert (run.diagnostics["exact"] == 1.0).all()
    assert run.diagnostics["kkt"].max() < 1e-8


@pytest.mark.parametrize("arm", ["lwa3", "panda", "ur5", "meka_a2"])
def test_the_active_sets_of_the_last_cycle_are_right_at_once_in_most_cycles(arm: str) -> None:
    """Where limits are in the way, a level takes a round a step: three steps, once or twice."""
    scenario = fast(arm, 0.5)
    insertion, T = scenario.insertion(), scenario.period
    law = make_controller("hierarchical_qp", insertion, T)
    q, v, a = insertion.q_start, np.zeros(insertion.arm.nv), np.zeros(insertion.arm.nv)
    asked, rounds = scenario.references(insertion), []
    for reference in asked:
        answer = law.step(insertion.state(q, v, a), reference)
        assert isinstance(answer.account, HierarchySolution)
        levels = answer.account.levels
        if any(level.rounds for level in levels):
            rounds.append(max(level.rounds for level in levels))
        q, v, a = insertion.arm.integrate(q, answer.v, T), answer.v, (answer.v - v) / T
    assert len(rounds) > 200
    assert np.median(rounds) <= 8
    assert np.quantile(rounds, 0.9) <= 16


def test_one_weighted_qp_gives_the_rcm_away_where_strict_levels_do_not() -> None:
    strict, weighted = ran(fast("lwa3")), ran(fast("lwa3"), "weighted_qp", rcm_weight=10.0)
    assert compute_metrics(weighted).rcm_max_mm > 10.0 * compute_metrics(strict).rcm_max_mm
    assert compute_metrics(weighted).speed_ratio_max <= 1.0


@pytest.mark.parametrize("name", ["fast_helix", "view_steps"])
@pytest.mark.parametrize("arm", arm_names())
def test_the_backend_changes_the_time_and_not_the_path(arm: str, name: str) -> None:
    """No bit differs; without from_deciding() of cascade.c, 0.02 rad do (xarm7, view_steps).

    In one run the bounds that decide are degenerate, and the way to them costs 1e-13 rad/s at
    once and 4e-7 rad in the end.
    """
    degenerate = (arm, name) == ("xarm7", "fast_helix")
    scenario = load_scenario(name, arm)
    expected = ran(scenario, backend="active_set")
    if name == "view_steps" or arm != "z1":
        assert expected.diagnostics["joints_at_limit"].max() > 0
    for backend in ("proxqp", "daqp"):
        q, most = ran(scenario, backend=backend).q, 1e-6 if degenerate else 1e-12
        assert_allclose(q, expected.q, rtol=0, atol=most)


def test_a_breathing_trocar_of_known_velocity_keeps_its_rcm() -> None:
    scenario = load_scenario("trocar_1cm_05hz", "panda", duration=1.5)
    assert compute_metrics(ran(scenario)).rcm_max_mm < 0.01
    unknown = dataclasses.replace(scenario, pivot_velocity="unknown")
    speed = 0.01 * 2.0 * math.pi * 0.5  # the largest, so the lag is at most speed / K
    assert 0.1 < compute_metrics(ran(unknown)).rcm_max_mm < 1e3 * speed / 60.0


@pytest.mark.parametrize("name", ["hierarchical_qp", "weighted_qp"])
def test_a_trocar_found_5_mm_off_is_recovered_within_the_limits(name: str) -> None:
    run = ran(load_scenario("trocar_off_shaft", "panda", duration=1.0), name)
    assert run.rcm_error[0] > 4.9e-3
    assert run.rcm_error[-1] < 0.05e-3
    assert compute_metrics(run).speed_ratio_max <= 1.0


def test_levels_are_rearranged_in_one_expression() -> None:
    scenario = fast("lwa3", 0.8)
    levels: list[Task | Together] = [TipTask(), RcmTask() + RollTask(weight=0.01)]
    tip_first = HierarchicalQP(scenario.insertion(), scenario.period, levels=levels)
    assert tip_first.options["levels"] == ["tip", "rcm + roll"]
    usual, turned = ran(scenario), simulate(scenario, tip_first)
    assert turned.rcm_error.max() > 10.0 * usual.rcm_error.max()
    assert turned.tip_error.max() < usual.tip_error.max()


def test_the_account_says_what_holds_each_level_back() -> None:
    scenario = fast("lwa3")
    insertion = scenario.insertion()
    controller = make_controller("hierarchical_qp", insertion, scenario.period)
    reference = list(scenario.references(insertion))[400]
    state = insertion.arm.state(insertion.q_start, np.zeros(7))
    answer = controller.step(state, reference)
    account = answer.account
    assert isinstance(account, HierarchySolution)
    assert [level.name for level in account.levels] == ["rcm", "tip", "roll", "objective"]
    assert not account.levels[1].reached
    assert set(account.active()) <= set(insertion.arm.joints)
    for blocked in account.levels[1:]:  # later levels may leave a bound, by a little
        for name, weight in account.blocking(blocked).items():
            i = insertion.arm.joints.index(name)
            bound = (account.upper if weight > 0.0 else account.lower)[i]
            assert answer.v[i] == pytest.approx(bound, rel=1e-2)
            shown = account.active().get(name)
            assert shown in (None, "upper" if weight > 0.0 else "lower")

    rcm, tip, *_ = controller.report(state, answer).splitlines()
    assert rcm == "rcm: reached"
    level = account.levels[1]
    touched = account._answer.touching.any(axis=0)
    only = np.abs(level.multipliers) == (np.abs(level.multipliers) * touched).max()
    noisy = np.where(only, level.multipliers, 1e-12)  # rounding
    account._answer.numbers.setflags(write=True)
    account._answer.multipliers[2] = noisy
    same = controller.report(state, answer)
    assert same.splitlines()[0] == rcm
    assert same.splitlines()[1].startswith(tip.split("), ")[0].rstrip(")"))
    short = 1e3 * np.linalg.norm(account.levels[1].residual)
    heaviest = next(
        name for name in account.blocking(account.levels[1]) if name in account.active()
    )
    joint = insertion.arm.joints.index(heaviest)
    step = scenario.period**2 * insertion.arm.jerk[joint]
    v = answer.v[insertion.arm.joints.index(heaviest)]
    assert abs(v) == pytest.approx(step, rel=1e-12)  # from rest, at 1 ms
    side = "upper" if v > 0 else "lower"
    assert tip.startswith(f"tip: {short:.3g} mm/s short, held back by {heaviest} ({side} jerk")


def test_the_report_names_only_bounds_that_are_touched_and_hold_the_level_back() -> None:
    scenario = fast("lwa3")
    insertion = scenario.insertion()
    controller = make_controller("hierarchical_qp", insertion, scenario.period)
    reference = list(scenario.references(insertion))[400]
    state = insertion.arm.state(insertion.q_start, np.zeros(7))
    answer = controller.step(state, reference)
    account = answer.account
    assert isinstance(account, HierarchySolution)
    names = insertion.arm.joints
    account._answer.numbers.setflags(write=True)
    weights, touching = account._answer.multipliers, account._answer.touching
    heavy = int(np.argmax(np.abs(weights[2, :7]) * touching[:, :7].any(axis=0)))
    other = (heavy + 1) % 7
    weights[2, other] = 2.0 * weights[2, heavy]  # heavier than all, and not touched
    touching[:, other] = 0.0
    tip = controller.report(state, answer).splitlines()[1]
    assert f"{names[heavy]} (" in tip
    assert f"{names[other]} (" not in tip
    touching[0 if weights[2, other] > 0.0 else 1, other] = 1.0  # touched on the other side
    assert f"{names[other]} (" not in controller.report(state, answer).splitlines()[1]
    touching[1 if weights[2, other] > 0.0 else 0, other] = 1.0
    assert f"held back by {names[other]} (" in controller.report(state, answer).splitlines()[1]


@pytest.mark.parametrize(
    ("share", "before", "limit"),
    [
        (1.0, 0.9, "speed limit"),
        (0.5, 0.5, "position limit"),
        (0.5, 0.25, "acceleration limit"),
        (0.5, 0.5, "jerk limit"),
        (0.99, 0.99, "speed limit"),  # it is not to be exceeded in the next cycles
    ],
)
def test_the_report_says_which_of_its_limits_a_joint_is_at(
    share: float, before: float, limit: str
) -> None:
    scenario = fast("lwa3")
    insertion = scenario.insertion()
    arm, T = insertion.arm, scenario.period
    controller = make_controller("hierarchical_qp", insertion, T)
    reference = list(scenario.references(insertion))[400]
    answer = controller.step(insertion.state(insertion.q_start, np.zeros(7)), reference)
    account = answer.account
    assert isinstance(account, HierarchySolution)
    joint = next(name for name in account.blocking(account.levels[1]) if name in account.active())
    i = arm.joints.index(joint)
    v, v_before, a = answer.v.copy(), np.zeros(7), 0.3 * arm.acceleration
    arm.jerk = arm.acceleration / 0.05
    v[i] = share * arm.velocity[i]
    v_before[i] = before * arm.velocity[i]
    if limit == "acceleration limit":
        v[i] = v_before[i] + T * arm.acceleration[i]
    if limit == "jerk limit":
        v[i] = v_before[i] + T * (a[i] - T * arm.jerk[i])
    elif before == 0.99:
        side = 1.0 if account.at_upper[i] else -1.0
        ahead = braking_speed((1.0 - 0.99) * arm.velocity[i], JointLimits.easing * arm.jerk[i], T)
        v[i] = v_before[i] = side * v_before[i]
        v[i] += side * T * float(ahead)
    moved = dataclasses.replace(answer, v=v, account=dataclasses.replace(account, v=v))
    report = controller.report(insertion.state(insertion.q_start, v_before, a), moved)
    assert re.search(rf"tip: .* {joint} \((upper|lower) {limit}\)", report)


def test_wrong_options_are_refused_with_a_remedy() -> None:
    scenario = load_scenario("conical_helix", "lwa3")
    for options, error, message in (
        ({"backend": "proxpq"}, UnknownName, "proxqp"),
        ({"gain": 3000.0}, OptionError, "stable"),
        ({"objective": "beauty"}, UnknownName, "unknown objective"),
        ({"backend": "copt"}, SolverNotInstalled, "pip install"),
    ):
        with pytest.raises(error, match=message):
            make_controller("hierarchical_qp", scenario.insertion(), 1e-3, **options)


@pytest.mark.parametrize("arm", ARMS)
def test_backends_draw_the_same_helix(arm: str) -> None:
    scenario = load_scenario("conical_helix", arm, duration=1.0)
    paths = [ran(scenario, backend=backend).q for backend in ("proxqp", "daqp", "active_set")]
    for path in paths[1:]:
        assert_allclose(path, paths[0], rtol=0, atol=1e-6)


def test_second_order_takes_the_curvature_out_of_the_rcm() -> None:
    scenario = fast("xarm7", 0.8)
    insertion, T = scenario.insertion(), scenario.period
    tool = [TipTask(), RollTask()]
    first, second = (
        simulate(scenario, HierarchicalQP(insertion, T, levels=[RcmTask(period=period), *tool]))
        for period in (0.0, T)
    )
    assert second.rcm_error.max() < 0.2 * first.rcm_error.max()


def test_rows_that_would_take_the_rcm_away_come_after_it() -> None:
    scenario = load_scenario("cone_and_depth", "lwa3", duration=6.0)
    run = ran(scenario, backend="active_set")
    found = compute_metrics(run)
    assert found.rcm_max_mm < 0.01
    assert found.acceleration_ratio_max <= 1.0 + 1e-9
    shallowest, deepest = scenario.trocar.depth_range
    assert run.depth.max() > deepest - 5e-4  # it is led to the end of the range
    assert run.depth.max() < deepest + 1e-5
    assert run.depth.min() > shallowest - 1e-5
    assert (run.diagnostics["exact"] == 1.0).all()


def test_joints_that_lag_behind_do_not_disturb_the_limits() -> None:
    found = compute_metrics(
        ran(
            load_scenario("servo_helix", "lwa3", duration=3.0, jerk=math.inf), backend="active_set"
        )
    )
    assert found.rcm_max_mm < 0.05
    assert found.tip_rms_mm < 0.05


def test_levels_and_limits_of_another_kind_are_refused() -> None:
    scenario = load_scenario("conical_helix", "panda")
    options: dict[str, Any]
    for options, message in (
        ({"levels": ["rcm"]}, "is no"),
        ({"limits": [RcmTask()]}, "is no"),
        ({"levels": []}, "levels is empty; give at least one task"),
    ):
        with pytest.raises(OptionError, match=message):
            HierarchicalQP(scenario.insertion(), scenario.period, **options)


def test_what_is_recorded_has_the_same_names_in_a_safe_stop() -> None:
    scenario = load_scenario("conical_helix", "panda")
    insertion = scenario.insertion()
    levels: list[Task | Together] = [RcmTask() + TipTask(), TipTask(), TipTask(gain=30.0)]
    controller = HierarchicalQP(insertion, scenario.period, levels=levels)
    state, reference = insertion.state(insertion.q_start), next(scenario.references(insertion))
    usual = controller.step(state, reference).diagnostics
    spoilt = dataclasses.replace(reference, pivot=np.full(3, np.nan))
    assert list(usual)[:3] == ["rcm + tip_residual", "tip_residual", "tip_2_residual"]
    assert controller.step(state, spoilt).diagnostics.keys() == usual.keys()
    assert usual.keys() == {*controller.diagnostics, "safe_stop"}


def test_braking_early_before_a_position_limit_keeps_the_shaft_on_the_trocar() -> None:
    """A view that swings wide, too fast for the arm: a joint comes to its limit at speed."""
    views = ((0.5, 0.55, 1.7, -0.04), (-0.35, 0.15, 1.7, -0.025), (0.4, 0.15, -2.7, -0.02))
    path = ViewMoves(views=views, move=0.4)
    scenario = load_scenario("view_steps", "lwa3", path=path, duration=1.5, period=0.002)
    insertion, most = scenario.insertion(), {}
    for braking in (1.0, JointLimits.braking):
        limits = [JointLimits(insertion.arm, scenario.period, braking=braking)]
        run = simulate(
            scenario,
            HierarchicalQP(insertion, scenario.period, limits=limits, backend="active_set"),
        )
        most[braking] = run.rcm_error.max()
        assert compute_metrics(run).limit_margin_min_rad > -1e-12
    assert most[1.0] > 1e-3
    assert most[JointLimits.braking] < 1e-6


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"levels": RcmTask()},
            r"levels must be a list of tasks, such as \[RcmTask\(\), TipTask\(",
        ),
        ({"levels": "rcm"}, r"levels must be a list of tasks"),
        ({"limits": 3}, r"limits must be a list of limits"),
        (
            {"levels": [RcmTask(), [TipTask(), RollTask()]]},
            r"for several tasks on one level, add them: TipTask\(\) \+ RollTask\(\)",
        ),
        ({"limits": [RcmTask()]}, r"is not a Limit; levels are tasks, limits are limits"),
    ],
)
def test_levels_and_limits_that_are_no_lists_say_what_to_give(
    options: dict[str, Any], said: str
) -> None:
    scenario = load_scenario("conical_helix", "lwa3")
    with pytest.raises(OptionError, match=said):
        HierarchicalQP(scenario.insertion(), scenario.period, **options)
