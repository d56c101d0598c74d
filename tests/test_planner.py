from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, derivative, random_placement, shaft_distance
from oracles.planner import constrain, plan

from rcmqp import Reference, ViewCommand, view_pose
from rcmqp.errors import InvalidCommand, OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.planner import FAR_ANGLE, FAR_DEPTH, Planner
from rcmqp.references.view import carried

PERIOD = 1e-3
NEAR_VIEWS = ViewCommand(0.1, -0.2, 0.3, 0.02), ViewCommand(-0.1, 0.1, -0.1, 0.05)
FAR_VIEWS = (  # 150 degrees apart, and 10 cm in depth
    ViewCommand(math.radians(-75), 0.0, 0.0, -0.05),
    ViewCommand(math.radians(75), 0.0, 0.0, 0.05),
)
VIEWS = pytest.mark.parametrize("views", [NEAR_VIEWS, FAR_VIEWS], ids=["near", "far"])


def random_rcm() -> Array:
    return dq.from_se3(random_placement(np.random.default_rng(7)))


def turns_and_dives(x_rcm: Array, poses: Array) -> tuple[Array, Array]:
    """Turn [rad] and dive [m] from each pose to the next one, by Pinocchio."""
    placements = [dq.to_se3(x) for x in poses]
    pivot = dq.to_se3(x_rcm).translation
    depths = [(M.translation - pivot) @ M.rotation[:, 2] for M in placements]
    turns = [pin.log3(M.rotation.T @ N.rotation) for M, N in itertools.pairwise(placements)]
    return np.linalg.norm(turns, axis=1), np.diff(depths)


# plan() ------------------------------------------------------------------------------------


@VIEWS
@pytest.mark.parametrize("points", range(1, 51))
def test_plan_goes_from_view_to_view_in_equal_parts_through_the_rcm(
    points: int, views: tuple[ViewCommand, ViewCommand]
) -> None:
    x_rcm = random_rcm()
    start, end = (view_pose(x_rcm, view).x_d for view in views)
    poses = plan(x_rcm, start, end, points)
    assert poses.shape == (points + 2, 8)
    assert_allclose(poses[0], start, rtol=0, atol=1e-14)
    assert_allclose(poses[-1], end, rtol=0, atol=1e-14)
    pivot = dq.translation(x_rcm)
    assert max(shaft_distance(dq.to_se3(x), pivot) for x in poses) < 1e-12
    turns, dives = turns_and_dives(x_rcm, poses)
    whole = dq.angle_between(start, end) / (points + 1)  # no part is longer: the short way
    assert_allclose(turns, whole, rtol=0, atol=1e-13)
    assert_allclose(dives, (views[1].t_z - views[0].t_z) / (points + 1), rtol=0, atol=1e-14)


@VIEWS
def test_plan_is_the_same_for_either_sign_of_its_ends(
    views: tuple[ViewCommand, ViewCommand],
) -> None:
    x_rcm = random_rcm()
    start, end = (view_pose(x_rcm, view).x_d for view in views)
    expected = [dq.to_se3(x).homogeneous for x in plan(x_rcm, start, end, 9)]
    for signs in ((1, -1), (-1, 1), (-1, -1)):
        poses = plan(x_rcm, signs[0] * start, signs[1] * end, 9)
        found = [dq.to_se3(x).homogeneous for x in poses]
        assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_plan_follows_equations_9_to_11() -> None:
    rng = np.random.default_rng(7)
    oMrcm, N = random_placement(rng), 6
    R_l, R_d = (pin.exp3(rng.normal(size=3)) for _ in range(2))
    t_l, t_d = 0.02, -0.03
    start, end = (
        oMrcm * pin.SE3(R, np.zeros(3)) * pin.SE3(np.eye(3), np.array([0.0, 0.0, t]))
        for R, t in ((R_l, t_l), (R_d, t_d))
    )
    poses = plan(dq.from_se3(oMrcm), dq.from_se3(start), dq.from_se3(end), N)
    r_inc, t_inc = pin.exp3(pin.log3(R_l.T @ R_d) / (N + 1)), (t_d - t_l) / (N + 1)
    for m, x in enumerate(poses):
        R = R_l @ np.linalg.matrix_power(r_inc, m)
        shift = pin.SE3(np.eye(3), np.array([0.0, 0.0, t_l + m * t_inc]))
        expected = oMrcm * pin.SE3(R, np.zeros(3)) * shift
        assert_allclose(dq.to_se3(x).homogeneous, expected.homogeneous, rtol=0, atol=1e-14)


def test_a_pose_off_the_rcm_is_brought_to_the_nearest_on_it() -> None:
    rng = np.random.default_rng(7)
    oMrcm = random_placement(rng)
    x_rcm = dq.from_se3(oMrcm)
    oMe = oMrcm * pin.exp6(rng.normal(scale=0.05, size=6))  # its shaft misses the pivot
    assert shaft_distance(oMe, oMrcm.translation) > 0.01
    x, end = dq.from_se3(oMe), view_pose(x_rcm, NEAR_VIEWS[0]).x_d
    r, t_z = constrain(x_rcm, x)
    assert_allclose(
        dq.to_se3(dq.mul(x_rcm, dq.from_rotation(r))).rotation, oMe.rotation, rtol=0, atol=1e-14
    )
    along = oMe.rotation[:, 2] @ (oMe.translation - oMrcm.translation)
    assert t_z == pytest.approx(along, abs=1e-15)
    for poses, index in ((plan(x_rcm, x, end, 5), 0), (plan(x_rcm, end, x, 5), -1)):
        nearest = dq.to_se3(poses[index])
        assert_allclose(nearest.rotation, oMe.rotation, rtol=0, atol=1e-14)
        assert shaft_distance(nearest, oMrcm.translation) < 1e-14
        lateral = nearest.rotation.T @ (oMe.translation - nearest.translation)
        assert lateral[2] == pytest.approx(0.0, abs=1e-14)
    assert max(shaft_distance(dq.to_se3(x), oMrcm.translation) for x in poses) < 1e-12


@pytest.mark.parametrize("points", [0, -3, 1.5])
def test_points_are_a_whole_number_of_at_least_one(points: int) -> None:
    message = rf"points = {points}, it must be a whole number of at least 1"
    with pytest.raises(OptionError, match=message):
        plan(dq.IDENTITY, dq.IDENTITY, dq.IDENTITY, points)
    with pytest.raises(OptionError, match=message):
        Planner(dq.IDENTITY, points, PERIOD)


@pytest.mark.parametrize("which", ["x_rcm", "x", "x_d"])
def test_plan_refuses_what_is_no_pose(which: str) -> None:
    poses = {"x_rcm": dq.IDENTITY, "x": dq.IDENTITY, "x_d": dq.IDENTITY}
    with pytest.raises(InvalidCommand, match=f"{which} is not a pose"):
        plan(**{**poses, which: 1.1 * dq.IDENTITY}, points=3)
    with pytest.raises(InvalidCommand, match="x_rcm is not a pose"):
        Planner(1.1 * dq.IDENTITY, 3, PERIOD)


# Planner -----------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("points", [1, 2, 7, 50])
def test_planner_feeds_the_plan_of_a_far_view_one_part_a_cycle(points: int, sign: float) -> None:
    x_rcm = random_rcm()
    view = view_pose(x_rcm, FAR_VIEWS[1])
    target = Reference(sign * view.x_d, view.x_d_dot, view.pivot, view.pivot_dot)
    planner = Planner(x_rcm, points, PERIOD)
    fed = [planner.step(target).x_d for _ in range(points + 1)]
    assert_allclose(fed, plan(x_rcm, x_rcm, target.x_d, points)[1:], rtol=0, atol=1e-13)
    assert planner.step(target) is target


def test_planner_lets_near_references_through_untouched() -> None:
    x_rcm = random_rcm()
    planner, step = Planner(x_rcm, 20, PERIOD), 0.99 * FAR_ANGLE
    for i in range(1, 30):
        command = ViewCommand(alpha=i * step, t_z=i * 0.99 * FAR_DEPTH)
        reference = view_pose(x_rcm, command)
        assert planner.step(reference) is reference


@pytest.mark.parametrize(
    "command",
    [ViewCommand(beta=1.01 * FAR_ANGLE), ViewCommand(t_z=-1.01 * FAR_DEPTH)],
    ids=["turn", "dive"],
)
def test_planner_divides_what_is_just_beyond_near(command: ViewCommand) -> None:
    x_rcm = random_rcm()
    target = view_pose(x_rcm, command)
    fed = [Planner(x_rcm, 1, PERIOD).step(target).x_d]
    assert_allclose(fed, plan(x_rcm, x_rcm, target.x_d, 1)[1:2], rtol=0, atol=1e-14)


def test_planner_meets_a_moving_target_and_then_lets_it_through() -> None:
    x_rcm, N = random_rcm(), 30
    pivot, planner = dq.translation(x_rcm), Planner(x_rcm, N, PERIOD)

    def target(cycle: int) -> Reference:
        t = cycle * PERIOD
        return view_pose(x_rcm, ViewCommand(0.6 + 0.5 * t, 0.2 * t, t, 0.05 - 0.3 * t))

    fed = [planner.step(target(cycle)) for cycle in range(N + 1)]
    assert_allclose(fed[-1].x_d, target(N).x_d, rtol=0, atol=1e-14)
    assert max(shaft_distance(dq.to_se3(f.x_d), pivot) for f in fed) < 1e-12
    turns, dives = turns_and_dives(x_rcm, np.array([x_rcm, *(f.x_d for f in fed)]))
    assert turns.max() < 1.2 * turns[0]
    assert np.abs(dives).max() < 1.2 * np.abs(dives[0])
    after = target(N + 1)
    assert planner.step(after) is after


def test_planner_never_jumps_when_the_target_jumps_on_the_way() -> None:
    x_rcm, N = random_rcm(), 20
    planner = Planner(x_rcm, N, PERIOD)
    targets = [view_pose(x_rcm, ViewCommand(alpha=alpha)) for alpha in (0.5, -0.5)]
    fed = [planner.step(targets[0]).x_d for _ in range(N)]  # all but the last part
    fed += [planner.step(targets[1]).x_d for _ in range(3)]
    turns, _ = turns_and_dives(x_rcm, np.array([x_rcm, *fed]))
    assert turns.max() < 1.01 / (N + 1)  # the longest way there is, 1 rad, in N + 1 parts


def test_planner_never_jumps_when_the_target_goes_deeper_on_the_way() -> None:
    x_rcm, N = random_rcm(), 20
    planner = Planner(x_rcm, N, PERIOD)
    targets = [view_pose(x_rcm, ViewCommand(t_z=t_z)) for t_z in (0.02, -0.02)]
    fed = [planner.step(targets[0]).x_d for _ in range(N)]  # all but the last part
    fed += [planner.step(targets[1]).x_d for _ in range(3)]
    _, dives = turns_and_dives(x_rcm, np.array([x_rcm, *fed]))
    assert np.abs(dives).max() < 0.0404 / (N + 1)  # the longest way there is, in N + 1 parts


@VIEWS
def test_x_d_dot_is_the_velocity_of_the_part_to_come(
    views: tuple[ViewCommand, ViewCommand],
) -> None:
    rng = np.random.default_rng(7)
    oMrcm, N = random_placement(rng), 10
    x_rcm = dq.from_se3(oMrcm)
    planner, target = Planner(x_rcm, N, PERIOD), view_pose(x_rcm, views[1])
    turn = pin.log3(oMrcm.rotation.T @ dq.to_se3(target.x_d).rotation) / (N + 1)
    for part in range(1, N + 2):
        fed = planner.step(target)

        def later(cycles: float, part: int = part, like: Array = fed.x_d) -> Array:
            R = oMrcm.rotation @ pin.exp3((part + cycles) * turn)
            depth = (part + cycles) * views[1].t_z / (N + 1)
            x = dq.from_se3(pin.SE3(R, oMrcm.translation + depth * R[:, 2]))
            return dq.align_sign(x, like)

        assert_allclose(later(0.0), fed.x_d, rtol=0, atol=1e-13)
        expected = derivative(later) if part <= N else np.zeros(8)  # the last part is the view
        assert_allclose(PERIOD * fed.x_d_dot, expected, rtol=0, atol=1e-11)


def test_a_trocar_that_moves_carries_the_plan_along() -> None:
    """Ten centimetres in the course of a plan: far, but not as the trocar sees it."""
    x_rcm, N = random_rcm(), 30
    still, moving = Planner(x_rcm, N, PERIOD), Planner(x_rcm, N, PERIOD)
    velocity = np.array([2.0, -1.0, 3.0])
    for cycle in range(N + 5):
        offset = cycle * PERIOD * velocity
        target = view_pose(carried(x_rcm, offset), FAR_VIEWS[1], velocity)
        plain, fed = still.step(view_pose(x_rcm, FAR_VIEWS[1])), moving.step(target)
        expected = pin.SE3(np.eye(3), offset) * dq.to_se3(plain.x_d)
        assert_allclose(dq.to_se3(fed.x_d).homogeneous, expected.homogeneous, rtol=0, atol=1e-13)
        assert_allclose(fed.pivot, dq.translation(x_rcm) + offset, rtol=0, atol=1e-15)
        assert np.array_equal(fed.pivot_dot, velocity)
        if cycle > N:
            assert fed is target


def test_x_d_dot_of_a_plan_has_the_trocars_velocity_in_it() -> None:
    x_rcm, velocity = random_rcm(), np.array([0.02, -0.01, 0.03])
    still, moving = (Planner(x_rcm, 10, PERIOD) for _ in range(2))
    plain = still.step(view_pose(x_rcm, FAR_VIEWS[1]))
    fed = moving.step(view_pose(x_rcm, FAR_VIEWS[1], velocity))
    r = dq.P(plain.x_d)
    carried_on = [*np.zeros(4), *(0.5 * dq.quaternion_mul([0.0, *velocity], r))]
    assert_allclose(fed.x_d_dot, plain.x_d_dot + carried_on, rtol=0, atol=1e-15)


@pytest.mark.parametrize("points", [1, 7])
def test_a_measured_pose_is_where_a_plan_begins_and_nothing_else(points: int) -> None:
    rng, x_rcm = np.random.default_rng(7), random_rcm()
    planner, view = Planner(x_rcm, points, PERIOD), view_pose(x_rcm, FAR_VIEWS[1])
    measured = dq.from_se3(dq.to_se3(x_rcm) * pin.exp6(rng.normal(scale=0.02, size=6)))
    elsewhere = dq.from_se3(dq.to_se3(x_rcm) * pin.exp6(rng.normal(scale=0.02, size=6)))
    fed = [planner.step(view, x).x_d for x in (measured, *[elsewhere] * points)]
    expected = plan(x_rcm, measured, view.x_d, points)[1:]
    assert_allclose(fed, expected, rtol=0, atol=1e-13)
    assert np.abs(expected[0] - plan(x_rcm, x_rcm, view.x_d, points)[1]).max() > 1e-3
    assert planner.step(view, elsewhere) is view
    near = view_pose(x_rcm, dataclasses.replace(FAR_VIEWS[1], alpha=FAR_VIEWS[1].alpha + 1e-3))
    assert planner.step(near, elsewhere) is near


def test_a_plan_begins_at_the_measured_pose_as_a_moved_trocar_sees_it() -> None:
    rng, x_rcm, offset = np.random.default_rng(7), random_rcm(), np.array([0.3, -0.2, 0.1])
    measured = dq.from_se3(dq.to_se3(x_rcm) * pin.exp6(rng.normal(scale=0.02, size=6)))
    still, moved = (Planner(x_rcm, 9, PERIOD) for _ in range(2))
    plain = still.step(view_pose(x_rcm, FAR_VIEWS[1]), measured)
    target = view_pose(carried(x_rcm, offset), FAR_VIEWS[1])
    fed = moved.step(target, dq.mul(dq.from_translation(offset), measured))
    expected = pin.SE3(np.eye(3), offset) * dq.to_se3(plain.x_d)
    assert_allclose(dq.to_se3(fed.x_d).homogeneous, expected.homogeneous, rtol=0, atol=1e-13)


def test_a_measured_pose_that_is_not_finite_is_not_used() -> None:
    x_rcm = random_rcm()
    view = view_pose(x_rcm, FAR_VIEWS[0])
    plain, lost = (Planner(x_rcm, 9, PERIOD).step(view, x) for x in (None, np.full(8, np.nan)))
    assert np.array_equal(plain.x_d, lost.x_d)


def test_a_planner_that_was_reset_is_as_new() -> None:
    x_rcm = random_rcm()
    planner, target = Planner(x_rcm, 9, PERIOD), view_pose(x_rcm, FAR_VIEWS[0])
    first = [planner.step(target).x_d for _ in range(4)]  # on the way
    planner.reset()
    assert np.array_equal([planner.step(target).x_d for _ in range(4)], first)
    planner.reset()
    near = view_pose(x_rcm, ViewCommand(alpha=0.5 * FAR_ANGLE))
    assert planner.step(near) is near


@pytest.mark.parametrize(
    ("name", "by"),
    [("x_d", np.nan), ("pivot", np.nan), ("pivot_dot", np.nan), ("x_d", 0.0), ("x_d", 1.00001)],
)
def test_a_reference_that_is_no_pose_leaves_the_plan_where_it_was(name: str, by: float) -> None:
    x_rcm = random_rcm()
    far = view_pose(x_rcm, FAR_VIEWS[0])
    lost = dataclasses.replace(far, **{name: by * getattr(far, name)})
    planner, undisturbed = (Planner(x_rcm, 9, PERIOD) for _ in range(2))
    for cycle in range(15):
        if cycle in (0, 4, 13):
            assert planner.step(lost) is lost
        assert_allclose(planner.step(far).x_d, undisturbed.step(far).x_d, rtol=0, atol=0)
