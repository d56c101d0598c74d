"""The task of experiment B, and runs that end when it is done."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import Run, Scenario, compute_metrics, load_scenario, make_controller, simulate
from rcmqp.maths import dualquaternion as dq
from rcmqp.references.operators import CameraTrial, Operator
from rcmqp.references.operators.camera_task import CameraTask, reached
from rcmqp.world.obstacles import Sphere, clearance

QUICK = Operator(recognition=0.0)


def quick(arm: str = "panda", period: float = 0.02, seed: int = 0) -> Scenario:
    """The task by somebody who need not look."""
    scenario = load_scenario("camera_task", arm, period=period, seed=seed)
    return dataclasses.replace(scenario, path=CameraTrial(QUICK))


def ran(scenario: Scenario, **options: float) -> Run:
    made = make_controller("dual_quaternion", scenario.insertion(), scenario.period, **options)
    return simulate(scenario, made)


def test_the_scene_is_the_papers_where_the_paper_says_how_it_is() -> None:
    task = CameraTask()
    corners = np.array([sphere.centre for sphere in task.spheres])
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    assert_allclose(sides, 0.05, rtol=0, atol=1e-15)
    assert_allclose(np.ptp(corners[:, 2]), 0.0, atol=0)
    assert len({sphere.radius for sphere in task.spheres}) == 1
    assert task.obstacle.radius > task.spheres[0].radius
    assert task.tolerance == 1e-3
    middle = np.array(task.targets[1:3]).mean(axis=0)
    assert_allclose(task.obstacle.centre, middle, rtol=0, atol=1e-15)


def test_the_scenarios_obstacle_is_the_tasks_in_the_world() -> None:
    scenario = load_scenario("camera_task", "meka_a2")
    start = dq.to_se3(scenario.insertion().x_rcm)
    (obstacle,) = scenario.obstacles
    assert_allclose(
        start.actInv(np.array(obstacle.centre)), CameraTask().obstacle.centre, atol=1e-15
    )


def test_targets_are_reached_in_their_order_one_at_a_time() -> None:
    times = np.arange(6.0)
    x = np.array([0.0, 2.0, 1.0, 1.0, 2.0, 3.0])
    tip = np.column_stack([x, 0 * x, 0 * x])
    targets = np.array([[1.0, 0, 0], [1.0, 0, 0], [2.05, 0, 0], [9.0, 0, 0]])
    assert_allclose(reached(times, tip, targets, 0.1), [2.0, 3.0, 4.0, np.nan])
    assert np.isnan(reached(times, tip, targets[3:], 0.1)).all()


def test_the_distance_to_a_sphere_is_that_of_the_nearest_point_of_the_shaft() -> None:
    rng = np.random.default_rng(7)
    tip, mount = rng.normal(size=(2, 50, 3))
    sphere = Sphere(tuple(rng.normal(size=3)), 0.3)
    part = np.linspace(0.0, 1.0, 20001)[:, None, None]
    points = tip + part * (mount - tip)
    least = np.linalg.norm(points - np.array(sphere.centre), axis=-1).min(axis=0)
    assert_allclose(clearance(tip, mount, sphere), least - 0.3, rtol=0, atol=1e-6)


@pytest.mark.parametrize("arm", ["lwa3", "meka_a2", "panda"])
def test_a_run_ends_when_the_last_view_is_found(arm: str) -> None:
    run = ran(quick(arm))
    task, pivot = CameraTask(), np.array(run.scenario.trocar.pivot)
    targets = pivot + [run.insertion().from_start(target) for target in task.targets]
    times = reached(run.time, run.tip, targets, task.tolerance)
    assert times[-1] == run.time[-1] < 60.0
    assert {
        len(values) for values in run.arrays().values() if values.ndim and len(values) > 7
    } == {len(run.time)}
    assert {len(values) for values in run.diagnostics.values()} == {len(run.time)}
    found = compute_metrics(run)
    assert found.rcm_max_mm < 0.5
    assert found.limit_margin_min_rad > 0.0
    assert Scenario.from_json(run.scenario.to_json()) == run.scenario


def test_the_operator_answers_the_arm_and_not_the_reference() -> None:
    """A slow arm is where the operator sees it, and is given other views."""
    short = dataclasses.replace(quick(), duration=8.0)
    run, slow = ran(short), ran(short, gain=5.0)
    n = min(len(run.time), len(slow.time))
    assert np.array_equal(run.x_d[:10], slow.x_d[:10])
    assert not np.array_equal(run.x_d[:n], slow.x_d[:n])
    assert np.array_equal(ran(short).x_d, run.x_d)


def test_a_run_that_takes_too_long_ends_at_its_time() -> None:
    scenario = dataclasses.replace(quick(), duration=1.0)
    assert len(ran(scenario).time) == scenario.cycles


def test_who_sends_no_states_gets_the_views_for_a_perfect_arm() -> None:
    scenario = quick()
    insertion = scenario.insertion()
    references = list(scenario.references(insertion))
    tip = insertion.tip(references[-1].x_d)
    last = np.array(insertion.trocar.pivot) + insertion.from_start(CameraTask().targets[-1])
    assert np.linalg.norm(tip - last) <= CameraTask().tolerance
    assert len(references) < scenario.cycles
