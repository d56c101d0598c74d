"""Signals that come while the real-time loop runs."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from fake_robot import HELD, Arm, Clock, T, assert_stopped, run, view

import rcmqp
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.report import LoopReport
from rcmqp.realtime.run import WARM_UP, Stamped

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture(autouse=True)
def heard() -> Iterator[None]:
    """Signals as a terminal sends them, though who runs the tests may ignore some."""
    usual: tuple[Any, ...] = (signal.default_int_handler, signal.SIG_DFL, signal.SIG_DFL)
    before = [signal.signal(number, how) for number, how in zip(SIGNALS, usual, strict=True)]
    yield
    for number, handler in zip(SIGNALS, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS, ids=str)
@pytest.mark.parametrize("where", ["on_read", "on_send", "sent"])
def test_a_signal_ends_in_the_safe_stop_and_one_more_changes_nothing(
    number: signal.Signals, where: str, insertion: rcmqp.Insertion
) -> None:
    before = [signal.getsignal(each) for each in SIGNALS]
    robot = Arm(insertion, Clock())
    usual = robot.send

    def signalled(k: int) -> None:
        if k == 9:
            signal.raise_signal(number)
        elif k in (12, 100):  # again while it brakes, and while it holds
            signal.raise_signal(SIGNALS[SIGNALS.index(number) - 1])

    def send(v: Array) -> None:
        usual(v)
        signalled(len(robot.sent) - 1)

    if where == "sent":
        robot.send = send  # type: ignore[method-assign]
    else:
        setattr(robot, where, signalled)
    report = run(robot, 1.0)
    assert_stopped(robot, report, f"interrupted ({number.name})")
    assert report.stop.signal == number
    assert [signal.getsignal(each) for each in SIGNALS] == before


@pytest.mark.parametrize("k", [19, 20, 30], ids=["last cycle", "stop", "hold"])
def test_a_signal_that_comes_when_all_is_over_leaves_the_report(
    k: int, insertion: rcmqp.Insertion
) -> None:
    robot = Arm(insertion, Clock())
    robot.on_send = lambda n: signal.raise_signal(signal.SIGINT) if n == k else None
    report = run(robot, 0.02)
    assert (report.stop.fault, report.stop.signal) == ("", signal.SIGINT)
    assert report.stop.at == 0.02
    assert report.cycles == len(robot.sent) == 20 + report.braking
    assert (robot.v == 0.0).all()


@pytest.mark.parametrize("where", ["read", "send", "references", "read in the stop"])
def test_a_signal_leaves_what_hangs_and_stops_the_arm(
    where: str, insertion: rcmqp.Insertion, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, hung = Arm(insertion, clock := Clock()), [0.0]
    monkeypatch.setattr("rcmqp.realtime.system.monotonic", lambda: clock.now)

    def hang(k: int) -> None:
        while k >= 10 and len(hung) < 2:  # left by an exception only
            clock.now += T
            if clock.now - robot.sent_at[-1] > 0.5:
                hung.append(clock.now)
                signal.raise_signal(signal.SIGINT)
                raise AssertionError("went on")

    def references(t: float) -> Stamped:
        if where == "references":
            hang(len(robot.sent))
        return view(insertion, t)

    if where == "send":
        robot.on_send = hang
    elif where == "read":
        robot.on_read = hang
    elif where == "read in the stop":
        robot.on_read = lambda k: hang(k - 10)
    report = run(robot, 0.02 if "stop" in where else 1.0, references)
    assert report.stop.signal == signal.SIGINT
    assert report.stop.fault == ("" if "stop" in where else "interrupted (SIGINT)")
    assert (robot.v == 0.0).all()
    assert robot.sent[-HELD].any() == robot.sent[-1].any() == False  # noqa: E712


def test_a_reading_that_hangs_does_not_hold_up_the_stop(insertion: rcmqp.Insertion) -> None:
    robot = Arm(insertion, clock := Clock())

    def hang(k: int) -> None:
        clock.now += 0.5 * (k >= 20)

    robot.on_read = hang
    report = run(robot, 0.02)
    assert (robot.v == 0.0).all()
    assert len(robot.read_at) == WARM_UP + 20 + 1  # not asked again
    assert robot.sent_at[-1] - robot.sent_at[20] < T * report.braking


def test_a_signal_that_was_ignored_is_ignored_in_the_loop(insertion: rcmqp.Insertion) -> None:
    """As by nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        robot = Arm(insertion, Clock(), on_read=lambda k: signal.raise_signal(signal.SIGHUP))
        report = run(robot, 0.02)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert (report.stop.fault, report.stop.signal) == ("", 0)


def test_the_loop_runs_in_a_thread_too_and_leaves_signals_alone(
    insertion: rcmqp.Insertion,
) -> None:
    reports, handlers = list[LoopReport](), list[object]()
    robot = Arm(insertion, Clock(), on_send=lambda k: handlers.append(_int()))
    thread = threading.Thread(target=lambda: reports.append(run(robot, 0.02)))
    thread.start()
    thread.join()
    assert reports[0].stop.fault == ""
    assert set(handlers) == {_int()}


def _int() -> object:
    return signal.getsignal(signal.SIGINT)
