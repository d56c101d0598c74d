"""Every scenario of the registry on every arm; and that each stress is what it says it is."""

from __future__ import annotations

import cmath
import functools
import math
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose, shaft_distance

from rcmqp import (
    Run,
    Scenario,
    arm_names,
    compute_metrics,
    load_arm,
    load_scenario,
    make_controller,
    scenario_names,
    simulate,
)
from rcmqp.cli.results import warnings
from rcmqp.controllers import CONTROLLERS
from rcmqp.maths.dualquaternion import Array, to_se3
from rcmqp.runs.loading import scenario_module

STRESS = {
    "breathing_trocar",
    "circle",
    "cone_and_depth",
    "fast_helix",
    "helix",
    "into_joint_limit",
    "lissajous",
    "moving_trocar",
    "near_singularity",
    "obstacle",
    "servo_helix",
    "six_joints",
    "trocar_1cm_05hz",
    "trocar_1cm_1hz",
    "trocar_2cm_05hz",
    "trocar_off_shaft",
}
K = 60.0

every_scenario = pytest.mark.parametrize("name", scenario_names())
on_every_arm = pytest.mark.parametrize("arm", arm_names())


@functools.cache
def scenario(name: str, arm: str) -> Scenario:
    return load_scenario(name, arm)


def ran(chosen: Scenario, controller: str = "dual_quaternion", **options: Any) -> Run:
    return simulate(
        chosen, make_controller(controller, chosen.insertion(), chosen.period, **options)
    )


def numbers(run: Run) -> dict[str, Array]:
    """Every number of a run that must be finite and the same again."""
    arrays = {**run.arrays(), **run.diagnostics}
    for name in ("solve_time", "lower", "upper", "acceleration_limit"):
        del arrays[name]
    return arrays


# The registry ------------------------------------------------------------------------------


def test_the_stress_scenarios_are_registered() -> None:
    assert set(scenario_names()) >= STRESS


@every_scenario
@on_every_arm
def test_every_scenario_is_finite_and_reruns_to_the_bit_on_every_arm(name: str, arm: str) -> None:
    short = load_scenario(name, arm, duration=0.03)
    assert Scenario.from_json(short.to_json()) == short
    run, again = ran(short), ran(Scenario.from_json(short.to_json()))
    for channel, values in numbers(run).items():
        assert np.isfinite(values).all(), channel
        assert np.array_equal(values, numbers(again)[channel]), channel
    assert run.digest == again.digest


@every_scenario
@pytest.mark.parametrize("controller", list(CONTROLLERS))
def test_every_scenario_runs_under_every_controller(name: str, controller: str) -> None:
    short = load_scenario(name, duration=0.02)
    run = ran(short, controller)
    for channel, values in run.arrays().items():
        if channel in numbers(run):
            assert np.isfinite(values).all(), channel


@every_scenario
def test_a_stress_scenario_takes_ten_seconds_at_the_most_in_periods_of_1_ms(name: str) -> None:
    chosen = scenario(name, "lwa3")
    assert chosen.period == 1e-3
    longer = {"conical_helix": 20.0, "helix": 20.0, "camera_task": 600.0}  # or until it is done
    assert chosen.duration <= longer.get(name, 10.0)
    assert chosen.duration >= chosen.path.duration


# Too fast, too far, too straight -----------------------------------------------------------


@on_every_arm
def test_the_fast_helix_saturates_a_controller_that_keeps_the_limits(arm: str) -> None:
    fast = scenario("fast_helix", arm)
    found = compute_metrics(
        ran(load_scenario("fast_helix", arm, period=4e-3), velocity_limit="scale")
    )
    assert found.speed_ratio_max <= 1.0
    assert found.saturated_share >= 1.0 / 3.0
    free = compute_metrics(ran(load_scenario("fast_helix", arm, period=4e-3)))
    assert free.speed_ratio_max > 1.0
    assert fast.duration > fast.path.duration


@on_every_arm
def test_the_joint_limit_is_where_the_view_leads(arm: str) -> None:
    """The paper's law, which knows none, breaks it; at the start there is room."""
    run = ran(load_scenario("into_joint_limit", arm, period=8e-3))
    margin = np.minimum(run.angles - run.lower, run.upper - run.angles)
    assert margin[0].min() == pytest.approx(0.1, abs=1e-9)
    assert margin.min() < -0.03
    assert run.singular_value.min() > 0.1
    assert compute_metrics(run).speed_ratio_max < 1.0


@on_every_arm
def test_the_singularity_is_near_and_not_reached(arm: str) -> None:
    run = ran(load_scenario("near_singularity", arm, period=8e-3), feed_forward=True)
    home = load_scenario("conical_helix", arm).insertion()
    at_home = np.linalg.svd(home.state(home.q_start).J_local, compute_uv=False)[-1]
    assert run.singular_value[0] == pytest.approx(0.08, abs=0.002)
    assert 0.005 < run.singular_value.min() < 0.04
    assert run.singular_value.min() < at_home / 3.0
    assert compute_metrics(run).limit_margin_min_rad > 0.0
    assert run.tip_error[-1] < 1e-4


@on_every_arm
def test_the_views_leave_cone_and_depth_range_on_both_sides(arm: str) -> None:
    chosen = load_scenario("cone_and_depth", arm, period=0.02)
    insertion, trocar = chosen.insertion(), chosen.trocar
    low, high = trocar.depth_range
    asked = [to_se3(reference.x_d) for reference in chosen.references(insertion)]
    axis = np.array(trocar.axis)
    tilts = [math.acos(min(1.0, axis @ oMd.rotation[:, 2])) for oMd in asked]
    depths = [
        insertion.tip_depth + (oMd.translation - trocar.pivot) @ oMd.rotation[:, 2]
        for oMd in asked
    ]
    assert tilts[0] < 1e-6
    assert max(tilts) > trocar.cone_half_angle + math.radians(5.0)
    assert max(depths) > high + 0.01
    assert min(depths) < low - 0.01
    assert depths[0] == pytest.approx(0.1)
    assert low < 0.1 < high


@pytest.mark.parametrize("controller", list(CONTROLLERS))
def test_a_path_through_an_obstacle_is_kept_out_of_it_by_who_knows_of_obstacles(
    controller: str,
) -> None:
    run = ran(load_scenario("obstacle", "panda", period=8e-3, duration=2.2), controller)
    found = compute_metrics(run)
    said = [text for text in warnings(run, found) if "into an obstacle" in text]
    if controller in ("hierarchical_qp", "weighted_qp", "vfi_qp"):
        assert -0.005 < found.obstacle_distance_min_mm < 2.0  # it went there, and not in
        assert found.tip_max_mm > 10.0
        assert not said
        assert not run.stops
    else:
        assert found.obstacle_distance_min_mm < -5.0
        assert said


# The trocar --------------------------------------------------------------------------------


@on_every_arm
def test_a_trocar_off_the_shaft_is_come_back_to_within_the_speed_limits(arm: str) -> None:
    run = ran(load_scenario("trocar_off_shaft", arm, duration=1.0), velocity_limit="scale")
    assert run.rcm_error[0] == pytest.approx(5e-3, abs=1e-12)
    assert run.rcm_error[-1] < 5e-5
    assert run.rcm_error.argmax() == 0
    assert compute_metrics(run).speed_ratio_max <= 1.0


def test_the_way_back_to_the_trocar_is_exponential() -> None:
    run = ran(load_scenario("trocar_off_shaft", "panda", duration=0.1), K_c=0.0)
    expected = 5e-3 * (1.0 - K * 1e-3) ** np.arange(101)
    assert_allclose(run.rcm_error, expected, rtol=1e-3)


MOTIONS = [
    ("moving_trocar", 0.01, 0.5),
    ("trocar_1cm_05hz", 0.01, 0.5),
    ("trocar_2cm_05hz", 0.02, 0.5),
    ("trocar_1cm_1hz", 0.01, 1.0),
]


@pytest.mark.parametrize(("name", "amplitude", "frequency"), MOTIONS)
def test_a_moving_trocar_swings_across_the_shaft_as_its_name_says(
    name: str, amplitude: float, frequency: float
) -> None:
    chosen = scenario(name, "meka_a2")
    insertion = chosen.insertion()
    oMe = insertion.state(insertion.q_start).oMe
    seen = (chosen.pivots() - chosen.trocar.pivot) @ oMe.rotation  # in the shaft's axes
    assert_allclose(seen[:, 1:], 0.0, rtol=0, atol=1e-15)
    t = 1e-3 * np.arange(chosen.cycles)
    full = t >= 2.0
    expected = amplitude * np.sin(2 * np.pi * frequency * t[full])
    assert_allclose(seen[full, 0], expected, rtol=0, atol=1e-15)
    rates = np.diff(seen[:, 0]) / 1e-3
    assert np.abs(np.diff(rates)).max() < 0.001 * 1.5 * amplitude * (2 * np.pi * frequency) ** 2


def test_the_moving_trocar_takes_any_amplitude_and_frequency() -> None:
    module = scenario_module("moving_trocar")
    motion = module.scenario("ur5", amplitude=0.005, frequency=2.0).motion
    assert np.abs([motion.position(2.0 + 0.125)]).max() == pytest.approx(0.005)


def test_a_breath_lifts_the_trocar_obliquely_to_the_shaft_which_goes_on_drawing() -> None:
    chosen = scenario("breathing_trocar", "panda")
    insertion = chosen.insertion()
    oMe = insertion.state(insertion.q_start).oMe
    seen = (chosen.pivots() - chosen.trocar.pivot) @ oMe.rotation
    top = seen[2000]  # in the middle of a breath of 4 s
    assert np.linalg.norm(top) == pytest.approx(0.01)
    assert math.degrees(math.acos(-top[2] / 0.01)) == pytest.approx(30.0)
    assert_allclose(seen[[0, 4000, 8000]], 0.0, rtol=0, atol=1e-15)


def lag(frequency: float, T: float, told: str) -> float:
    """RCM error per amplitude of the trocar's sine, once it has settled.

    The law in cycles is e' = (1 - K T) e + (p' - p) - T v, v being what it is told of the
    trocar's velocity: v itself, (p - p_before) / T, or nothing.
    """
    z = cmath.exp(2j * math.pi * frequency * T)
    step = {
        "measured": z - 1.0 - 2j * math.pi * frequency * T,
        "estimated": z - 1.0 - (1.0 - 1.0 / z),
        "unknown": z - 1.0,
    }
    return abs(step[told] / (z - 1.0 + K * T))


@pytest.mark.parametrize("told", ["measured", "estimated", "unknown"])
@pytest.mark.parametrize(("name", "amplitude", "frequency"), MOTIONS[1:])
def test_on_a_moving_trocar_the_rcm_error_is_what_theory_gives(
    name: str, amplitude: float, frequency: float, told: str
) -> None:
    T = 4e-3
    chosen = load_scenario(name, "xarm7", period=T, pivot_velocity=told, duration=5.0)
    run = ran(chosen, feed_forward=True)
    error = run.rcm_error[run.time >= 3.0]
    expected = amplitude * lag(frequency, T, told)
    assert error.max() == pytest.approx(expected, rel=0.03)
    v, a = (amplitude * (2 * math.pi * frequency) ** n for n in (1, 2))
    rough = {"measured": a * T / (2 * K), "estimated": a * T / K, "unknown": v / K}
    assert expected == pytest.approx(rough[told], rel=0.2)


@pytest.mark.parametrize("told", ["measured", "estimated", "unknown"])
def test_hierarchical_qp_keeps_a_moving_trocar_as_theory_says(told: str) -> None:
    T = 4e-3
    chosen = load_scenario(
        "trocar_1cm_1hz",
        "ur5",
        period=T,
        pivot_velocity=told,
        duration=2.8,
        acceleration=math.inf,
    )
    run = ran(chosen, "hierarchical_qp", K_c=0.0)
    error = run.rcm_error[run.time >= 2.2].max()  # a whole half of the sine, fully grown
    assert error == pytest.approx(0.01 * lag(1.0, T, told), rel=0.03)
    assert run.tip_error[run.time >= 2.2].max() < 2.0 * error  # it goes along


def test_a_law_without_feed_forward_lags_by_speed_over_gain_whatever_it_is_told() -> None:
    errors = []
    for told in ("measured", "unknown"):
        chosen = load_scenario(
            "trocar_2cm_05hz", "xarm7", period=4e-3, pivot_velocity=told, duration=4.0
        )
        errors.append(ran(chosen).rcm_error)
    assert np.array_equal(errors[0], errors[1])
    assert errors[0].max() == pytest.approx(0.02 * math.pi / K, rel=0.02)


# The joints --------------------------------------------------------------------------------


def test_six_joints_are_a_ur5s_if_no_arm_is_named() -> None:
    chosen = load_scenario("six_joints")
    assert chosen.arm == "ur5"
    assert load_arm(chosen.arm).nv == 6


@pytest.mark.parametrize("arm", ["lwa3", "z1"])
def test_the_helix_on_servos_is_worse_and_still_good(arm: str) -> None:
    chosen = load_scenario("servo_helix", arm, duration=4.0)
    run = ran(chosen, feed_forward=True)
    metrics = compute_metrics(run)
    assert 0.0015 < metrics.rcm_max_mm < 0.05  # on ideal joints it is below 0.001
    noise = run.q_measured - run.q
    count = 2 * math.pi / 2**20
    assert_allclose(noise.std(), math.sqrt(3e-6**2 + count**2 / 12), rtol=0.05)
    assert np.abs(run.v - run.v_actual).max() > 1e-3  # late, and slow
    assert (np.abs(run.v_actual) <= run.velocity_limit).all()


def test_paths_of_coiks_surg_stay_on_the_trocar_and_close() -> None:
    for name in ("circle", "lissajous"):
        chosen = load_scenario(name, period=0.02)
        insertion = chosen.insertion()
        x_d = [reference.x_d for reference in chosen.references(insertion)]
        pivot = np.array(chosen.trocar.pivot)
        assert max(shaft_distance(to_se3(x), pivot) for x in x_d) < 1e-14
        assert_allclose(x_d[-1], x_d[0], rtol=0, atol=1e-14)
        tips = insertion.tip(np.array(x_d))
        assert np.linalg.norm(tips - tips[0], axis=1).max() > 0.02
