"""The real-time loop against a clock that tests set, and a robot that does as it is told."""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import io
import signal
import threading
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from helpers import across
from numpy.typing import ArrayLike
from rich.console import Console

import rcmqp
from rcmqp.controllers import Command, Controller
from rcmqp.controllers.braking import Brake, braking, nearest
from rcmqp.errors import OptionError, RcmqpError
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp import Hierarchy
from rcmqp.qp.levels import Bounds, Level
from rcmqp.realtime.checks import CommandCheck, LoopFault
from rcmqp.realtime.deadlines import Deadlines
from rcmqp.realtime.latency import EDGES, LatencyCounter
from rcmqp.realtime.report import LoopReport
from rcmqp.realtime.run import HOLD, WARM_UP, Stamped, run_realtime
from rcmqp.references.governor import Governed
from rcmqp.references.paths import ViewMoves
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import rcm_error

T = 0.001
TICK = 1e-6
HELD = round(HOLD / T)


class Clock:
    """Each look at it takes a microsecond; sleeping takes as long as asked, and ``extra``."""

    def __init__(self, extra: float = 0.0) -> None:
        self.now, self.extra = 100.0, extra
        self.slept: list[float] = []

    def __call__(self) -> float:
        self.now += TICK
        return self.now

    def sleep(self, duration: float) -> None:
        assert duration > 0.0
        self.slept.append(duration)
        self.now += duration + self.extra


@dataclass
class Arm:
    """Joints that move as commanded; ``on_read`` and ``on_send`` are called with a count."""

    insertion: rcmqp.Insertion
    clock: Clock
    on_read: Callable[[int], None] = lambda k: None
    on_send: Callable[[int], None] = lambda k: None
    spoil: Callable[[int, Array], Array] = lambda k, q: q
    spoil_v: Callable[[int, Array], Array] = lambda k, v: v
    read_at: list[float] = field(default_factory=list)
    sent: list[Array] = field(default_factory=list)
    sent_at: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.q, self.v = np.array(self.insertion.q_start), np.zeros(self.insertion.arm.nv)

    def moving(self, v: Array) -> Arm:
        """The same, already moving."""
        self.v = v
        return self

    def read(self) -> tuple[ArrayLike, ArrayLike]:
        self.read_at.append(self.clock.now)
        self.on_read(len(self.sent))
        k = len(self.sent)
        return self.spoil(k, self.q.copy()), self.spoil_v(k, self.v)

    def send(self, v: Array) -> None:
        self.on_send(len(self.sent))
        assert not v.flags.writeable
        self.sent.append(v.copy())
        self.sent_at.append(self.clock.now)
        self.q, self.v = self.insertion.arm.integrate(self.q, v, T), v


@pytest.fixture(scope="module")
def insertion() -> rcmqp.Insertion:
    return rcmqp.Insertion.on_shaft(rcmqp.load_arm("panda"), rcmqp.Instrument())


def view(insertion: rcmqp.Insertion, t: float) -> Stamped:
    """Looking ever further to the right, ever faster from t = 0 on, up to 0.3 rad/s."""
    rising = min(t, 0.15)
    command = rcmqp.ViewCommand(alpha=rising**2 + 0.3 * (t - rising), alpha_dot=2.0 * rising)
    return Stamped(rcmqp.view_pose(insertion.x_rcm, command), t)


def careful(insertion: rcmqp.Insertion) -> Controller:
    """A controller that keeps every joint limit."""
    return rcmqp.make_controller("hierarchical_qp", insertion, T)


def run(
    robot: Arm,
    duration: float = 0.02,
    references: Callable[[float], Stamped] | None = None,
    controller: Controller | None = None,
    **options: Any,
) -> LoopReport:
    insertion = robot.insertion
    made = rcmqp.make_controller("dual_quaternion", insertion, T, feed_forward=True)
    return run_realtime(
        robot,
        controller or made,
        references or (lambda t: view(insertion, t)),
        duration,
        clock=robot.clock,
        sleep=robot.clock.sleep,
        **options,
    )


# Time --------------------------------------------------------------------------------------


def test_cycles_keep_to_the_grid_whatever_each_takes(insertion: rcmqp.Insertion) -> None:
    clock = Clock()
    rng = np.random.default_rng(7)

    def work(k: int) -> None:
        clock.now += rng.uniform(0.0, 0.7 * T)

    robot = Arm(insertion, clock, on_read=work)
    report = run(robot, 0.5)
    begun = np.array(robot.read_at[WARM_UP : WARM_UP + 500])
    np.testing.assert_allclose(begun - begun[0], T * np.arange(500), rtol=0, atol=5 * TICK)
    assert (report.cycles - report.braking, report.missed, report.skipped) == (500, 0, 0)
    assert report.wake.worst < 5 * TICK
    assert 0.6 * T < report.answer.worst < 0.75 * T


def test_the_last_of_each_wait_is_spun(insertion: rcmqp.Insertion) -> None:
    """A sleep that lasts 150 us too long is punctual with 200 us to spin, and not with none."""
    punctual = run(Arm(insertion, clock := Clock(extra=150e-6)), spin=200e-6)
    assert punctual.wake.worst < 5 * TICK
    assert max(clock.slept) < T - 200e-6
    late = run(Arm(insertion, Clock(extra=150e-6)), spin=0.0)
    assert late.wake.quantile(0.01) > 100e-6


def test_a_slow_cycle_is_counted_and_the_rest_stay_on_the_grid(insertion: rcmqp.Insertion) -> None:
    clock = Clock()

    def work(k: int) -> None:
        clock.now += 3.4 * T if k == 5 else 0.2 * T

    robot = Arm(insertion, clock, on_read=work)
    report = run(robot, 0.02, controller=careful(insertion))
    assert (report.missed, report.skipped) == (1, 2)  # it was due at 5, the next that runs at 8
    assert report.cycles - report.braking == 18
    begun = np.array(robot.read_at[WARM_UP : WARM_UP + 18])
    begun = (begun - begun[0]) / T
    np.testing.assert_allclose(begun[:6], np.arange(6), rtol=0, atol=0.01)
    np.testing.assert_allclose(begun[6], 8.4, rtol=0, atol=0.05)  # at once, it is due already
    np.testing.assert_allclose(begun[7:], np.arange(9, 20), rtol=0, atol=0.01)
    assert report.answer.worst == pytest.approx(3.4 * T, rel=0.01)
    assert report.answer.worst_at == pytest.approx(8.4 * T, rel=0.01)
    assert report.stop.fault == ""


def test_the_first_cycle_is_a_period_from_the_beginning(insertion: rcmqp.Insertion) -> None:
    """What was begun with the loop, such as switching the collector off, has time to end."""
    timing = Deadlines(T, 0.0, clock := Clock(), clock.sleep)
    clock.now += 7.0
    timing.begin()
    began = clock.now
    assert timing.due == 0.0
    assert timing.now() == pytest.approx(-T, abs=2 * TICK)
    timing.wait()
    assert clock.now - began == pytest.approx(T, abs=3 * TICK)


# What is sent ------------------------------------------------------------------------------


def test_the_warm_up_sends_nothing_and_leaves_no_trace(insertion: rcmqp.Insertion) -> None:
    robot = Arm(insertion, Clock())
    resets: list[int] = []

    class Counting(rcmqp.Controller):
        name: ClassVar[str] = "counting"

        def reset(self) -> None:
            resets.append(len(robot.read_at))

        def _step(self, state: ArmState, reference: Reference) -> Command:
            return Command(np.full(7, 1e-3))

    run(robot, controller=Counting(insertion, T))
    assert resets == [WARM_UP]
    assert len(robot.sent) == 20 + 1 + HELD
    assert len(robot.read_at) == WARM_UP + len(robot.sent)  # and while braking: it keeps in touch


def test_commands_are_those_of_the_controller_until_the_end(insertion: rcmqp.Insertion) -> None:
    robot = Arm(insertion, Clock())
    run(robot, 0.02)
    controller = rcmqp.make_controller("dual_quaternion", insertion, T, feed_forward=True)
    q = insertion.q_start
    for k in range(20):
        state = insertion.state(q)
        np.testing.assert_allclose(
            robot.sent[k],
            controller.step(state, view(insertion, k * T).reference).v,
            rtol=0,
            atol=1e-3,  # the loop looks at its clock a few microseconds later
        )
        q = insertion.arm.integrate(q, robot.sent[k], T)


def test_the_controller_is_told_the_last_command_and_at_the_start_the_measured_velocity(
    insertion: rcmqp.Insertion,
) -> None:
    told: list[Array] = []

    class Listening(rcmqp.Controller):
        name: ClassVar[str] = "listening"

        def _step(self, state: ArmState, reference: Reference) -> Command:
            told.append(state.v)
            return Command(np.full(7, 0.5 + 1e-4 * len(told)))

    robot = Arm(insertion, Clock(), spoil_v=lambda k, v: (v + 0.5).tolist())
    run(robot, controller=Listening(insertion, T))
    assert np.array_equal(told[: WARM_UP + 1], np.full((WARM_UP + 1, 7), 0.5))
    assert np.array_equal(told[WARM_UP + 1 :], robot.sent[:19])


def test_references_that_watch_are_shown_each_state_after_they_were_asked(
    insertion: rcmqp.Insertion,
) -> None:
    robot, seen = Arm(insertion, Clock()), list[tuple[float, Array]]()

    class Watcher:
        at = 0.0

        def __call__(self, t: float) -> Stamped:
            self.at = t
            return view(insertion, t)

        def see(self, state: ArmState) -> None:
            seen.append((self.at, state.q))

    run(robot, references=Watcher())
    assert len(seen) == WARM_UP + 20
    plain = Arm(insertion, Clock())
    run(plain)
    assert np.array_equal(robot.sent, plain.sent)
    assert len({at for at, _ in seen[WARM_UP:]}) == 20
    q = insertion.q_start
    for k, (_, at) in enumerate(seen[WARM_UP:]):
        assert np.array_equal(at, q)
        q = insertion.arm.integrate(q, robot.sent[k], T)


@pytest.mark.parametrize("stuck", [False, True])
def test_a_governed_path_waits_for_an_arm_that_is_stuck(
    stuck: bool, insertion: rcmqp.Insertion
) -> None:
    """Joints that do not move; others do, and the path is on time."""
    robot = Arm(insertion, Clock(), spoil=lambda k, q: insertion.q_start if stuck else q)
    path = ViewMoves(views=((0.3, 0.0, 0.0, 0.0),), move=1.0)
    references = Governed(path, insertion)
    report = run(robot, references=references, duration=1.0, controller=careful(insertion))
    assert report.stop.fault == ""
    clock = references.clock
    if stuck:
        assert clock.rate < 0.1
        assert clock.time < 0.5
    else:
        assert clock.rate == 1.0
        assert 1.0 - 2 * T < clock.time < 1.0 + 2 * T


def nan_at(k: int, q: Array) -> Array:
    return q * np.nan if k == 10 else q


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


@dataclass(frozen=True, eq=False)
class Spoilt(Controller):
    """Answers ``answer`` from its tenth command on, or raises it, past the usual safe stop."""

    name: ClassVar[str] = "spoilt"

    robot: Any = None
    answer: Any = None
    before: Any = None

    def _step(self, state: ArmState, reference: Reference) -> Command:
        if len(self.robot.sent) < 10:
            if self.before is not None:
                return Command(self.before)
            return Command((len(self.robot.sent) + 1) * _along(self.insertion, state))
        if isinstance(self.answer, Exception):
            raise self.answer
        return Command(self.answer)

    step = _step


def _along(insertion: rcmqp.Insertion, state: ArmState) -> Array:
    """About 5 mrad/s of each joint, the shaft's point at the trocar at rest."""
    depth = float(state.oMe.actInv(np.array(insertion.trocar.pivot))[2])
    rows, v = across(state.J_local, depth), np.full(7, 5e-3)
    return np.asarray(v - np.linalg.pinv(rows) @ rows @ v)


FAULTS: dict[str, tuple[str, Callable[[rcmqp.Insertion, Clock], dict[str, Any]]]] = {
    "NaN reading": ("not finite", lambda i, c: {"spoil": nan_at}),
    "infinite reading": ("configuration q is not finite", lambda i, c: {"spoil": inf_at}),
    "NaN velocity": ("joint velocity v is not finite", lambda i, c: {"spoil_v": nan_at}),
    "failed reading": ("OSError: gone", lambda i, c: {"on_read": fails_at(OSError("gone"))}),
    "short reading": (
        r"shape (6,), it must be (7,)",
        lambda i, c: {"spoil": lambda k, q: q[:6] if k == 10 else q},
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


def assert_stopped(robot: Arm, report: LoopReport, fault: str) -> None:
    """Ten commands, then down to zero inside the limits, then zero, and a report that says so."""
    assert fault in report.stop.fault
    assert report.stop.at == pytest.approx(10 * T, abs=0.3 * T)
    v, arm = np.array(robot.sent), robot.insertion.arm
    assert np.abs(v[9]).max() > 1e-2
    steps = np.abs(np.diff(v[9:], axis=0))
    assert (steps <= arm.acceleration * T * (1.0 + 1e-9)).all()
    slower = np.diff(np.linalg.norm(v[9:], axis=1))
    assert (slower <= 0.0).all()
    assert slower[0] < 0.0  # not the last command once more
    assert (v[-HELD:] == 0.0).all()
    assert len(v) == 10 + report.braking
    assert report.unsent == 0
    assert robot.sent_at[10] - robot.sent_at[9] < 1.2 * T  # at once, not a cycle later


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


# Signals -----------------------------------------------------------------------------------

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
    monkeypatch.setattr("rcmqp.realtime.signals.monotonic", lambda: clock.now)

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


# The safe stop -----------------------------------------------------------------------------


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
    remedy = r".* give those of the arm with load_arm\(\.\.\., acceleration=\.\.\., jerk=\.\.\.\)"
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


# Around it ---------------------------------------------------------------------------------


@pytest.mark.parametrize("enabled", [True, False])
def test_garbage_is_not_collected_in_the_loop_and_again_after_it(
    enabled: bool, insertion: rcmqp.Insertion
) -> None:
    seen: list[tuple[bool, bool]] = []
    robot = Arm(insertion, Clock())

    def look(k: int) -> None:
        if k in (0, 19, 200):
            seen.append((gc.isenabled(), gc.get_freeze_count() > 0))

    robot.on_send = look
    before = gc.isenabled()
    try:
        (gc.enable if enabled else gc.disable)()
        run(robot)
        assert set(seen) == {(False, True)}
        assert gc.isenabled() == enabled
        assert gc.get_freeze_count() == 0
    finally:
        (gc.enable if before else gc.disable)()


def test_garbage_of_before_is_gone_when_the_loop_begins(insertion: rcmqp.Insertion) -> None:
    class Ring:
        pass

    ring = Ring()
    ring.itself = ring  # type: ignore[attr-defined]
    seen, gone = weakref.ref(ring), list[bool]()
    del ring
    robot = Arm(insertion, Clock(), on_send=lambda k: gone.append(seen() is None))
    run(robot)
    assert all(gone)


@pytest.mark.parametrize(
    "options",
    [{"duration": 0.0}, {"duration": np.inf}, {"reference_age": np.nan}, {"spin": 0.002}],
    ids=str,
)
def test_times_that_make_no_sense_are_refused(
    options: dict[str, Any], insertion: rcmqp.Insertion
) -> None:
    robot = Arm(insertion, Clock())
    with pytest.raises(OptionError, match=next(iter(options))):
        run(robot, **options)
    assert robot.read_at == []


def test_cycles_that_the_controller_itself_stops_are_counted(insertion: rcmqp.Insertion) -> None:
    robot = Arm(insertion, Clock())

    def references(t: float) -> Stamped:
        good = view(insertion, t)
        bad = dataclasses.replace(good.reference, pivot=np.full(3, np.nan))
        return Stamped(bad, t) if len(robot.sent) in (0, *range(15, 20)) else good

    controller = rcmqp.make_controller("hierarchical_qp", insertion, T)
    report = run(robot, 0.02, references, controller)
    assert report.controller_stops == 6  # those of the warm-up not
    assert report.stop.fault == ""


def test_delays_are_counted_to_the_width_of_a_bin() -> None:
    rng = np.random.default_rng(7)
    delays = 10.0 ** rng.uniform(-5.5, -1.5, 2000)
    counter = LatencyCounter()
    for k, delay in enumerate(delays):
        counter.add(float(delay), float(k))
    found = counter.latency()
    assert found.total == 2000
    assert (found.worst, found.worst_at) == (delays.max(), float(delays.argmax()))
    for share in (0.0, 0.01, 0.5, 0.99, 1.0):
        exact = np.quantile(delays, share, method="inverted_cdf")
        assert exact <= found.quantile(share) <= 1.13 * exact
    for bound in (EDGES[0], 1e-3, EDGES[-1]):
        assert found.above(bound) == (delays > bound).sum()


def test_no_delay_or_one_beyond_every_bin_is_told_too() -> None:
    counter = LatencyCounter()
    assert counter.latency().quantile(0.5) == 0.0
    counter.add(100.0, 1.0)
    assert counter.latency().quantile(0.5) == 100.0
    assert counter.latency().above(EDGES[-1]) == 1


def test_the_report_prints_what_it_holds(insertion: rcmqp.Insertion) -> None:
    robot = Arm(insertion, Clock(), spoil=nan_at)
    report = run(robot, 1.0)
    stream = io.StringIO()
    Console(file=stream, width=200).print(report)
    for text in (report.as_markdown(), stream.getvalue()):
        assert "dual_quaternion" in text
        assert f"brake, {report.braking} cycles" in text
        assert "InvalidCommand: configuration q is not finite" in text
    rows = report.histogram()
    for column, delays in ((1, report.wake), (2, report.answer)):
        assert sum(int(row[column]) for row in rows) == delays.total == report.cycles
    assert f"| 50 us to 100 us | {rows[1][1]} | {rows[1][2]} |" in report.as_markdown()


def test_the_stop_has_run_once_before_anything_moves(
    insertion: rcmqp.Insertion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of it but the first cycle's wait: the joints are as if moving."""
    robot, found = Arm(insertion, Clock()), list[tuple[int, bool]]()

    def told(*args: Any) -> Iterator[Array]:
        found.append((len(robot.sent), bool(np.any(args[2]))))
        return braking(*args)

    monkeypatch.setattr("rcmqp.realtime.loop.braking", told)
    run(robot)
    assert found == [(0, True), (20, True)]
