"""The RCM as a task: strict while the arm runs out of speed, and always an answer."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import Run, Scenario, compute_metrics, load_scenario, make_controller, simulate
from rcmqp.controllers import HierarchicalQP
from rcmqp.errors import OptionError, UnknownName
from rcmqp.paths import ConicalHelix
from rcmqp.qp import HierarchySolution, SolverNotInstalled
from rcmqp.reference import view_pose
from rcmqp.tasks import RcmTask, RollTask, TipTask

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


@pytest.mark.parametrize("arm", ["lwa3", "panda"])
def test_when_the_arm_runs_out_of_speed_the_tip_lags_and_the_rcm_does_not_move(arm: str) -> None:
    run = ran(fast(arm))
    found = compute_metrics(run)
    assert found.saturated_share > 1 / 3
    assert found.tip_max_mm > 1.0
    assert found.rcm_max_mm < 0.01
    assert found.speed_ratio_max <= 1.0
    assert found.acceleration_ratio_max <= 1.0 + 1e-9
    assert found.limit_margin_min_rad >= 0.0
    exact = run.diagnostics["exact"] == 1.0
    assert exact.mean() > 0.99  # a degenerate level may end unverified, and says so
    assert run.diagnostics["kkt"][exact].max() < 1e-8


def test_one_weighted_qp_gives_the_rcm_away_where_strict_levels_do_not() -> None:
    strict, weighted = ran(fast("lwa3")), ran(fast("lwa3"), "weighted_qp", rcm_weight=10.0)
    assert compute_metrics(weighted).rcm_max_mm > 10.0 * compute_metrics(strict).rcm_max_mm
    assert compute_metrics(weighted).speed_ratio_max <= 1.0


@pytest.mark.parametrize("backend", ["daqp", "active_set"])
def test_the_backend_changes_the_time_and_not_the_path(backend: str) -> None:
    scenario = fast("panda", 0.5)
    expected = ran(scenario)
    assert expected.diagnostics["joints_at_limit"].max() > 0
    assert_allclose(ran(scenario, backend=backend).q, expected.q, rtol=0, atol=1e-6)


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
    insertion, d = scenario.insertion(), scenario.insertion().tip_depth
    tip_first = HierarchicalQP(
        insertion, scenario.period, levels=[TipTask(d), RcmTask() + RollTask(weight=0.01)]
    )
    assert tip_first.options["levels"] == ["tip", "rcm + roll"]
    usual, turned = ran(scenario), simulate(scenario, tip_first)
    assert turned.rcm_error.max() > 10.0 * usual.rcm_error.max()
    assert turned.tip_error.max() < usual.tip_error.max()


@pytest.mark.parametrize("name", ["hierarchical_qp", "weighted_qp"])
@pytest.mark.parametrize("field", ["x_d", "x_d_dot", "pivot", "pivot_dot"])
def test_a_reference_that_is_no_number_ends_in_the_safe_stop(name: str, field: str) -> None:
    scenario = load_scenario("conical_helix", "lwa3")
    insertion, T = scenario.insertion(), scenario.period
    controller = make_controller(name, insertion, T)
    view = ConicalHelix().command(5.0, insertion.tip_depth)
    reference = view_pose(insertion.x_rcm, view)
    spoilt = dataclasses.replace(
        reference, **{field: np.full(len(getattr(reference, field)), np.nan)}
    )
    v = np.full(7, 0.05)  # moving: the brake may not stop it at once
    answer = controller.step(insertion.arm.state(insertion.q_start, v), spoilt)
    assert answer.diagnostics["safe_stop"] == 1.0
    assert_allclose(answer.v, v - T * insertion.arm.acceleration, rtol=0, atol=1e-12)
    again = controller.step(insertion.arm.state(insertion.q_start, answer.v), reference)
    assert again.diagnostics["safe_stop"] == 0.0


def test_the_account_says_what_holds_each_level_back() -> None:
    scenario = fast("lwa3")
    insertion = scenario.insertion()
    controller = make_controller("hierarchical_qp", insertion, scenario.period)
    reference = list(scenario.references(insertion))[400]
    answer = controller.step(insertion.arm.state(insertion.q_start, np.zeros(7)), reference)
    account = answer.account
    assert isinstance(account, HierarchySolution)
    assert [level.name for level in account.levels] == ["rcm", "tip", "roll", "objective"]
    assert not account.levels[1].reached
    assert set(account.blocking(account.levels[1])) <= set(account.active())
    assert set(account.active()) <= set(insertion.arm.joints)


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
