"""What simulated operators see, and what they make of it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from at_the_device import QUICK, T, insertion, pose, steering
from helpers import assert_allclose

from rcmqp.maths import dualquaternion as dq
from rcmqp.references.operators import CameraTrial, Operator
from rcmqp.references.operators.camera_task import CameraTask
from rcmqp.references.operators.hand import Submovement
from rcmqp.references.operators.perception import Eyes
from rcmqp.references.view import view_pose


def test_the_tip_is_where_pinocchio_has_it() -> None:
    rng = np.random.default_rng(7)
    ins = insertion()
    eyes = Eyes(Operator(), CameraTask(), ins, rng)
    start = dq.to_se3(ins.x_rcm)
    for _ in range(5):
        x = dq.mul(
            ins.x_rcm, dq.exp(np.array([0.0, *rng.normal(0, 0.3, 3), 0, *rng.normal(0, 0.1, 3)]))
        )
        tip = dq.to_se3(x).act(np.array([0.0, 0.0, ins.tip_depth]))
        assert_allclose(eyes.tip(x), start.actInv(tip), rtol=0, atol=1e-14)


def test_distances_are_seen_late_in_the_image_and_worst_in_depth() -> None:
    operator, task = Operator(depth_bias=0.01), CameraTask()
    eyes = Eyes(operator, task, insertion(), np.random.default_rng(7))
    early, late = (0.01, 0.005, 0.10), (0.02, -0.01, 0.09)
    eyes.look(0.0, pose(early))
    eyes.look(0.1, pose(late))
    goal, seen_by = task.targets[2], task.spheres[2].centre
    placement = dq.to_se3(dq.mul(dq.conj(insertion().x_rcm), pose(early)))
    now = 0.1 + operator.delay
    away = placement.rotation.T @ (np.array(goal) - early)
    seen = np.array(
        [eyes.perceive(0.1 + operator.delay - 1e-3, goal, seen_by) for _ in range(4000)]
    )
    assert_allclose(seen.mean(axis=0), away, rtol=0, atol=3e-4)
    lateral = operator.floor_lateral + operator.weber_lateral * np.abs(away[:2])
    deep = operator.floor_depth + operator.weber_depth * abs(away[2])
    deep = math.hypot(deep + operator.weber_cross * np.linalg.norm(away), operator.depth_bias)
    assert_allclose(seen.std(axis=0), [*lateral, deep], rtol=0.05)
    assert deep > 3.0 * lateral.max()
    later = eyes.perceive(now + 1e-3, goal, seen_by)
    assert later is not None
    placement = dq.to_se3(dq.mul(dq.conj(insertion().x_rcm), pose(late)))
    assert np.linalg.norm(placement.rotation.T @ (np.array(goal) - late) - later) < 0.03
    assert_allclose(
        eyes.place(goal, later), np.array(goal) - placement.rotation @ later, atol=1e-12
    )


def test_what_is_not_in_the_image_is_remembered_inexactly_and_the_same_all_the_way() -> None:
    """Beside the nearest sphere that is; the first image shows all, and nothing is off in it."""
    task = CameraTask()
    exact = dataclasses.replace(
        Operator(), floor_lateral=0.0, floor_depth=0.0, depth_bias=0.0, weber_lateral=0.0
    )
    exact = dataclasses.replace(exact, weber_depth=0.0, weber_cross=0.0, memory=0.2)
    eyes = Eyes(exact, task, insertion(), np.random.default_rng(7))
    goal, mark = task.targets[2], task.spheres[2].centre
    close = pose(task.targets[0])
    eyes.look(0.0, insertion().x_rcm)
    shown = eyes.perceive(0.3, goal, mark)
    assert shown is not None
    assert_allclose(eyes.place(goal, shown), (0.0, 0.0, insertion().tip_depth), atol=1e-12)
    eyes.look(1.0, close)  # a close-up of the first sphere: the others are out of sight
    off = []
    for _ in range(400):
        eyes.remember()
        first, second = (eyes.perceive(2.0, goal, mark) for _ in range(2))
        assert first is not None
        assert first == second
        off.append(np.subtract(eyes.place(goal, first), task.targets[0]))
    beside = math.dist(mark, task.spheres[0].centre)
    assert_allclose(np.std(off, axis=0), 0.2 * beside, rtol=0.12)


@pytest.mark.parametrize("period", [1e-3, 4e-3, 8e-3])
def test_the_camera_has_thirty_images_a_second_whatever_the_period(period: float) -> None:
    eyes = Eyes(Operator(), CameraTask(), insertion(), np.random.default_rng(7))
    for k in range(round(2.0 / period)):
        eyes.look(k * period, insertion().x_rcm)
    assert len(eyes._frames) == 60


def test_a_movement_ends_short_and_scattered_as_its_muscles_have_it() -> None:
    operator = dataclasses.replace(QUICK, gain=0.8, motor_noise=0.1)
    away, ends = np.array([0.02, -0.01, 0.03]), []
    asking = steering(CameraTrial(operator))
    asking._eyes.perceive = lambda *_: tuple(away)  # type: ignore[method-assign]
    for _ in range(3000):
        asking._move = Submovement((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0, 1.0)
        asking._decide(2.0)
        ends.append(asking._move.way)
    assert_allclose(np.mean(ends, axis=0), 0.8 * away, rtol=0, atol=2e-4)
    assert_allclose(np.std(ends, axis=0), 0.1 * 0.8 * np.linalg.norm(away), rtol=0.06)


def test_the_point_beside_the_obstacle_is_passed_when_it_seems_near_and_the_way_clear() -> None:
    """Where the camera really is makes no difference: it has not moved at all here."""
    for seems, clear in ((0.0075, True), (0.0085, False)):
        trial = CameraTrial(QUICK)
        asking = steering(trial)
        asking.objective = 2
        asking._start_objective(0.0, trial.task.targets[1])
        assert asking._via is not None
        asking._eyes.look(0.0, pose(trial.task.targets[1]))
        asking._eyes.perceive = lambda *_, z=-seems: (0.0, 0.0, z)  # type: ignore[method-assign]
        asking._decide(1.0)
        assert (asking._via is None) is clear


def test_an_image_without_spheres_tells_nothing_and_the_hand_goes_back() -> None:
    task = CameraTask()
    eyes = Eyes(Operator(), task, insertion(), np.random.default_rng(7))
    eyes.look(0.0, pose((0.0, 0.0, 0.16)))  # past where it sees any
    assert eyes.perceive(1.0, task.targets[0], task.spheres[0].centre) is None
    asking, blind = steering(CameraTrial(QUICK)), pose((0.0, 0.0, 0.16))
    ways, moves = [], set()
    for k in range(200):
        asking.command(k * T, insertion().x_rcm if k < 8 else blind)
        if asking._move not in moves:
            moves.add(asking._move)
            ways.append(np.array(asking._move.way))
    assert np.linalg.norm(ways[1]) > 0.02
    assert ways[2] @ ways[1] < -0.4 * ways[1] @ ways[1]  # half-way back to the start
    assert np.linalg.norm(ways[1] + ways[2] + ways[3]) < 0.35 * np.linalg.norm(ways[1])


def test_the_hand_is_never_meant_further_out_of_the_patient_than_where_it_started() -> None:
    unsure = dataclasses.replace(QUICK, floor_depth=6e-3, weber_depth=1.0, interval=0.05)
    asking, x, outmost = steering(CameraTrial(unsure)), pose((-0.02, -0.02, 0.142)), 0.0
    moves = set()
    for k in range(2000):
        asking.command(k * T, x)
        moves.add(asking._move)
        outmost = min(outmost, asking._move.start[2] + asking._move.way[2])
    assert outmost > -1e-12
    assert sum(move.way[2] < 0.0 for move in moves) > 10  # who sees it too far in pulls back


def test_what_the_arm_does_is_answered_after_the_delay_and_not_before() -> None:
    """Two arms that part ways at t = 0.5 s: the hand knows from 0.5 s + delay on."""
    operator = dataclasses.replace(QUICK, delay=0.3, interval=0.01, shortest=0.02, speed=10.0)
    views = []
    for off in (0.0, 0.004):
        asking, x, asked = steering(CameraTrial(operator)), insertion().x_rcm, []
        for k in range(150):
            view = asking.command(k * T, x)
            assert view is not None
            asked.append((view.alpha, view.beta, view.t_z))
            x = view_pose(insertion().x_rcm, view).x_d
            if k * T >= 0.5 - 1e-9:
                x = dq.mul(x, dq.from_translation([0.0, 0.0, off]))
        views.append(np.array(asked))
    same = (views[0] == views[1]).all(axis=1)
    first = int(np.argmin(same)) * T
    assert same[: round(0.78 / T)].all()
    assert 0.8 <= first < 1.5
