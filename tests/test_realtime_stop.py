"""The safe stop of the real-time loop."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fake_robot import TICK, Arm, Clock, Spoilt, T, careful, run, view
from helpers import across

import rcmqp
from rcmqp.controllers.braking import braking, nearest
from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp import Hierarchy
from rcmqp.qp.levels import Bounds, Level
from rcmqp.realtime.run import Stamped
from rcmqp.world.insertion import rcm_error


def stopped(insertion: rcmqp.Insertion, angles: Array, v: Array) -> Array:
    return np.array(list(braking(insertion, angles, v, T, np.array(insertion.trocar.pivot))))


def test_braking_slows_all_joints_in_proportion_and_as_fast_as_they_may(
    insertion: rcmqp.Insertion,
) -> None:
    arm, v = insertion.arm, np.array([0.3, -0.2, 0.1, 0.05, 0.0, -0.4, 0.2])
    found = stopped(insertion, np.full(7, np.nan), v)  # there is no trocar to stay on
    shares = found[:, 0] / v[0]
    np.testing.assert_allclose(found, shares[:, None] * v, rtol=0, atol=1e-15)
    fastest = np.max(np.abs(np.diff(found, axis=0, prepend=v[None])) / (arm.acceleration * T))
    assert 0.95 < fastest <= 1.0 + 1e-9
    assert 0 <= len(found) - np.ceil(np.max(np.abs(v) / (arm.acceleration * T))) <= 4  # jerk
    assert (found[-1] == 0.0).all()


def test_braking_keeps_the_shaft_on_the_trocar_at_full_speed(insertion: rcmqp.Insertion) -> None:
    """Where slowing down in proportion leaves it by millimetres."""
    arm, controller = insertion.arm, rcmqp.make_controller("hierarchical_qp", insertion, T)
    reference = rcmqp.view_pose(insertion.x_rcm, rcmqp.ViewCommand(alpha=1.0, t_z=0.05))
    q, v, a = insertion.q_start, np.zeros(7), np.zeros(7)
    for _ in range(400):
        angles, before = arm.angles(q), v
        v = controller.step(insertion.state(q, v, a), reference).v
        a = (v - before) / T
        q = arm.integrate(q, v, T)
    assert np.abs(v).max() > 0.9
    found = stopped(insertion, angles, v)
    changes = np.abs(np.diff(found, axis=0, prepend=v[None]))
    assert (changes <= arm.acceleration * T * (1.0 + 1e-9)).all()
    together = np.linspace(1.0, 0.0, 1 + len(found))[1:, None] * v
    errors = []
    for commands in (found, together):
        end, worst = q, 0.0
        for velocity in commands:
            end = arm.integrate(end, velocity, T)
            x = insertion.state(end).x
            worst = max(worst, float(rcm_error(x, insertion.trocar.pivot)))
        errors.append(worst)
    assert errors[0] < 2e-5
    assert errors[1] > 1e-4  # m; with limits on jerk the arm is slower here


def test_braking_keeps_the_shaft_on_the_trocar(insertion: rcmqp.Insertion) -> None:
    """Ten times nearer than if each joint stopped by itself."""
    robot = Arm(insertion, Clock())
    run(robot, 0.3)
    q, errors = insertion.q_start, {}
    for v in robot.sent[:300]:
        q = insertion.arm.integrate(q, v, T)
    alone = np.abs(robot.sent[299]) - insertion.arm.acceleration * T * np.arange(1, 300)[:, None]
    alone = np.sign(robot.sent[299]) * np.maximum(alone, 0.0)
    for name, commands in (("together", robot.sent[300:]), ("alone", list(alone))):
        end = q
        for v in commands:
            end = insertion.arm.integrate(end, v, T)
        errors[name] = float(rcm_error(insertion.state(end).x, insertion.trocar.pivot))
    assert errors["together"] < 0.1 * errors["alone"]


def test_braking_stays_inside_the_position_limits_where_each_joint_could(
    insertion: rcmqp.Insertion,
) -> None:
    """A joint that is quick to stop stands before its limit; another is slow to stop."""
    arm, v = insertion.arm, np.zeros(7)
    v[1], v[6] = 1.0, 0.5
    angles = np.array(insertion.angles_start)
    angles[6] = arm.upper[6] - T * v[6] - 0.55 * v[6] ** 2 / arm.acceleration[6]
    found = stopped(insertion, angles, v)
    ends = angles + T * (v + found.sum(axis=0))
    assert (ends <= arm.upper).all()
    assert np.all(np.abs(np.diff(found, axis=0, prepend=v[None])) <= arm.acceleration * T + 1e-12)
    assert (found[-1] == 0.0).all()


def test_a_loop_that_ends_before_a_position_limit_stays_inside_it() -> None:
    arm, v = rcmqp.load_arm("panda"), np.zeros(7)
    v[1], v[6] = 1.0, 0.5
    angles = np.array(arm.home)
    angles[6] = arm.upper[6] - 20 * T * v[6] - 0.6 * v[6] ** 2 / arm.acceleration[6]
    insertion = rcmqp.Insertion.on_shaft(arm, rcmqp.Instrument(), angles)
    robot = Arm(insertion, Clock())
    run(robot.moving(v), 20 * T, controller=Spoilt(insertion, T, robot, v, v))
    assert (robot.v == 0.0).all()
    assert robot.q[6] <= arm.upper[6] + 10 * TICK * v[6]  # by the clock it knows where it is


@pytest.mark.parametrize("where", ["controller", "send", "reading"])
def test_a_stop_after_a_stall_knows_that_the_joints_went_on(where: str) -> None:
    """Joints that move by the clock, a slow one and one that is near its limit, stand inside."""
    arm, v = rcmqp.load_arm("panda"), np.zeros(7)
    v[1], v[6] = 1.0, 0.5
    stall, angles = 0.03, np.array(arm.home)
    angles[6] = arm.upper[6] - v[6] * (stall + 12 * T) - 0.6 * v[6] ** 2 / arm.acceleration[6]
    insertion = rcmqp.Insertion.on_shaft(arm, rcmqp.Instrument(), angles)
    robot, stalled = Arm(insertion, clock := Clock()), list[int]()
    moved = [clock.now]

    def wait(at: str) -> None:
        if at == where and len(robot.sent) == 10 and not stalled:
            stalled.append(1)
            clock.now += stall
            if where == "reading":
                raise OSError("late, and gone")

    def go_on() -> None:
        robot.q = arm.integrate(robot.q, robot.v, clock.now - moved[-1])
        moved.append(clock.now)

    def read() -> tuple[Array, Array]:
        wait("reading")
        go_on()
        return robot.q, robot.v

    def send(v: Array) -> None:
        go_on()
        robot.v = v
        robot.sent.append(v)
        wait("send")

    def references(t: float) -> Stamped:
        wait("controller")
        return view(insertion, t)

    robot.read, robot.send = read, send  # type: ignore[method-assign]
    robot.moving(v)
    report = run(robot, 1.0, references, controller=Spoilt(insertion, T, robot, v, v))
    assert report.stop.fault
    assert (robot.v == 0.0).all()
    gap = arm.upper[6] - robot.q[6]
    assert 0.0 < gap < 0.2 * v[6] * stall


def test_the_stop_holds_on_to_a_trocar_that_has_moved(insertion: rcmqp.Insertion) -> None:
    """The stop's first step does not carry the shaft across the trocar: where it is, not was."""
    robot, off = Arm(insertion, Clock()), np.array([0.0, 0.0, -0.1])
    along = across(*_seen(insertion, insertion.q_start, off))
    v = np.array([0.1, -0.2, 0.15, 0.05, 0.1, -0.1, 0.2])
    v -= np.linalg.pinv(along) @ along @ v

    def references(t: float) -> Stamped:
        good = view(insertion, 0.0)
        pivot = good.reference.pivot + off * bool(robot.sent)
        return Stamped(dataclasses.replace(good.reference, pivot=pivot), t)

    run(robot.moving(v), 10 * T, references, controller=Spoilt(insertion, T, robot, v, v))
    q = insertion.q_start
    for command in robot.sent[:10]:
        q = insertion.arm.integrate(q, command, T)
    there, then = (
        insertion.state(q),
        insertion.state(insertion.arm.integrate(q, robot.sent[10], T)),
    )
    was = np.array(insertion.trocar.pivot)
    for pivot, least, most in ((was + off, 0.0, 1e-9), (was, 1e-6, np.inf)):
        point = nearest(there, pivot)
        assert least <= np.linalg.norm(nearest(then, point) - point) <= most


def _seen(insertion: rcmqp.Insertion, q: Array, off: Array) -> tuple[Array, float]:
    """J_local at q, and how far from the effector the trocar is, if it has moved by ``off``."""
    state = insertion.state(q)
    return state.J_local, float(state.oMe.actInv(np.array(insertion.trocar.pivot) + off)[2])


def test_braking_ends_where_the_trocar_would_not_let_it(
    insertion: rcmqp.Insertion, monkeypatch: pytest.MonkeyPatch
) -> None:
    def on(self: Hierarchy, levels: list[Level], bounds: Bounds) -> SimpleNamespace:
        return SimpleNamespace(v=np.clip(0.5, bounds.lower, bounds.upper))

    monkeypatch.setattr(Hierarchy, "solve", on)
    v = np.full(7, 0.5)
    found = stopped(insertion, insertion.angles_start, v)
    assert (found[-1] == 0.0).all()
    assert len(found) <= 10 + 2.6 * np.max(v / (insertion.arm.acceleration * T))


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"jerk": [None] * 6}, "the acceleration limits of ur5 are only assumed: 6.3"),
        ({"acceleration": 5.0}, "the jerk limits of ur5 are only assumed: 250"),
        ({"acceleration": 5.0, "jerk": np.inf}, "the jerk limits of ur5 are infinite"),
        ({"acceleration": np.inf, "jerk": 90.0}, "the acceleration limits of ur5 are infinite"),
    ],
)
def test_an_arm_whose_limits_are_not_known_is_not_driven(
    limits: dict[str, Any], message: str
) -> None:
    unknown = rcmqp.load_arm("ur5", **limits)
    robot = Arm(rcmqp.Insertion.on_shaft(unknown, rcmqp.Instrument()), Clock())
    remedy = r".* a real arm needs a limit, load_arm\(\.\.\., acceleration=\.\.\., jerk=\.\.\.\)"
    with pytest.raises(OptionError, match=message + remedy):
        run(robot)
    assert robot.read_at == robot.sent == []


@pytest.mark.parametrize("by_hand", [True, False])
def test_an_arm_whose_limits_are_given_or_confirmed_is_driven(by_hand: bool) -> None:
    given = rcmqp.load_arm("ur5", acceleration=5.0, jerk=90.0)
    arm = given if by_hand else rcmqp.load_arm("ur5").confirmed()
    robot = Arm(rcmqp.Insertion.on_shaft(arm, rcmqp.Instrument()), Clock())
    assert run(robot, controller=careful(robot.insertion)).stop.fault == ""
    assert robot.sent


def test_braking_is_at_once_where_no_acceleration_limit_is_known(
    insertion: rcmqp.Insertion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(insertion.arm, "acceleration", np.full(7, np.inf))
    monkeypatch.setattr(insertion.arm, "jerk", np.full(7, np.inf))
    found = stopped(insertion, insertion.angles_start, np.full(7, 0.3))
    assert found.shape == (1, 7)
    assert (found == 0.0).all()
