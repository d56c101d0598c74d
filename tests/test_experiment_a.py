"""Experiment A of the paper: the tip draws a conical helix, the shaft stays on the trocar.

The acceptance figures of the simulated experiment, with the paper's gains K = 60, K_c = 7 and
c_d = 1. The lag of law (6) is speed over gain, whatever the period; the RCM error is the Euler
step's and grows with the period.
"""

from __future__ import annotations

import functools
from typing import Any

import pytest
from helpers import assert_allclose

from rcmqp import (
    Metrics,
    Run,
    arm_names,
    compute_metrics,
    load_scenario,
    make_controller,
    simulate,
)

PAPER_ARMS = ["lwa3", "meka_a2"]

on_every_arm = pytest.mark.parametrize("arm", arm_names())
on_the_papers_arms = pytest.mark.parametrize("arm", PAPER_ARMS)


@functools.cache
def run(arm: str, period: float = 8e-3, **options: Any) -> Run:
    """The whole helix, each one computed once."""
    scenario = load_scenario("conical_helix", arm, period=period)
    controller = make_controller("dual_quaternion", scenario.insertion(), period, **options)
    return simulate(scenario, controller)


def metrics(arm: str, period: float = 8e-3, **options: Any) -> Metrics:
    return compute_metrics(run(arm, period, **options))


def test_the_papers_arms_run_with_the_papers_gains() -> None:
    assert set(PAPER_ARMS) <= set(arm_names())
    for arm in PAPER_ARMS:
        options = run(arm).options
        assert (options["gain"], options["K_c"], options["c_d"]) == (60.0, 7.0, 1.0)
        assert options["objective"] == "singularity_product"


@on_every_arm
def test_the_rcm_holds_at_8_ms(arm: str) -> None:
    assert metrics(arm).rcm_max_mm <= 0.005  # the paper claims 0.05


@on_every_arm
def test_the_tip_lags_by_its_speed_over_the_gain(arm: str) -> None:
    found = metrics(arm)
    assert_allclose(found.tip_rms_mm, found.tip_speed_rms_mm_s / 60.0, rtol=0.05)


@on_every_arm
def test_no_joint_leaves_its_limits(arm: str) -> None:
    found = metrics(arm)
    assert found.speed_ratio_max <= 1.0
    assert found.limit_margin_min_rad > 0.0


@on_every_arm
def test_the_helix_has_the_stated_depth_and_speed(arm: str) -> None:
    found = metrics(arm)
    assert 100.0 <= found.depth_min_mm + 1e-6
    assert found.depth_max_mm <= 150.0
    assert_allclose(found.tip_speed_rms_mm_s, 20.0, rtol=0.02)


@on_the_papers_arms
def test_a_shorter_period_helps_the_rcm_and_not_the_lag(arm: str) -> None:
    found = metrics(arm, 1e-3)
    assert found.rcm_max_mm <= 0.001
    assert found.rcm_rms_mm < metrics(arm).rcm_rms_mm / 4.0
    assert_allclose(found.tip_rms_mm, metrics(arm).tip_rms_mm, rtol=0.01)


@on_the_papers_arms
def test_feed_forward_takes_the_lag_away(arm: str) -> None:
    found = metrics(arm, 1e-3, feed_forward=True)
    assert found.tip_rms_mm <= 0.03
    assert found.rcm_max_mm <= 0.001


@on_the_papers_arms
def test_the_nullspace_term_keeps_the_arm_away_from_singularities(arm: str) -> None:
    with_term, without = run(arm), run(arm, K_c=0.0)
    for found in (with_term, without):
        assert compute_metrics(found).rcm_max_mm <= 0.005
    c, c_without = (found.diagnostics["objective"] for found in (with_term, without))
    assert c[0] == c_without[0]
    assert c[-1] > c_without[-1]
    assert c.mean() > c_without.mean()
    assert c.min() > c_without.min()
