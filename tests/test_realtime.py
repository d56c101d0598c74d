"""The real-time loop against a clock that tests set, and a robot that does as it is told."""

from __future__ import annotations

import dataclasses
import gc
import io
import weakref
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
import pytest
from fake_robot import HELD, TICK, Arm, Clock, T, careful, nan_at, run, view
from rich.console import Console

import rcmqp
from rcmqp.controllers import Command
from rcmqp.controllers.braking import braking
from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.latency import EDGES, Deadlines, LatencyCounter
from rcmqp.realtime.run import WARM_UP, Stamped
from rcmqp.references.governor import Governed
from rcmqp.references.paths import ViewMoves
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState

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
