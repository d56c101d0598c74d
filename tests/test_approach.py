"""Errors are approached no faster than the joints can stop."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rcmqp import Run, load_scenario, make_controller, simulate
from rcmqp.dualquaternion import Array
from rcmqp.tasks.base import Approach

FAST = 1e9
"""A gain at which every error has to be braked for [1/s]."""


def one_joint(a: float, j: float, share: float = 1.0, period: float = 1e-9) -> Approach:
    return Approach(np.array([a]), np.array([j]), share, period, np.zeros((0, 1)))


def approached(approach: Approach, distance: float, gain: float = FAST) -> float:
    """Speed at which a joint may approach its own error."""
    error = np.array([distance])
    return gain * distance * approach.share_of(np.eye(1), error, gain, damping=1e-6)


def stopping_distance(v: float, a: float, j: float) -> float:
    """How far a joint at v goes if it brakes as hard as it may, step by step."""
    h, x, slowing = 1e-5, 0.0, 0.0
    while v > 0.0:
        eased = v <= slowing * slowing / (2.0 * j)  # the brake has to be let go by then
        slowing = max(slowing - h * j, 0.0) if eased else min(slowing + h * j, a)
        if eased and slowing == 0.0:
            break
        x += h * (v - 0.5 * h * slowing)
        v -= h * slowing
    return x


@pytest.mark.parametrize("distance", [1e-4, 1e-3, 1e-2, 0.1])
@pytest.mark.parametrize(("a", "j"), [(10.0, 5000.0), (2.0, 20.0), (1e6, 50.0), (3.0, 1e6)])
def test_a_jerk_limited_stop_from_the_approach_speed_ends_at_the_error(
    distance: float, a: float, j: float
) -> None:
    """With the acceleration's limit met on the way, or not."""
    v = approached(one_joint(a, j), distance)
    found = stopping_distance(v, a, j)
    assert found == pytest.approx(distance, rel=0.02, abs=2e-5 * v)


def test_without_a_limit_on_jerk_or_acceleration_the_stop_is_that_of_the_other() -> None:
    for distance in (1e-4, 1e-2, 1.0):
        constant = approached(one_joint(5.0, math.inf), distance)
        assert constant == pytest.approx(math.sqrt(2.0 * 5.0 * distance), rel=1e-6)
        ramped = approached(one_joint(math.inf, 300.0), distance)
        assert ramped * math.sqrt(ramped / 300.0) == pytest.approx(distance, rel=1e-6)
        free = one_joint(math.inf, math.inf)
        assert free.share_of(np.eye(1), np.array([distance]), 60.0, 1e-6) == 1.0


@pytest.mark.parametrize(("a", "j"), [(10.0, 5000.0), (5.0, math.inf)])
@pytest.mark.parametrize("distance", [0.003, 0.05, 0.5])
def test_a_joint_within_its_limits_comes_to_its_end_and_not_past_it(
    a: float, j: float, distance: float
) -> None:
    """Cycle by cycle; in proportion to the error, it does go past it."""
    T, gain, past = 1e-3, 60.0, {}
    for share in (0.8, 0.0):
        approach, e, v, change = one_joint(a, j, share, T), distance, 0.0, 0.0
        sizes = []
        for _ in range(6000):
            wanted = approached(approach, e, gain) if e != 0.0 else 0.0
            low, up = max(-a * T, change - j * T * T), min(a * T, change + j * T * T)
            change = min(max(wanted - v, low), up)
            v += change
            e -= T * v
            sizes.append(e)
        past[share] = -min(sizes)
        if share:
            assert abs(sizes[-1]) < 1e-6
    assert past[0.8] < 0.01 * distance
    if distance > 0.01:
        assert past[0.0] > 0.03 * distance


def test_the_slowest_joint_of_those_that_move_the_error_decides() -> None:
    rng, cut = np.random.default_rng(7), 0
    for _ in range(50):
        strict, A = 0.4 * rng.normal(size=(2, 7)), 0.4 * rng.normal(size=(3, 7))
        e, a = 0.05 * rng.normal(size=3), rng.uniform(2.0, 10.0, size=7)
        if np.linalg.svd(np.vstack([strict, A]))[1][-1] < 0.3:
            continue
        found = Approach(a, np.full(7, np.inf), 0.5, 1e-9, strict).share_of(A, e, 60.0, 0.003)
        size = np.linalg.norm(e)
        w = np.linalg.pinv(np.vstack([strict, A])) @ np.concatenate([np.zeros(2), e / size])
        speed = math.sqrt(2.0 * 0.5 * (a / np.abs(w)).min() * size)
        assert found == pytest.approx(min(1.0, speed / (60.0 * size)), rel=2e-3)
        cut += found < 1.0
    assert cut >= 10


def test_the_share_is_whole_for_small_errors_and_has_no_jump() -> None:
    rng = np.random.default_rng(7)
    strict, A, n = 0.4 * rng.normal(size=(2, 7)), 0.4 * rng.normal(size=(3, 7)), rng.normal(size=3)
    approach = Approach(np.full(7, 5.0), np.full(7, 500.0), 0.8, 1e-3, strict)
    sizes = np.geomspace(1e-9, 1.0, 20_000)
    found = np.array([approach.share_of(A, size * n, 60.0, 0.01) for size in sizes])
    assert found[0] == 1.0
    assert found[-1] < 0.2
    assert (found > 0.0).all()
    assert np.abs(np.diff(found)).max() < 2e-3
    assert (np.diff(sizes * found) > 0.0).all()  # from further away, never slower


def held_at_its_end(arm: str, **options: float) -> tuple[Run, Array]:
    """A fast helix whose end is held for 3 s; the tip's error from then on (n, 3)."""
    helix = load_scenario("fast_helix", arm)
    end = helix.path.duration
    scenario = dataclasses.replace(helix, duration=end + 3.0)
    run = simulate(
        scenario,
        make_controller("hierarchical_qp", scenario.insertion(), scenario.period, **options),
    )
    return run, (run.tip - run.tip_d)[round(end / scenario.period) :]


@pytest.mark.parametrize("arm", ["lwa3", "panda"])
def test_the_tip_does_not_pass_the_end_of_its_path(arm: str) -> None:
    """Measured: 0 mm past it, within 1 mm after 0.24 s and 0.29 s; in proportion 8 and 11 mm."""
    for approach, passes in ((0.8, False), (0.0, True)):
        run, error = held_at_its_end(arm, approach=approach)
        size = np.linalg.norm(error, axis=1)
        past = max(0.0, float(-(error @ error[0]).min() / size[0]))
        late = run.time[1] * (np.flatnonzero(size > 1e-3)[-1] + 1)
        assert size[0] > 5e-3  # it lags when the reference stops
        assert run.rcm_error.max() < 1e-5
        assert (past > 5e-3) == passes
        if not passes:
            assert past < 0.5e-3
            assert late < 0.35
            nearest = int(np.argmax(np.diff(size) > 0.0))
            assert size[nearest:].max() < 0.5e-3  # it does not come back out, either
