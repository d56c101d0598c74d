"""Each metric against numbers worked out by hand on a run of four rows."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import Metrics, Run, compute_metrics, load_scenario, make_controller, simulate
from rcmqp.maths.dualquaternion import from_rotation
from rcmqp.runs.measures import until
from rcmqp.runs.metrics import NOT_TIMED
from rcmqp.runs.vocabulary import AFTER_THE_STOP, MEASURES
from rcmqp.world.obstacles import Sphere


@pytest.fixture(scope="module")
def small() -> Run:
    """Two joints, four rows, half a second apart, every number chosen."""
    scenario = load_scenario("conical_helix", duration=1.5, period=0.5)
    zeros = np.zeros(4)
    return Run(
        scenario=scenario,
        controller="dual_quaternion",
        options={},
        versions={},
        joints=("one", "two"),
        urdf_sha256="",
        lower=np.array([-1.0, -np.inf]),
        upper=np.array([2.0, np.inf]),
        velocity_limit=np.array([0.5, 4.0]),
        acceleration_limit=np.array([2.0, np.inf]),
        jerk_limit=np.array([5.0, np.inf]),
        time=np.array([0.0, 0.5, 1.0, 1.5]),
        path_time=np.array([0.0, 0.5, 1.0, 1.5]),
        q=np.zeros((4, 3)),
        q_measured=np.zeros((4, 3)),
        angles=np.array([[0.0, 9.0], [1.0, -9.0], [1.75, 0.0], [-0.5, 0.0]]),
        v=np.array([[0.1, 1.0], [-0.4, 1.0], [0.1, -3.0], [0.0, 0.0]]),
        v_actual=np.full((4, 2), 9.0),
        v_measured=np.full((4, 2), 9.0),
        pivot=np.zeros((4, 3)),
        x=np.zeros((4, 8)),
        x_d=np.zeros((4, 8)),
        tip=np.zeros((4, 3)),
        # steps of 3, 4 and 0 mm in half a second: 6, 8 and 0 mm/s
        tip_d=np.array([[0, 0, 0], [3e-3, 0, 0], [3e-3, 0, 4e-3], [3e-3, 0, 4e-3]]),
        tip_error=np.array([1e-3, 1e-3, 3e-3, 5e-3]),
        effector_error=np.array([0.0, 4e-3, 0.0, 0.0]),
        rcm_error=np.array([1e-6, 7e-6, 5e-6, 5e-6]),
        orientation_error=np.array([2e-3, 4e-3, 4e-3, 8e-3]),
        depth=np.array([0.1, 0.12, 0.09, 0.1]),
        tilt=np.array([0.0, 0.2, 0.3, 0.1]),
        singular_value=np.array([0.3, 0.2, 0.1, 0.4]),
        solve_time=zeros + np.array([1e-6, 2e-6, 4e-6, 101e-6]),
    )


def test_every_metric_equals_the_hand_computed_number(small: Run) -> None:
    # p95 of four values lies at 0.95 * 3 = 2.85: between the last two, 0.15 below the largest
    # one; p99 at 2.97.
    expected = Metrics(
        tip_rms_mm=3.0,  # sqrt((1 + 1 + 9 + 25) / 4)
        tip_max_mm=5.0,
        tip_p95_mm=4.7,
        contour_rms_mm=0.0,  # the tip stays where the curve begins
        contour_max_mm=0.0,
        lag_max_s=1.5,
        late_share=math.nan,  # no clock drove it
        behind_s=math.nan,
        effector_rms_mm=2.0,
        effector_max_mm=4.0,
        effector_p95_mm=3.4,
        rcm_rms_mm=5e-3,  # sqrt((1 + 49 + 25 + 25) / 4)
        rcm_max_mm=7e-3,
        rcm_p95_mm=6.7e-3,
        orientation_rms_mrad=5.0,  # sqrt((4 + 16 + 16 + 64) / 4)
        orientation_max_mrad=8.0,
        orientation_p95_mrad=7.4,
        depth_min_mm=90.0,
        depth_max_mm=120.0,
        tilt_max_mrad=300.0,
        speed_ratio_max=0.8,  # joint one at -0.4 of 0.5, before joint two at -3 of 4
        acceleration_ratio_max=0.5,  # joint one by 0.5 in 0.5 s, of 2; joint two has no limit
        jerk_ratio_max=0.8,  # joint one: 0.1 + 2 * 0.4 + 0.1 in 0.5 s squared, of 5
        saturated_share=0.0,
        limit_margin_min_rad=0.25,  # joint one at 1.75 of 2
        obstacle_distance_min_mm=math.inf,
        singular_value_min=0.1,
        tip_speed_rms_mm_s=10.0 / math.sqrt(3.0),  # sqrt((36 + 64 + 0) / 3)
        solve_time_median_us=3.0,
        solve_time_p99_us=101.0 - 0.03 * 97.0,
        errors_until_s=1.5,  # the helix would go on
        duration_s=1.5,
        reversals_in_a_row=2.0,  # joint one, 0.1 to -0.4 to 0.1
        reversals=2.0,  # joint two turns round in the second of them
        step_ratio_max=1.0,  # joint one by -0.5 of 0.5, joint two by -4 of 4
        swing_ratio_end=1.0,  # joint two from 1 to -3
        overshoot_max_mm=5.0,  # the tip stays, the desired one goes: of x_d, which stands still
        settling_time_s=math.inf,
        reference_end_s=0.0,
    )
    found = compute_metrics(small)
    for field in dataclasses.fields(Metrics):
        value = getattr(found, field.name)
        assert type(value) is float
        assert_allclose(value, getattr(expected, field.name), rtol=1e-12, err_msg=field.name)


def test_a_joint_outside_its_limits_has_a_negative_margin(small: Run) -> None:
    for angle, margin in ((2.5, -0.5), (-1.25, -0.25)):
        angles = small.angles.copy()
        angles[2, 0] = angle
        outside = dataclasses.replace(small, angles=angles)
        assert_allclose(compute_metrics(outside).limit_margin_min_rad, margin)


def test_a_joint_over_its_speed_limit_has_a_ratio_above_1(small: Run) -> None:
    v = small.v.copy()
    v[3, 1] = -5.0
    assert_allclose(compute_metrics(dataclasses.replace(small, v=v)).speed_ratio_max, 1.25)


def test_the_first_velocity_is_reached_from_rest(small: Run) -> None:
    v = np.full((4, 2), -0.45)
    found = compute_metrics(dataclasses.replace(small, v=v))
    assert_allclose(found.acceleration_ratio_max, 0.45 / 0.5 / 2.0)


def test_the_first_jerk_is_from_rest(small: Run) -> None:
    v = np.full((4, 2), -0.45)
    found = compute_metrics(dataclasses.replace(small, v=v))
    assert_allclose(found.jerk_ratio_max, 0.45 / 0.25 / 5.0)


def test_without_limits_there_is_no_ratio_to_them(small: Run) -> None:
    free = np.full(2, np.inf)
    found = compute_metrics(dataclasses.replace(small, acceleration_limit=free, jerk_limit=free))
    assert math.isnan(found.acceleration_ratio_max)
    assert math.isnan(found.jerk_ratio_max)


def test_a_cycle_is_saturated_with_a_joint_at_its_limit_of_speed_or_acceleration(
    small: Run,
) -> None:
    slow = np.full(2, 10.0)  # acceleration limits that nothing here comes near
    for v, limit, share in (
        ([[0.1, 0], [0.5, 0], [-0.5, 4], [0, 0]], slow, 0.5),  # at the speed limit of a joint
        ([[0.1, 0], [0.7, 0], [0.4, 9], [0, -4.1]], slow, 0.75),  # above it
        ([[0.5 * (1 - 1e-9), 0], [0, 0], [0, 0], [0, 0]], slow, 0.25),
        ([[0.5 * (1 - 1e-4), 0], [0, 0], [0, 0], [0, 0]], slow, 0.0),
        ([[0.1, 0], [0.2, 0], [0.2, 0], [0.05, 0]], np.array([0.2, np.inf]), 0.75),
    ):
        run = dataclasses.replace(small, v=np.array(v, dtype=float), acceleration_limit=limit)
        assert compute_metrics(run).saturated_share == share


def test_an_arm_without_position_limits_has_an_infinite_margin(small: Run) -> None:
    free = dataclasses.replace(small, lower=np.full(2, -np.inf), upper=np.full(2, np.inf))
    assert compute_metrics(free).limit_margin_min_rad == math.inf


def test_the_distance_from_an_obstacle_is_that_of_the_nearest_point_of_the_shaft(
    small: Run,
) -> None:
    length, radius = small.scenario.instrument.length, small.scenario.instrument.radius
    turned = from_rotation([math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0])  # z along the world's x
    balls = (Sphere((-0.1, 0.0, 0.05), 0.01), Sphere((0.0, 2.0, 0.0), 0.3))
    tips = {  # of the shaft, which ends at the origin's x; and the distance of its axis
        (0.0, 0.0, 0.0): 0.05,  # the ball is beside the shaft
        (-0.13, 0.0, 0.0): math.hypot(0.03, 0.05),  # in front of the tip
        (length - 0.06, 0.0, 0.0): math.hypot(0.04, 0.05),  # behind the mount
        (-0.1, 0.0, 0.02): 0.03,
    }
    scenario = dataclasses.replace(small.scenario, obstacles=balls)
    for tip, distance in tips.items():
        run = dataclasses.replace(
            small, scenario=scenario, x=np.tile(turned, (4, 1)), tip=np.tile(tip, (4, 1))
        )
        found = compute_metrics(run).obstacle_distance_min_mm
        assert_allclose(found, 1e3 * (distance - 0.01 - radius), rtol=1e-12)


def test_metrics_come_from_the_recorded_channels_alone() -> None:
    scenario = load_scenario("conical_helix", duration=0.2, period=1e-3)
    run = simulate(scenario, make_controller("dual_quaternion", scenario.insertion(), 1e-3))
    before = run.digest
    assert compute_metrics(run) == compute_metrics(run)
    assert run.digest == before


def test_a_run_of_one_row_lacks_the_tips_speed_and_a_rest(small: Run) -> None:
    one = small.with_rows({name: rows[:1] for name, rows in small.rows().items()}, {}, {})
    found = dataclasses.asdict(compute_metrics(one))
    missing = {name for name, value in found.items() if math.isnan(value)}
    assert missing == {"tip_speed_rms_mm_s", *NOT_TIMED, *AFTER_THE_STOP}
    assert (found["tip_rms_mm"], found["tip_p95_mm"], found["depth_min_mm"]) == (1.0, 1.0, 100.0)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_metrics_do_not_depend_on_the_parts(
    small: Run, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Velocities and accelerations across their borders, too."""
    whole, in_parts = compute_metrics(small), Run.parts
    monkeypatch.setattr(Run, "parts", lambda run: in_parts(run, size))
    found = compute_metrics(small)
    for field in dataclasses.fields(Metrics):
        assert_allclose(getattr(found, field.name), getattr(whole, field.name), rtol=1e-14)
    assert found.jerk_ratio_max == whole.jerk_ratio_max


def test_a_ratio_to_a_limit_and_a_distance_from_one_say_whether_there_is_one() -> None:
    ratio, margin = MEASURES["jerk_ratio_max"], MEASURES["limit_margin_min_rad"]
    assert ratio.text(0.5, ratio.fixed) == "0.50"
    assert ratio.text(50045.2) == "50045"
    assert ratio.text(math.nan) == margin.text(math.inf, ".2f") == "no limit"


def test_errors_that_count_for_a_part_of_a_run_say_so() -> None:
    assert until(20.0, 20.0) == "20"
    assert until(20.0, 100.0) == "20 of 100"
