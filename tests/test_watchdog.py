"""A loop that hangs, and one that an executor steps.

The clock is the machine's, which may be busy: what hangs would do so for seconds, and the arm has
no patience of its own, so that it is at rest by halt() or not at all.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest

import rcmqp
from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.latency import Ticks
from rcmqp.realtime.loopback import UdpArm, account_of, arm_process, port_of
from rcmqp.realtime.packets import Packets, new_key
from rcmqp.realtime.report import LoopReport
from rcmqp.realtime.run import HOLD, LoopHung, RealtimeLoop, Stamped, run_realtime
from rcmqp.realtime.simulated_arm import insertion_of
from rcmqp.realtime.system import KeptSignals, Watchdog, time_waited

T = 0.001
HUNG = 0.5
"""Patience of the watch-dog where something hangs [s]; a busy machine holds up a loop, too."""

FOREVER = 8.0
"""What hangs goes on after so long, for the test's sake, not the arm's [s]."""

HANGS: dict[str, Any] = {"lateness": 0.4, "hung": HUNG, "reference_age": 5.0}
"""Of the loop where something hangs."""

SLOW: dict[str, Any] = {"lateness": 4.0, "hung": 5.0, "reference_age": 5.0}
"""Of the loop where nothing does, though the machine may be busy."""


@pytest.fixture(scope="module")
def insertion() -> rcmqp.Insertion:
    return insertion_of("panda")


def view(insertion: rcmqp.Insertion, t: float) -> Stamped:
    """Looking ever further to the right, ever faster from t = 0 on, up to 0.3 rad/s."""
    rising = min(t, 0.15)
    command = rcmqp.ViewCommand(alpha=rising**2 + 0.3 * (t - rising), alpha_dot=2.0 * rising)
    return Stamped(rcmqp.view_pose(insertion.x_rcm, command), t)


class Joints:
    """Joints that do as they are told until they are halted; ``hang`` says where they hang."""

    def __init__(self, insertion: rcmqp.Insertion, hang: str = "") -> None:
        self.insertion, self.hang = insertion, hang
        self.q, self.v = np.array(insertion.q_start), np.zeros(insertion.arm.nv)
        self.sent = list[Array]()
        self.halted, self.free = threading.Event(), threading.Event()
        self.halts = 0

    def read(self) -> tuple[Array, Array]:
        self._may_hang("read")
        return self.q, self.v

    def send(self, v: Array) -> None:
        self._may_hang("send")
        self.sent.append(v)
        self.q, self.v = self.insertion.arm.integrate(self.q, v, T), v

    def _may_hang(self, where: str) -> None:
        if self.hang == where and len(self.sent) == 20:
            self.hang = ""
            self.free.wait(FOREVER)


class HaltingJoints(Joints):
    """The same, with halt()."""

    fails = 0

    def halt(self) -> None:
        self.halts += 1
        if self.halts <= self.fails:
            raise OSError("no such luck")
        self.v = np.zeros_like(self.v)
        self.halted.set()


def run(robot: Joints, duration: float = FOREVER, **options: Any) -> LoopReport:
    insertion = robot.insertion
    controller = rcmqp.make_controller("hierarchical_qp", insertion, T)
    return run_realtime(
        robot, controller, lambda t: view(insertion, t), duration, **{**SLOW, **options}
    )


@contextlib.contextmanager
def stepped(robot: Joints, duration: float = FOREVER, **options: Any) -> Iterator[RealtimeLoop]:
    insertion = robot.insertion
    controller = rcmqp.make_controller("hierarchical_qp", insertion, T)
    with RealtimeLoop(
        robot, controller, lambda t: view(insertion, t), duration, **{**SLOW, **options}
    ) as loop:
        yield loop


# What hangs --------------------------------------------------------------------------------


class HangingArm(UdpArm):
    """An arm over UDP whose read() or send() hangs after 300 commands."""

    def __init__(self, port: int, packets: Packets, hang: str) -> None:
        super().__init__(port, packets)
        self.hang = hang

    def read(self) -> tuple[Array, Array]:
        self._may_hang("read")
        return super().read()

    def send(self, v: Array) -> None:
        self._may_hang("send")
        super().send(v)

    def _may_hang(self, where: str) -> None:
        if self.hang == where and self.sent == 300:
            threading.Event().wait(FOREVER)


@pytest.mark.parametrize("where", ["read", "send"])
def test_an_arm_in_its_own_process_is_at_rest_where_a_call_hangs(
    where: str, insertion: rcmqp.Insertion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It moved by the last command for HUNG and little more."""
    monkeypatch.setattr("rcmqp.realtime.loopback.PATIENCE", FOREVER)
    monkeypatch.setattr("rcmqp.realtime.loopback.HELLO", 10.0)
    key, controller = new_key(), rcmqp.make_controller("hierarchical_qp", insertion, T)
    packets = Packets(insertion.arm.nq, insertion.arm.nv, key)
    with arm_process("panda", T, key, patience=10**9) as box:
        robot = HangingArm(port_of(box), packets, where)
        with contextlib.closing(robot):
            began = monotonic()
            report = run_realtime(robot, controller, lambda t: view(insertion, t), 30.0, **HANGS)
            took = monotonic() - began
        account = account_of(box)
    assert isinstance(report.stop.error, LoopHung)
    assert f"LoopHung: {where}() hangs: no cycle has ended for 0.5 s" in report.stop.fault
    assert report.stop.fault.endswith("so the robot's halt() was called")
    assert report.halted
    assert (report.cycles, report.braking, robot.sent) == (300, 0, 300)
    assert (account.halted, account.stopped, account.speed_end) == (1, 0, 0.0)
    assert 0.5 * HUNG / T < account.ran_on < 3.0 / T  # cycles; without halt() it goes on
    assert took < 0.9 * FOREVER  # the main thread is out of the call that hangs
    assert "the robot's halt(), after 0 cycles" in report.as_markdown()


@pytest.mark.parametrize("where", ["read", "send"])
def test_nothing_is_sent_after_the_halt_in_another_thread(
    where: str, insertion: rcmqp.Insertion
) -> None:
    """There the loop ends when the call returns."""
    robot, reports = HaltingJoints(insertion, where), list[LoopReport]()
    thread = threading.Thread(target=lambda: reports.append(run(robot, **HANGS)))
    thread.start()
    assert robot.halted.wait(FOREVER)
    assert len(robot.sent) == 20
    assert not reports
    robot.free.set()
    thread.join(FOREVER)
    assert f"LoopHung: {where}() hangs" in reports[0].stop.fault
    assert (reports[0].halted, reports[0].braking) == (True, 0)
    assert len(robot.sent) == 20 + (where == "send")
    assert not robot.v.any()  # halted once more, after all that was sent
    assert robot.halts == 2


def test_a_controller_that_hangs_is_named(insertion: rcmqp.Insertion) -> None:
    robot = HaltingJoints(insertion)

    def references(t: float) -> Stamped:
        if len(robot.sent) == 20:
            robot.free.wait(FOREVER)
        return view(insertion, t)

    controller = rcmqp.make_controller("hierarchical_qp", insertion, T)
    report = run_realtime(robot, controller, references, FOREVER, **HANGS)
    assert "LoopHung: the reference or the controller hangs" in report.stop.fault
    assert len(robot.sent) == 20
    assert not robot.v.any()


def test_a_stop_that_hangs_is_halted_too(insertion: rcmqp.Insertion) -> None:
    """It is asked for once the arm moves; then the second of its commands hangs."""
    robot = HaltingJoints(insertion, "send")
    robot.free = robot.halted  # the call then returns
    with stepped(robot, **HANGS) as loop:
        while loop.cycle():
            if len(robot.sent) == 18:
                loop.stop()
            sleep(T)
    report = loop.report()
    assert "asked to stop; in the stop, LoopHung: send() hangs" in report.stop.fault
    assert report.halted
    assert not robot.v.any()


def test_a_halt_that_fails_is_tried_again_and_the_loop_brakes(insertion: rcmqp.Insertion) -> None:
    robot = HaltingJoints(insertion, "read")
    robot.fails = 10**9
    report = run(robot, **HANGS)
    assert "which failed: OSError: no such luck" in report.stop.fault
    assert not report.halted
    assert report.braking > HOLD / T
    assert not robot.v.any()
    assert robot.halts > 1


def test_a_halt_that_fails_is_tried_again_before_the_loop_has_ended() -> None:
    tries, there = list[int](), threading.Event()

    def halt() -> None:
        tries.append(1)
        if len(tries) < 3:
            raise OSError("not yet")
        there.set()

    watchdog = Watchdog(halt, 0.05, lambda: "here", lambda: None)
    watchdog.beat()
    assert there.wait(FOREVER)
    watchdog.close()
    assert watchdog.settled()
    assert len(tries) == 4


def test_nothing_is_sent_after_the_halt_even_where_the_loop_has_lost_no_time(
    insertion: rcmqp.Insertion,
) -> None:
    """By its own clock, which stands still while read() hangs."""
    robot = HaltingJoints(insertion, "read")
    robot.free = robot.halted
    executor, timing = ticks()
    with stepped(robot, timing=timing, **HANGS) as loop:
        executor.steps(loop)
    assert "LoopHung: read() hangs" in loop.report().stop.fault
    assert len(robot.sent) == 20


def test_a_robot_without_halt_is_not_watched(insertion: rcmqp.Insertion) -> None:
    robot = Joints(insertion)
    with stepped(robot) as loop:
        loop.cycle()
        assert loop.watchdog is None
    assert not loop.report().halted


def test_a_loop_in_time_is_not_halted_and_leaves_no_thread(insertion: rcmqp.Insertion) -> None:
    before, robot = threading.active_count(), HaltingJoints(insertion)
    report = run(robot, 2.0 * HUNG, lateness=HUNG, hung=4.0)
    assert (report.stop.fault, report.halted, robot.halts) == ("", False, 0)
    assert threading.active_count() == before


@pytest.mark.parametrize("hung", [4.0, 0.1, math.inf, math.nan])
def test_a_watchdog_must_have_more_patience_than_the_loop(
    hung: float, insertion: rcmqp.Insertion
) -> None:
    with pytest.raises(OptionError, match="more than lateness"):
        run(HaltingJoints(insertion), hung=hung)


def test_a_halt_comes_no_later_than_the_patience_allows_by_the_beats() -> None:
    """And none while there are beats; the machine may only make it later."""
    halted, beats = list[float](), list[float]()
    watchdog = Watchdog(lambda: halted.append(monotonic()), 0.2, lambda: "here", lambda: None)
    for _ in range(40):
        beats.append(monotonic())
        watchdog.beat()
        sleep(0.01)
    assert watchdog.settled()
    watchdog.close()
    assert halted[0] - beats[-1] >= 0.2
    assert halted[0] - beats[-1] < FOREVER
    assert len(halted) == 2


def test_a_call_in_the_main_thread_is_left_only_while_it_runs() -> None:
    signals, error = KeptSignals(1.0), LoopHung("x")
    signals.leave(error)  # nobody keeps signals: nothing happens
    with signals.kept():
        signals.leave(error)  # no call
        with pytest.raises(LoopHung, match="x"):
            signals.call(lambda: signals.leave(error))
        assert signals.where() == ""
        assert signals.call(signals.where) == "where"


# cycle() -----------------------------------------------------------------------------------


class Executor:
    """A clock that an executor sets: each look at it takes a microsecond."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        self.now += 1e-6
        return self.now

    def steps(self, loop: RealtimeLoop, gap: Callable[[int], float] = lambda k: T) -> None:
        """A cycle each period until the loop ends."""
        k, due = 0, self.now
        while loop.cycle():
            k, due = k + 1, due + gap(k)
            self.now = due


def ticks() -> tuple[Executor, Ticks]:
    executor = Executor()
    return executor, Ticks(T, 0.0, executor, lambda _: None)


def test_cycles_of_an_executor_send_what_the_loop_sends(insertion: rcmqp.Insertion) -> None:
    """Its commands, then those of the safe stop, to rest; cycle() then does nothing."""
    robot, alone = Joints(insertion), Joints(insertion)
    executor, timing = ticks()
    with stepped(robot, 0.05, timing=timing) as loop:
        assert robot.sent == []
        executor.steps(loop)
        sent = len(robot.sent)
        assert not loop.cycle()
        assert len(robot.sent) == sent

    class Time(Executor):
        def sleep(self, duration: float) -> None:
            self.now += duration

    clock = Time()
    expected = run(alone, 0.05, clock=clock, sleep=clock.sleep)
    report = loop.report()
    assert (report.cycles, report.braking) == (expected.cycles, expected.braking)
    assert (report.stop, report.missed, report.skipped) == (expected.stop, 0, 0)
    np.testing.assert_allclose(robot.sent, alone.sent, rtol=0, atol=1e-3)
    assert np.abs(robot.sent).max() > 0.02
    assert not robot.v.any()


def test_the_time_of_a_cycle_is_the_executors(insertion: rcmqp.Insertion) -> None:
    """One that is slow by a tenth is followed for as long as it likes; what is late is counted."""
    robot = Joints(insertion)
    executor, timing = ticks()
    with stepped(robot, 0.5, timing=timing, lateness=0.02, hung=0.03) as loop:
        executor.steps(loop, lambda k: 3.5 * T if k == 100 else 1.1 * T)
    report = loop.report()
    assert report.stop.fault == ""
    assert report.skipped == pytest.approx(2.4 + 0.1 * report.cycles, abs=1.1)
    assert report.wake.worst == pytest.approx(2.5 * T, abs=0.01 * T)
    assert report.cycles - report.braking == pytest.approx(0.5 / (1.1 * T), abs=5)


def test_a_call_that_comes_too_early_does_nothing(insertion: rcmqp.Insertion) -> None:
    robot = Joints(insertion)
    executor, timing = ticks()
    with stepped(robot, timing=timing) as loop:
        for _ in range(10):
            assert loop.cycle()
            assert loop.cycle()
            executor.now += 0.4 * T
            assert loop.cycle()
            executor.now += 0.6 * T
        assert len(robot.sent) == 10
        executor.steps(loop, lambda k: loop.stop() or T)  # type: ignore[func-returns-value]


def test_a_cycle_that_is_called_too_late_ends_in_the_safe_stop(insertion: rcmqp.Insertion) -> None:
    robot = Joints(insertion)
    executor, timing = ticks()
    with stepped(robot, timing=timing) as loop:
        executor.steps(loop, lambda k: 5.0 if k == 10 else T)
    assert "LoopFault: a command was 4.999" in loop.report().stop.fault
    assert not robot.v.any()
    assert len(robot.sent) > HOLD / T


def test_one_call_sends_one_command_even_where_that_took_too_long(
    insertion: rcmqp.Insertion,
) -> None:
    robot = Joints(insertion)
    executor, timing = ticks()
    usual = robot.send

    def slow(v: Array) -> None:
        usual(v)
        executor.now += 5.0 * (len(robot.sent) == 10)

    robot.send = slow  # type: ignore[method-assign]
    with stepped(robot, timing=timing) as loop:
        for k in range(1, 12):
            loop.cycle()
            assert len(robot.sent) == k
            executor.now += T
        assert "LoopFault: send() took until 5" in loop.report().stop.fault
        executor.steps(loop)
    assert not robot.v.any()


@pytest.mark.parametrize("how", ["leaves", "raises", "asks"])
def test_an_executor_that_gives_up_leaves_an_arm_at_rest(
    how: str, insertion: rcmqp.Insertion
) -> None:
    robot = Joints(insertion)
    outcome = pytest.raises(ValueError, match="mine") if how == "raises" else None
    with outcome or contextlib.nullcontext(), stepped(robot) as loop:
        while len(robot.sent) < 20:
            loop.cycle()
            sleep(T)
        assert robot.v.any()
        if how == "raises":
            raise ValueError("mine")
        if how == "asks":
            loop.stop()
            while loop.cycle():
                sleep(T)
    fault = {"raises": "ValueError: mine"}.get(how, "asked to stop")
    assert loop.report().stop.fault == fault
    assert loop.ended
    assert not robot.v.any()
    assert len(robot.sent) > HOLD / T


def test_an_executor_that_stops_calling_is_halted(insertion: rcmqp.Insertion) -> None:
    robot = HaltingJoints(insertion)
    with stepped(robot, **HANGS) as loop:
        while len(robot.sent) < 20:
            loop.cycle()
            sleep(T)
        assert robot.halted.wait(FOREVER)
        assert not loop.cycle()
    assert "LoopHung: the loop does not run" in loop.report().stop.fault
    assert len(robot.sent) == 20
    assert not robot.v.any()


def test_nothing_is_sent_where_an_executor_never_began(insertion: rcmqp.Insertion) -> None:
    robot = HaltingJoints(insertion)
    with stepped(robot):
        pass
    assert robot.sent == []
    assert robot.halts == 0


# Waiting -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("5 2000000000 3\n", 2.0), ("0 0 0\n", math.nan), ("?", math.nan), (None, math.nan)],
)
def test_the_time_waited_is_the_kernels(text: str | None, seconds: float, tmp_path: Path) -> None:
    path = tmp_path / "schedstat"
    if text is not None:
        path.write_text(text)
    np.testing.assert_equal(time_waited(str(path)), seconds)


def test_the_report_has_the_time_waited_in_the_loop(
    insertion: rcmqp.Insertion, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts = iter([3.0, 3.25])
    monkeypatch.setattr("rcmqp.realtime.loop.time_waited", lambda: next(counts))
    report = run(Joints(insertion), 0.02)
    assert report.waited == 0.25
    assert "| waited for a processor | 250 ms in all |" in report.as_markdown()
    monkeypatch.setattr("rcmqp.realtime.loop.time_waited", lambda: math.nan)
    assert "not counted by this system" in run(Joints(insertion), 0.02).as_markdown()
