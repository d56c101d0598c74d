"""Faults of the robot, the references and the controller in the real-time loop."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fake_robot import HELD, Arm, Clock, Spoilt, T, assert_stopped, careful, nan_at, run, view

import rcmqp
from rcmqp.controllers.braking import Brake
from rcmqp.errors import RcmqpError
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.checks import CommandCheck, LoopFault
from rcmqp.realtime.run import WARM_UP, Stamped


def inf_at(k: int, q: Array) -> Array:
    return q - np.inf if k == 10 else q


def fails_at(what: BaseException) -> Callable[[int], None]:
    """Once, after ten commands."""
    left = [what]

    def fail(k: int) -> None:
        if k == 10 and left:
            raise left.pop()

    return fail


def is_gone(k: int) -> None:
    if k >= 10:
        raise OSError("gone for good")


FAULTS: dict[str, tuple[str, Callable[[rcmqp.Insertion, Clock], dict[str, Any]]]] = {
    "NaN reading": ("not finite", lambda i, c: {"spoil": nan_at}),
    "infinite reading": ("configuration q is not finite", lambda i, c: {"spoil": inf_at}),
    "NaN velocity": ("joint velocity v is not finite", lambda i, c: {"spoil_v": nan_at}),
    "failed reading": ("OSError: gone", lambda i, c: {"on_read": fails_at(OSError("gone"))}),
    "short reading": (
        r"shape (6,), it must be (7,)",
        lambda i, c: {"spoil": lambda k, q: q[:6] if k == 10 else q},
    ),
    "degrees": (
        "rad, its limits are",
        lambda i, c: {"spoil": lambda k, q: np.degrees(q) if k >= 10 else q},
    ),
    "a jump": (
        "check that every reading is of this arm, and new",
        lambda i, c: {"spoil": lambda k, q: q + 0.1 * (np.arange(7) == 2) if k >= 10 else q},
    ),
    "no more readings": ("OSError: gone for good", lambda i, c: {"on_read": is_gone}),
    "failed sending": ("OSError: full", lambda i, c: {"on_send": fails_at(OSError("full"))}),
    "Ctrl-C": ("interrupted", lambda i, c: {"on_read": fails_at(KeyboardInterrupt())}),
}


REFERENCE_FAULTS: dict[str, tuple[str, Callable[[rcmqp.Insertion, float], Stamped]]] = {
    "stale": ("LoopFault: the newest reference is 0.011", lambda i, t: view(i, -1.5e-3)),
    "stamped NaN": (
        "LoopFault: the newest reference is nan",
        lambda i, t: dataclasses.replace(view(i, t), at=np.nan),
    ),
    "failed": ("ZeroDivisionError", lambda i, t: view(i, 1.0 / 0.0)),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_the_robot_ends_in_the_safe_stop(name: str, insertion: rcmqp.Insertion) -> None:
    fault, options = FAULTS[name]
    robot = Arm(insertion, clock := Clock())
    for key, value in options(insertion, clock).items():
        setattr(robot, key, value)
    assert_stopped(robot, run(robot, 1.0), fault)


def test_an_exit_in_the_loop_waits_for_the_safe_stop(insertion: rcmqp.Insertion) -> None:
    robot = Arm(insertion, Clock(), on_read=fails_at(SystemExit(3)))
    with pytest.raises(SystemExit):
        run(robot, 1.0)
    assert len(robot.sent) > 10 + HELD
    assert (robot.v == 0.0).all()


@pytest.mark.parametrize("name", REFERENCE_FAULTS)
def test_a_fault_of_the_reference_ends_in_the_safe_stop(
    name: str, insertion: rcmqp.Insertion
) -> None:
    fault, spoilt = REFERENCE_FAULTS[name]
    robot = Arm(insertion, Clock())

    def references(t: float) -> Stamped:
        return view(insertion, t) if len(robot.sent) < 10 else spoilt(insertion, t)

    report = run(robot, 1.0, references, reference_age=0.01)
    assert_stopped(robot, report, fault)


@pytest.mark.parametrize(
    ("answer", "fault"),
    [
        (ValueError("no"), "ValueError: no"),
        (np.full(7, np.nan), "InvalidCommand: spoilt answered"),
        (np.zeros(6), "InvalidCommand: spoilt answered"),
        (
            np.array([0.2, 0.2, 0.2, 0.2, 0.2, 2.6, -2.63]),
            "LoopFault: panda_joint7 was to move by spoilt's command at -2.63 rad/s, allowed 2.61",
        ),
        (np.array([-2.2, 0.0, 0.0, 0.0, 0.0, 2.4, 0.0]), "panda_joint1 was"),
        (np.full(7, 1e20), "at 1e+20 rad/s, allowed 2.175"),
    ],
    ids=["raises", "NaN", "wrong size", "too fast", "fastest for its limit", "much too fast"],
)
def test_a_fault_of_the_controller_ends_in_the_safe_stop(
    answer: object, fault: str, insertion: rcmqp.Insertion
) -> None:
    robot = Arm(insertion, Clock())
    report = run(robot, 1.0, controller=Spoilt(insertion, T, robot, answer))
    assert_stopped(robot, report, fault)
    assert isinstance(report.stop.error, Exception)


def test_a_solvers_tolerance_above_a_speed_limit_is_cut_off(insertion: rcmqp.Insertion) -> None:
    robot, most = Arm(insertion, Clock()), insertion.arm.velocity
    v = most * np.array([1.0005, -1.0005, 0.5, 0.0, 1.0, -1.0, 0.1])
    robot.moving(v)
    report = run(robot, controller=Spoilt(insertion, T, robot, v, v))
    assert report.stop.fault == ""
    assert np.array_equal(robot.sent[5], np.clip(v, -most, most))


BEYOND: dict[str, tuple[dict[str, float], str]] = {
    "acceleration": (
        {"v": 0.2, "before": 0.19, "a": 6.0},
        "was to accelerate by law's command at 10 rad/s^2, allowed 7.5 rad/s^2; take",
    ),
    "jerk": (
        {"v": 0.2, "before": 0.197, "a": -3.0},
        "was to move by law's command with a jerk of 6000 rad/s^3, allowed 5000 rad/s^3; take",
    ),
    "speed": (
        {"v": 2.1745, "before": 2.168, "a": 3.0},
        "was to accelerate by law's command at 6.5 rad/s^2 and 2.175 rad/s, too much to stay "
        "below 2.175 rad/s; take",
    ),
    "position": (
        {"v": 1.0, "before": 1.0, "a": 0.0, "room": 0.06},
        "was to move by law's command at 1 rad/s, at 1.703 rad, from where it cannot stop before "
        "its upper position limit, 1.763 rad; take",
    ),
}


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("kind", BEYOND)
def test_a_command_beyond_a_limit_is_refused_in_words(kind: str, side: float) -> None:
    """And one that is inside by as little is sent as it is."""
    numbers, words = BEYOND[kind]
    arm = rcmqp.load_arm("panda")
    arm.jerk = np.full(7, 5000.0)
    check = CommandCheck(Brake(rcmqp.Insertion.on_shaft(arm, rcmqp.Instrument()), T), "law")
    v, before, a = (side * numbers[name] * np.eye(7)[1] for name in ("v", "before", "a"))
    angles = arm.home.copy()
    if "room" in numbers:
        limit = arm.upper[1] if side > 0.0 else arm.lower[1]
        angles[1] = limit - side * numbers["room"]
    with pytest.raises(LoopFault, match="panda_joint2") as fault:
        check.passed(v, angles, before, a)
    if side > 0.0:
        assert f"panda_joint2 {words}" in str(fault.value)
    lower, upper = Brake(rcmqp.Insertion.on_shaft(arm, rcmqp.Instrument()), T).box(
        angles, before, a
    )
    most = upper if side > 0.0 else lower
    assert np.array_equal(check.passed(most, angles, before, a), most)
    assert np.array_equal(check.passed(most + side * 1e-6 * np.eye(7)[1], angles, before, a), most)


def test_a_hierarchy_with_limited_jerk_is_never_refused() -> None:
    """Views that jump, a reference that is lost for a while, and the stop at the end."""
    arm, rng = rcmqp.load_arm("panda"), np.random.default_rng(7)
    arm.jerk = np.full(7, 5000.0)
    insertion = rcmqp.Insertion.on_shaft(arm, rcmqp.Instrument())
    robot = Arm(insertion, Clock())
    views = rng.uniform((-0.4, -0.4, -1.0, -0.03), (0.4, 0.4, 1.0, 0.05), (20, 4))

    def references(t: float) -> Stamped:
        reference = rcmqp.view_pose(insertion.x_rcm, rcmqp.ViewCommand(*views[int(t / 0.15) % 20]))
        if 0.5 < t < 0.6:
            reference = dataclasses.replace(reference, x_d=np.full(8, np.nan))
        return Stamped(reference, t)

    controller = rcmqp.make_controller("hierarchical_qp", insertion, T, backend="active_set")
    report = run(robot, 1.5, references, controller)
    assert report.stop.fault == ""
    assert report.controller_stops > 50
    v = np.array([np.zeros(7), *robot.sent])
    a = np.diff(v, axis=0, prepend=np.zeros((1, 7))) / T
    assert (np.abs(a) <= arm.acceleration * (1.0 + 1e-9)).all()
    assert (np.abs(np.diff(a, axis=0)) <= 5000.0 * T * (1.0 + 1e-9)).all()
    assert np.abs(v).max() > 1.0
    assert (robot.v == 0.0).all()


def test_a_reference_stamped_in_the_future_ends_in_the_safe_stop(
    insertion: rcmqp.Insertion,
) -> None:
    still = rcmqp.view_pose(insertion.x_rcm, rcmqp.ViewCommand())
    for ahead, fault in ((0.5 * T, ""), (2.0 * T, "in the future")):
        robot = Arm(insertion, Clock())
        report = run(robot, references=lambda now: Stamped(still, now + ahead * bool(robot.sent)))  # noqa: B023
        assert fault in report.stop.fault
        assert bool(report.stop.fault) == bool(fault)
        assert (robot.sent[-1] == 0.0).all()


@pytest.mark.parametrize("where", ["read", "send"])
@pytest.mark.parametrize("what", [KeyboardInterrupt, SystemExit])
def test_nothing_that_the_robot_raises_keeps_the_arm_moving(
    insertion: rcmqp.Insertion, where: str, what: type[BaseException]
) -> None:
    robot = Arm(insertion, Clock())
    usual = getattr(robot, where)

    def impatient(*values: Any) -> Any:
        if len(robot.sent) >= 15:
            usual(*values)
            raise what
        return usual(*values)

    setattr(robot, where, impatient)
    with contextlib.suppress(SystemExit):
        v = np.full(7, 0.2)
        report = run(robot.moving(v), 1.0, controller=Spoilt(insertion, T, robot, v, v))
        assert report.stop.fault == "interrupted"
    assert len(robot.sent) > 15 + HELD
    assert len(robot.read_at) == WARM_UP + len(robot.sent) + (where == "read")  # tried every time
    assert (robot.sent[-1] == 0.0).all()


def test_a_command_that_would_be_too_late_is_not_sent(insertion: rcmqp.Insertion) -> None:
    robot = Arm(insertion, clock := Clock())

    def work(k: int) -> None:
        clock.now += 5.0 * T if k == 10 else 0.0

    robot.on_read = work
    report = run(robot, 1.0, lateness=4.0 * T)
    assert "LoopFault: a command was 0.005" in report.stop.fault
    assert report.stop.signal == 0
    slowed = np.abs(robot.sent[10]) - np.abs(robot.sent[9])
    assert (slowed <= 0.0).all()
    assert (robot.sent[-1] == 0.0).all()
    assert report.missed == 1


def test_the_stop_is_tried_to_the_end_when_sending_fails(insertion: rcmqp.Insertion) -> None:
    robot = Arm(insertion, Clock())

    def fail(k: int) -> None:
        if k >= 10:
            raise OSError("cable")

    robot.on_send = fail
    report = run(robot, 1.0)
    assert report.stop.fault == "OSError: cable"
    assert report.unsent == report.braking > HELD


@pytest.mark.parametrize("periods", [19.5, 20.5])
def test_a_command_may_be_twenty_periods_late(insertion: rcmqp.Insertion, periods: float) -> None:
    robot = Arm(insertion, clock := Clock())

    def work(k: int) -> None:
        clock.now += periods * T if k == 10 else 0.0

    robot.on_read, v = work, np.full(7, 0.1)
    report = run(robot.moving(v), 0.05, controller=Spoilt(insertion, T, robot, v, v))
    assert bool(report.stop.fault) == (periods > 20.0)


FAULTS_BEFORE: dict[str, tuple[str, dict[str, Any]]] = {
    "NaN": ("not finite", {"spoil": lambda k, q: q * np.nan}),
    "short": (r"shape \(6,\), it must be \(7,\)", {"spoil_v": lambda k, v: v[:6]}),
    "fast": (
        "panda_joint2 moves before the loop",
        {"spoil_v": lambda k, v: v - 2.2 * np.eye(7)[1]},
    ),
}


@pytest.mark.parametrize("name", FAULTS_BEFORE)
def test_a_fault_before_the_loop_is_raised_and_nothing_is_sent(
    name: str, insertion: rcmqp.Insertion
) -> None:
    fault, spoilt = FAULTS_BEFORE[name]
    robot = Arm(insertion, Clock(), **spoilt)
    with pytest.raises(RcmqpError, match=fault):
        run(robot)
    assert robot.sent == []


def test_a_joint_at_its_position_limit_comes_to_rest_in_every_digit() -> None:
    insertion = rcmqp.load_scenario("camera_task", "panda").insertion()
    arm, crawl = insertion.arm, -7.4e-20 * (np.arange(7) == 6)
    angles = np.where(np.arange(7) == 6, arm.upper, arm.home)
    passed = CommandCheck(Brake(insertion, T), "mine").passed(
        np.zeros(7), angles, crawl, 0 * crawl
    )
    assert not passed.any()


@pytest.mark.parametrize("off", [0.01, -0.3])
def test_an_arm_that_stands_off_the_trocar_is_not_driven(
    insertion: rcmqp.Insertion, off: float
) -> None:
    robot = Arm(insertion, Clock())
    robot.spoil = lambda k, q: q + off * (np.arange(7) == 1)
    with pytest.raises(
        LoopFault, match=r"the shaft is .* mm off the trocar where the robot stands"
    ):
        run(robot, 1.0)
    assert not robot.sent


def test_an_arm_may_stand_off_the_trocar_by_the_tolerance_of_its_insertion(
    insertion: rcmqp.Insertion,
) -> None:
    q = insertion.q_start + 0.01 * (np.arange(7) == 1)
    measured = rcmqp.Insertion(
        insertion.arm, insertion.instrument, insertion.trocar, q, tolerance=0.02
    )
    report = run(Arm(measured, Clock()), 0.2, controller=careful(measured))
    assert 1e-3 < report.off_trocar < 0.02
    assert report.stop.fault == ""


@pytest.mark.parametrize("answer", [None, 7.0, (np.zeros(7),), (np.zeros(7), "slow")], ids=str)
def test_a_read_that_gives_no_pair_of_arrays_is_told_what_to_give(
    answer: Any, insertion: rcmqp.Insertion
) -> None:
    robot = Arm(insertion, Clock())
    robot.read = lambda: answer  # type: ignore[method-assign]
    with pytest.raises(RcmqpError, match=r"read\(\) answered .* it must be a pair of arrays"):
        run(robot)
    assert robot.sent == []


def test_a_send_that_hangs_is_a_fault(insertion: rcmqp.Insertion) -> None:
    robot = Arm(insertion, clock := Clock())

    def hang(k: int) -> None:
        clock.now += 3.0 * (k == 10)

    robot.on_send = hang
    report = run(robot, 5.0)
    assert "LoopFault: send() took until 3" in report.stop.fault
    assert len(robot.sent) == 11 + report.braking
    assert (robot.v == 0.0).all()


def test_a_reference_without_its_time_is_refused_before_the_loop(
    insertion: rcmqp.Insertion,
) -> None:
    def bare(t: float) -> Any:
        return view(insertion, t).reference

    with pytest.raises(RcmqpError, match=r"Stamped\(reference, at\)"):
        run(Arm(insertion, Clock()), references=bare)


def test_a_clock_that_cannot_wait_stops_the_arm_all_the_same(insertion: rcmqp.Insertion) -> None:
    robot = Arm(insertion, clock := Clock())
    usual = clock.sleep

    def broken(duration: float) -> None:
        if len(robot.sent) >= 10:
            raise OSError("no timer")
        usual(duration)

    clock.sleep = broken  # type: ignore[method-assign]
    report = run(robot, 1.0)
    assert report.stop.fault == "OSError: no timer"
    assert (robot.v == 0.0).all()
