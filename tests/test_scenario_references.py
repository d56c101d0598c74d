"""What a scenario tells the controller: references on a moving trocar."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose, shaft_distance

from rcmqp import Scenario, load_scenario
from rcmqp.maths.dualquaternion import P, quaternion_mul, to_se3
from rcmqp.references.paths import ViewSteps
from rcmqp.runs.scenario import PIVOT_VELOCITIES
from rcmqp.world.instrument import Vector3
from rcmqp.world.motions import Sampled, Sinusoid, Still


def moving(how: str, **changes: Any) -> Scenario:
    motion = Sinusoid(amplitude=0.02, frequency=1.0, direction=(1.0, -2.0, 2.0), ramp=0.3)
    given = {"duration": 0.5, "motion": motion, "pivot_velocity": how, **changes}
    return load_scenario("conical_helix", **given)


def test_the_trocar_is_where_its_motion_takes_it() -> None:
    scenario = moving("measured")
    insertion = scenario.insertion()
    pivots = scenario.pivots()
    assert pivots.shape == (501, 3)
    assert np.array_equal(pivots[0], scenario.trocar.pivot)
    for k, reference in enumerate(scenario.references(insertion)):
        expected = np.array(scenario.trocar.pivot) + scenario.motion.position(k * 1e-3)
        assert_allclose(pivots[k], expected, rtol=0, atol=1e-15)
        assert_allclose(reference.pivot, expected, rtol=0, atol=1e-14)
        assert shaft_distance(to_se3(reference.x_d), pivots[k]) < 1e-14
    assert np.ptp(pivots, axis=0).max() > 0.01


def test_a_view_goes_along_with_the_trocar() -> None:
    still = moving("measured", motion=Still())
    scenario = moving("measured")
    pairs = zip(
        still.references(still.insertion()),
        scenario.references(scenario.insertion()),
        scenario.pivots() - still.pivots(),
        strict=True,
    )
    for plain, carried, offset in pairs:
        a, b = to_se3(plain.x_d), to_se3(carried.x_d)
        assert_allclose(a.rotation, b.rotation, rtol=0, atol=1e-15)
        assert_allclose(b.translation - a.translation, offset, rtol=0, atol=1e-14)


@pytest.mark.parametrize("planner_time", [None, 0.2])
def test_x_d_dot_is_the_derivative_of_x_d_on_a_moving_trocar(planner_time: float | None) -> None:
    """Central differences between cycles, which err by some T^2 / 6 of the third derivative."""
    scenario = moving("measured", planner_time=planner_time, period=5e-4)
    if planner_time:
        views = ((0.3, 0.2, 0.1, 0.02), (0.3, 0.2, 0.1, 0.02))
        scenario = dataclasses.replace(scenario, path=ViewSteps(views, dwell=1.0))
    T, references = scenario.period, list(scenario.references(scenario.insertion()))
    for k in range(1, len(references) - 1):
        if planner_time and abs(k * T - planner_time) < 3 * T:
            continue  # the plan stops at once
        rate = (references[k + 1].x_d - references[k - 1].x_d) / (2 * T)
        assert_allclose(references[k].x_d_dot, rate, rtol=0, atol=2e-6)


def test_a_measured_velocity_is_the_motions() -> None:
    scenario = moving("measured")
    for k, reference in enumerate(scenario.references(scenario.insertion())):
        assert np.array_equal(reference.pivot_dot, scenario.motion.velocity(k * 1e-3))


def test_an_estimated_velocity_is_the_way_since_the_last_cycle_over_the_period() -> None:
    scenario = moving("estimated")
    references = list(scenario.references(scenario.insertion()))
    assert not references[0].pivot_dot.any()
    for before, now in itertools.pairwise(references):
        assert_allclose(now.pivot_dot, (now.pivot - before.pivot) / 1e-3, rtol=0, atol=1e-11)


def test_an_unknown_velocity_is_told_as_zero() -> None:
    """In x_d_dot, too: it is that of the same view in a trocar that stands still."""
    scenario, measured = moving("unknown"), moving("measured")
    pairs = zip(
        scenario.references(scenario.insertion()),
        measured.references(measured.insertion()),
        strict=True,
    )
    for told, full in pairs:
        assert not told.pivot_dot.any()
        assert np.array_equal(told.x_d, full.x_d)
        drift = 0.5 * quaternion_mul([0.0, *full.pivot_dot], P(full.x_d))
        assert_allclose(told.x_d_dot[4:] + drift, full.x_d_dot[4:], rtol=0, atol=1e-15)


def test_a_trocar_that_jumps_takes_the_reference_along_at_once() -> None:
    """Ten centimetres in a cycle, as a tracker may report: no planner, no error; see Reference."""
    there: Vector3 = (0.0, 0.1, 0.0)
    jump = Sampled((0.0, 0.1, 0.101, 1.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), there, there))
    scenario = load_scenario("view_steps", motion=jump, duration=0.2)
    references = list(scenario.references(scenario.insertion()))
    gap = to_se3(references[101].x_d).translation - to_se3(references[100].x_d).translation
    assert_allclose(gap, there, rtol=0, atol=1e-3)


@pytest.mark.parametrize("how", PIVOT_VELOCITIES)
@pytest.mark.parametrize("planner_time", [None, 0.02])
def test_references_do_not_depend_on_how_many_are_made_at_once(
    how: str, planner_time: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = moving(how, duration=0.06, planner_time=planner_time)
    insertion, found = scenario.insertion(), []
    for block in (512, 7, 1):
        monkeypatch.setattr("rcmqp.runs.asked.BLOCK", block)
        references = list(scenario.references(insertion))
        assert len(references) == scenario.cycles
        found.append([np.concatenate(dataclasses.astuple(reference)) for reference in references])
    assert np.array_equal(found[0], found[1])
    assert np.array_equal(found[0], found[2])
