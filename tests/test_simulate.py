"""Simulated runs: what each cycle records is what Pinocchio finds."""

from __future__ import annotations

import dataclasses
import functools
import math
import platform
import subprocess
import sys
from importlib.metadata import version

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, ran, shaft_distance

import rcmqp
from rcmqp import (
    ArmState,
    Command,
    Reference,
    Run,
    arm_names,
    compute_metrics,
    load_scenario,
    make_controller,
    scenario_names,
    simulate,
    view_pose,
)
from rcmqp.controllers import CONTROLLERS, DualQuaternion
from rcmqp.maths.dualquaternion import Array, to_se3
from rcmqp.plants import Servo
from rcmqp.references.paths import Path as ViewPath
from rcmqp.runs.simulate import parts
from rcmqp.world.motions import Breathing, Still

PERIOD = 8e-3


@functools.cache
def helix(arm: str) -> Run:
    """Four seconds of the helix at 8 ms."""
    return ran(load_scenario("conical_helix", arm, duration=4.0, period=PERIOD))


def numbers(run: Run) -> dict[str, Array]:
    """Every number of a run but the time that it took."""
    arrays = {**run.arrays(), **run.diagnostics}
    del arrays["solve_time"]
    return arrays


# Promises over the registries --------------------------------------------------------------


def test_there_are_scenarios() -> None:
    assert {"conical_helix", "view_steps"} <= set(scenario_names())


@pytest.mark.parametrize("arm", arm_names())
@pytest.mark.parametrize("controller", list(CONTROLLERS))
@pytest.mark.parametrize("name", ["conical_helix", "view_steps"])
def test_an_easy_scenario_runs_inside_limits_and_reruns_to_the_bit(
    name: str, controller: str, arm: str
) -> None:
    """The others are in test_stress."""
    scenario = load_scenario(name, arm, duration=0.1)
    run = ran(scenario, controller)
    for channel, values in numbers(run).items():
        infinite_allowed = channel in ("lower", "upper")
        assert np.isfinite(values).all() or infinite_allowed, channel
    metrics = compute_metrics(run)
    assert metrics.speed_ratio_max <= 1.0
    assert metrics.limit_margin_min_rad >= 0.0
    assert metrics.rcm_max_mm < 0.005

    again = ran(scenario, controller)
    for channel, values in numbers(run).items():
        assert np.array_equal(values, numbers(again)[channel]), channel
    assert again.digest == run.digest


# The record --------------------------------------------------------------------------------


@pytest.mark.parametrize("arm", arm_names())
def test_the_record_is_what_pinocchio_finds_at_the_recorded_q(arm: str) -> None:
    run = helix(arm)
    insertion = run.scenario.insertion()
    model, pivot = insertion.arm.model, np.array(run.scenario.trocar.pivot)
    data, last_joint = model.createData(), model.njoints - 1
    pin.framesForwardKinematics(model, data, insertion.q_start)
    start = insertion.state(insertion.q_start).oMe
    effector_in_joint = data.oMi[last_joint].actInv(start)  # rigidly on the last link
    tip_in_effector = np.array([0.0, 0.0, insertion.tip_depth])

    for k in range(0, run.scenario.cycles, 50):
        J = pin.computeJointJacobian(model, data, run.q[k], last_joint)
        pin.forwardKinematics(model, data, run.q[k])
        oMe, oMd = data.oMi[last_joint] * effector_in_joint, to_se3(run.x_d[k])
        tip, tip_d = oMe.act(tip_in_effector), oMd.act(tip_in_effector)
        expected = {
            "tip": tip,
            "tip_d": tip_d,
            "tip_error": np.linalg.norm(tip - tip_d),
            "effector_error": np.linalg.norm(oMe.translation - oMd.translation),
            "orientation_error": np.linalg.norm(pin.log3(oMe.rotation.T @ oMd.rotation)),
            "rcm_error": shaft_distance(oMe, pivot),
            "depth": oMe.rotation[:, 2] @ (tip - pivot),
            "singular_value": np.linalg.svd(
                effector_in_joint.toActionMatrixInverse() @ J, compute_uv=False
            )[-1],
        }
        for name, value in expected.items():
            assert_allclose(getattr(run, name)[k], value, rtol=0, atol=1e-12, err_msg=name)
        assert to_se3(run.x[k]).isApprox(oMe, 1e-12)


@pytest.mark.parametrize("arm", arm_names())
def test_each_row_follows_from_the_one_before(arm: str) -> None:
    run = helix(arm)
    insertion = run.scenario.insertion()
    assert np.array_equal(run.q[0], insertion.q_start)
    assert_allclose(run.time, PERIOD * np.arange(501), rtol=1e-15)
    for k in range(run.scenario.cycles - 1):
        step = pin.integrate(insertion.arm.model, run.q[k], PERIOD * run.v[k])
        assert np.array_equal(run.q[k + 1], step)
        from_angles = insertion.arm.configuration(run.angles[k])
        assert_allclose(from_angles, run.q[k], rtol=0, atol=1e-12)


def test_the_reference_is_the_scenarios_path_at_the_recorded_time() -> None:
    run = helix("lwa3")
    insertion, path = run.scenario.insertion(), run.scenario.path
    assert isinstance(path, ViewPath)
    for k in (0, 100, 500):
        command = path.command(k * PERIOD, insertion.tip_depth)
        assert np.array_equal(run.x_d[k], view_pose(insertion.x_rcm, command).x_d)


def test_the_velocity_is_the_controllers_answer_and_its_diagnostics_are_kept() -> None:
    run = helix("lwa3")
    insertion, path = run.scenario.insertion(), run.scenario.path
    assert isinstance(path, ViewPath)
    controller = make_controller("dual_quaternion", insertion, PERIOD)
    k = 250
    command = path.command(k * PERIOD, insertion.tip_depth)
    answer = controller.step(insertion.state(run.q[k]), view_pose(insertion.x_rcm, command))
    assert np.array_equal(run.v[k], answer.v)
    assert {name: values[k] for name, values in run.diagnostics.items()} == answer.diagnostics


def test_a_run_says_what_it_was_made_with() -> None:
    run = helix("lwa3")
    insertion = run.scenario.insertion()
    assert run.controller == "dual_quaternion"
    assert run.options == make_controller("dual-quaternion", insertion, PERIOD).options
    assert run.joints == insertion.arm.joints
    assert np.array_equal(run.lower, insertion.arm.lower)
    assert np.array_equal(run.upper, insertion.arm.upper)
    assert np.array_equal(run.velocity_limit, insertion.arm.velocity)
    assert np.array_equal(run.acceleration_limit, insertion.arm.acceleration)
    assert np.array_equal(run.jerk_limit, insertion.arm.jerk)
    assert run.assumed == ("jerk",)
    assert run.versions["python"] == platform.python_version()
    assert run.versions["pin"] == version("pin")
    assert run.versions["rcmqp"] == rcmqp.__version__
    assert (run.solve_time > 0.0).all()


def test_the_controller_is_reset_before_the_first_step() -> None:
    calls: list[str] = []

    class Witness(DualQuaternion):
        def reset(self) -> None:
            calls.append("reset")

        def step(self, state: ArmState, reference: Reference) -> Command:
            calls.append("step")
            return super().step(state, reference)

    scenario = load_scenario("conical_helix", duration=0.002)
    simulate(scenario, Witness(scenario.insertion(), scenario.period))
    assert calls == ["reset", "step", "step", "step"]


def test_progress_adds_up_to_the_number_of_cycles() -> None:
    scenario = load_scenario("conical_helix", duration=0.25, period=1e-3)
    steps: list[int] = []
    controller = make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    simulate(scenario, controller, progress=steps.append)
    assert steps == [100, 100, 51]
    assert sum(steps) == scenario.cycles


def test_two_processes_give_the_same_digest() -> None:
    program = (
        "from rcmqp import load_scenario, make_controller, simulate\n"
        "s = load_scenario('conical_helix', 'panda', duration=0.5)\n"
        "print(simulate(s, make_controller('dual_quaternion', s.insertion(), s.period)).digest)\n"
    )
    digests = [
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    here = ran(load_scenario("conical_helix", "panda", duration=0.5)).digest
    assert [process.stdout.strip() for process in digests] == [here, here]


def test_a_number_that_a_controller_gives_now_and_then_is_nan_in_between() -> None:
    class Seldom(DualQuaternion):
        def step(self, state: ArmState, reference: Reference) -> Command:
            k = len(steps)
            steps.append(k)
            return Command(
                super().step(state, reference).v, {"k": float(k)} if k in (1, 2) else {}
            )

    steps: list[int] = []
    scenario = load_scenario("conical_helix", duration=0.006)
    run = simulate(scenario, Seldom(scenario.insertion(), scenario.period))
    nan = np.nan
    assert_allclose(run.diagnostics["k"], [nan, 1.0, 2.0, nan, nan, nan, nan])


@pytest.mark.parametrize("size", [1, 7, 301])
def test_the_parts_of_a_run_make_the_same_run_whatever_their_sizes(size: int) -> None:
    """With a controller that stops at times, and a number that comes late."""

    class Moody(DualQuaternion):
        def step(self, state: ArmState, reference: Reference) -> Command:
            steps.append(len(steps))
            if steps[-1] % 11 == 10:
                return self.safe_stop(state, f"mood {steps[-1] % 2}")
            answer = super().step(state, reference)
            if steps[-1] > 100:
                answer.diagnostics["late"] = float(steps[-1])
            return answer

    scenario = load_scenario("conical_helix", duration=0.3, plant=CLUMSY, motion=BREATHING)
    controller = Moody(scenario.insertion(), scenario.period)
    steps: list[int] = []
    found = list(parts(scenario, controller, size=size))
    assert {len(part.time) for part in found[:-1]} <= {size}
    steps = []
    run = simulate(scenario, controller)
    assert len(run.stops) == 2
    assert np.isnan(run.diagnostics["late"][100])
    assert Run.joined(found, scenario.cycles).digest == run.digest
    assert Run.joined(run.parts(size), scenario.cycles).digest == run.digest


def test_a_controller_may_use_its_array_again() -> None:
    class Sparing(DualQuaternion):
        name = DualQuaternion.name

        def step(self, state: ArmState, reference: Reference) -> Command:
            answer = super().step(state, reference)
            kept[:] = answer.v
            numbers.update(answer.diagnostics)
            return Command(kept, numbers)

    scenario = load_scenario("conical_helix", duration=0.3)
    kept, numbers = np.zeros(7), dict[str, float]()
    run = simulate(scenario, Sparing(scenario.insertion(), scenario.period))
    assert run.digest == ran(scenario).digest


# A trocar that moves, joints that do not obey -----------------------------------------------


BREATHING = Breathing(amplitude=0.02, rate=1.0, direction=(1.0, 1.0, 1.0), n=1)
CLUMSY = Servo(0.01, 3, 2**14, 1e-4, velocity_saturation=True)


def test_errors_and_depth_are_counted_from_where_the_trocar_is() -> None:
    run = ran(load_scenario("conical_helix", duration=0.5, motion=BREATHING))
    tip_depth = run.scenario.insertion().tip_depth
    assert np.array_equal(run.pivot, run.scenario.pivots())
    assert np.ptp(run.pivot[:, 2]) > 0.01
    for k in range(0, 501, 50):
        oMe, pivot = to_se3(run.x[k]), run.pivot[k]
        tip = oMe.act(np.array([0.0, 0.0, tip_depth]))
        assert_allclose(run.rcm_error[k], shaft_distance(oMe, pivot), rtol=0, atol=1e-12)
        assert_allclose(run.depth[k], oMe.rotation[:, 2] @ (tip - pivot), rtol=0, atol=1e-12)
        assert shaft_distance(to_se3(run.x_d[k]), pivot) < 1e-14


def test_the_controller_sees_the_measured_joints_and_its_last_command_and_the_record_has_all() -> (
    None
):
    seen: list[ArmState] = []

    class Witness(DualQuaternion):
        def step(self, state: ArmState, reference: Reference) -> Command:
            seen.append(state)
            return super().step(state, reference)

    scenario = load_scenario("conical_helix", "kinova", duration=0.1, plant=CLUMSY, seed=5)
    insertion = scenario.insertion()
    run = simulate(scenario, Witness(insertion, scenario.period))
    drive = CLUMSY.start(insertion.arm, insertion.q_start, scenario.period, 5)
    for k, state in enumerate(seen):
        q, v = drive.measure()
        assert np.array_equal(state.q, q)
        assert np.array_equal(state.v, run.v[k - 1] if k else drive.v)
        assert np.array_equal(run.q_measured[k], q)
        assert np.array_equal(run.v_measured[k], v)
        assert np.array_equal(run.q[k], drive.q)
        assert np.array_equal(run.v_actual[k], drive.v)
        assert_allclose(run.x[k], insertion.state(drive.q).x, rtol=0, atol=0)
        assert_allclose(run.angles[k], insertion.arm.angles(drive.q), rtol=0, atol=0)
        drive.step(run.v[k])
    assert np.abs(run.q_measured - run.q).max() > 1e-4


def test_on_the_ideal_plant_the_state_holds_the_velocity_commanded_last() -> None:
    run = helix("lwa3")
    assert np.array_equal(run.q_measured, run.q)
    assert np.array_equal(run.v_measured, run.v_actual)
    assert not run.v_measured[0].any()
    assert np.array_equal(run.v_measured[1:], run.v[:-1])


def test_the_noise_of_a_plant_is_that_of_the_scenarios_seed() -> None:
    runs = [
        ran(load_scenario("conical_helix", duration=0.05, plant=CLUMSY, seed=seed))
        for seed in (1, 1, 2)
    ]
    assert np.array_equal(runs[0].q, runs[1].q)
    assert runs[0].digest == runs[1].digest
    assert not np.array_equal(runs[0].q, runs[2].q)


# The planner in the loop -------------------------------------------------------------------


@pytest.mark.parametrize("arm", ["lwa3", "meka_a2"])
def test_the_planner_keeps_the_rcm_where_jumps_do_not(arm: str) -> None:
    scenario = load_scenario("view_steps", arm, period=PERIOD)
    planned = compute_metrics(ran(scenario))
    jumped = compute_metrics(ran(dataclasses.replace(scenario, planner_time=None)))
    assert planned.rcm_max_mm < 0.05
    assert planned.speed_ratio_max <= 1.0
    assert jumped.rcm_max_mm > 20.0 * planned.rcm_max_mm
    assert jumped.speed_ratio_max > 1.0


def test_the_planner_keeps_the_rcm_on_a_trocar_that_moves() -> None:
    scenario = load_scenario("view_steps", period=PERIOD, motion=BREATHING, duration=6.0)
    moved = compute_metrics(ran(scenario, feed_forward=True))
    still = compute_metrics(ran(dataclasses.replace(scenario, motion=Still()), feed_forward=True))
    a = 0.01 * (2 * math.pi) ** 2  # a sine of amplitude 1 cm at 1 Hz
    assert moved.rcm_max_mm < still.rcm_max_mm + 1e3 * a * PERIOD / (2 * 60.0)


def test_the_planned_reference_never_leaves_the_trocar_and_arrives() -> None:
    run = ran(load_scenario("view_steps", period=PERIOD))
    pivot = np.array(run.scenario.trocar.pivot)
    distances = [shaft_distance(to_se3(x_d), pivot) for x_d in run.x_d]
    assert max(distances) < 1e-14
    insertion, path = run.scenario.insertion(), run.scenario.path
    assert isinstance(path, ViewPath)
    last_view = view_pose(insertion.x_rcm, path.command(path.duration, insertion.tip_depth))
    assert_allclose(run.tip_d[-1], insertion.tip(last_view.x_d), rtol=0, atol=1e-14)
    assert run.tip_error[-1] < 1e-6
