"""A run of the real-time loop in a file: what was read, asked and sent, whatever the disk does."""

from __future__ import annotations

import itertools
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

import rcmqp
from rcmqp import Run, compute_metrics
from rcmqp.cli import main
from rcmqp.controllers import Controller
from rcmqp.errors import OptionError, RunFileError
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.checks import LoopFault
from rcmqp.realtime.latency import Ticks
from rcmqp.realtime.loopback import run_loopback
from rcmqp.realtime.report import LoopReport
from rcmqp.realtime.run import HOLD, RealtimeLoop, Stamped, run_realtime
from rcmqp.references.paths import Circle
from rcmqp.references.view import carried, view_pose
from rcmqp.runs import loop_record
from rcmqp.runs.loop_record import LoopRecorder
from rcmqp.runs.loop_writer import KILLED

T = 0.001
HELD = round(HOLD / T)
DRIFT = np.array([0.002, 0.0, 0.001])
"""Velocity of the trocar [m/s]."""


@dataclass
class Joints:
    """Joints that move as commanded, on a clock of their own; ``on_send`` is called with a count.

    ``spoil`` is done to each reading.
    """

    insertion: rcmqp.Insertion
    on_send: Callable[[int], None] = lambda k: None
    spoil: Callable[[int, Array], Array] = lambda k, q: q
    now: float = 0.0
    read_q: list[Array] = field(default_factory=list)
    asked: list[Stamped] = field(default_factory=list)
    sent: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.q, self.v = np.array(self.insertion.q_start), np.zeros(self.insertion.arm.nv)

    def clock(self) -> float:
        self.now += 1e-6
        return self.now

    def sleep(self, duration: float) -> None:
        self.now += duration

    def read(self) -> tuple[ArrayLike, ArrayLike]:
        q = self.spoil(len(self.sent), self.q.copy())
        self.read_q.append(q)
        return q, self.v

    def send(self, v: Array) -> None:
        self.on_send(len(self.sent))
        self.sent.append(v.copy())
        self.q, self.v = self.insertion.arm.integrate(self.q, v, T), v


@pytest.fixture(scope="module")
def insertion() -> rcmqp.Insertion:
    return rcmqp.Insertion.on_shaft(rcmqp.load_arm("panda"), rcmqp.Instrument(), depth=0.1)


@pytest.fixture(scope="module")
def controller(insertion: rcmqp.Insertion) -> Controller:
    return rcmqp.make_controller("hierarchical_qp", insertion, T)


def circles(robot: Joints) -> Callable[[float], Stamped]:
    """Circles of the tip about a trocar that drifts; the robot remembers them."""
    path, insertion = Circle(duration=2.0), robot.insertion

    def newest(t: float) -> Stamped:
        view = path.command(t, insertion.tip_depth)
        x_rcm = carried(insertion.x_rcm, DRIFT * t)
        robot.asked.append(Stamped(view_pose(x_rcm, view, DRIFT), t))
        return robot.asked[-1]

    return newest


def run(robot: Joints, controller: Controller, record: LoopRecorder, cycles: int) -> LoopReport:
    """As fast as the machine can: time is the robot's."""
    return run_realtime(
        robot,
        controller,
        circles(robot),
        cycles * T - 0.5 * T,
        record=record,
        clock=robot.clock,
        sleep=robot.sleep,
    )


# What is in the file -----------------------------------------------------------------------


def test_the_file_has_what_was_read_asked_and_sent(
    insertion: rcmqp.Insertion, controller: Controller, tmp_path: Path
) -> None:
    robot = Joints(insertion)
    report = run(robot, controller, LoopRecorder(tmp_path / "run.h5", controller, "mine"), 300)
    found = Run.load(tmp_path / "run.h5")
    n = report.cycles
    assert report.recorded == f"{n} cycles in {tmp_path / 'run.h5'}"
    assert f"| recorded | {report.recorded} |" in report.as_markdown()
    assert (len(found.time), found.scenario.name) == (n, "mine")
    np.testing.assert_allclose(found.time, T * np.arange(n), rtol=0, atol=1e-12)
    assert np.array_equal(found.v, robot.sent)
    assert np.array_equal(found.q_measured, robot.read_q[-n:])
    assert np.array_equal(found.q, found.q_measured)
    assert np.array_equal(found.v_measured[1:], found.v[:-1])
    assert np.array_equal(found.v_actual, found.v_measured)
    asked = [newest.reference for newest in robot.asked[-300:]]
    assert np.array_equal(np.abs(found.x_d[:300]), np.abs([each.x_d for each in asked]))
    assert np.array_equal(found.pivot[:300], [each.pivot for each in asked])
    assert np.ptp(found.pivot[:, 0]) > 5e-4
    assert np.array_equal(found.x_d[300:], np.tile(found.x_d[299], (n - 300, 1)))
    assert found.options == controller.options
    assert found.given == controller.given
    assert found.urdf_sha256 == insertion.arm.sha256
    names = {*controller.diagnostics, *loop_record.TIMES, "safe_stop"}
    assert names >= set(found.diagnostics) >= {*loop_record.TIMES, "safe_stop", "scale"} & names
    assert (found.diagnostics["sent_after"] > 0.0).all()
    assert (found.diagnostics["began_late"][:300] >= 0.0).all()


def test_the_safe_stop_is_part_of_the_run_and_marked(
    insertion: rcmqp.Insertion, controller: Controller, tmp_path: Path
) -> None:
    robot = Joints(insertion)
    report = run(robot, controller, LoopRecorder(tmp_path / "run.h5", controller), 300)
    found = Run.load(tmp_path / "run.h5")
    assert report.braking > HELD
    (reason,) = found.stops
    assert reason == "the real-time loop brought the arm to rest, as it ends every run"
    assert list(found.stops[reason]) == list(range(300, report.cycles))
    expected = np.repeat([0.0, 1.0], [300, report.braking])
    assert np.array_equal(found.diagnostics["safe_stop"], expected)
    assert not found.v[-HELD:].any()
    metrics = compute_metrics(found)
    assert metrics.errors_until_s == pytest.approx(0.299)
    assert metrics.duration_s == pytest.approx(T * (report.cycles - 1))
    assert 0.0 < metrics.solve_time_median_us < 1e5  # the stop has none


def test_a_loop_that_a_busy_machine_steps_late_says_how_late_and_how_far_behind(
    insertion: rcmqp.Insertion,
    controller: Controller,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Each tenth cycle of a hundred begins four periods late: 40 periods in all."""
    robot, file = Joints(insertion), tmp_path / "run.h5"
    timing = Ticks(T, 0.0, robot.clock, robot.sleep)
    record, late = LoopRecorder(file, controller), []
    with RealtimeLoop(
        robot, controller, circles(robot), 10.0, lateness=1.0, record=record, timing=timing
    ) as loop:
        start = robot.now
        for k in range(100):
            late.append(k % 10 == 9)
            start += 5 * T if late[-1] else T
            robot.now = start
            loop.cycle()
        loop.stop()
        while loop.cycle():
            robot.now += T
    found = Run.load(file)
    began = found.diagnostics["began_late"][:100]
    expected = np.where(late, 4 * T, 0.0)
    np.testing.assert_allclose(began, expected, rtol=0, atol=1e-4)
    metrics = compute_metrics(found)
    rows = len(found.time)
    clock = found.time[-1] - found.time[0]
    assert metrics.behind_s == pytest.approx(clock - (rows - 1) * T, abs=1e-9)
    assert metrics.behind_s == pytest.approx(40 * T, abs=2e-3)
    assert metrics.late_share == pytest.approx(10 / rows, abs=1e-9)
    assert metrics.behind_share == pytest.approx(metrics.behind_s / clock, rel=1e-6)
    with pytest.raises(SystemExit, match="0"):
        main(["show", str(file)])
    said = capsys.readouterr()
    assert "cycles late" in said.out
    assert "behind the clock" in " ".join(said.err.split())


def test_cycles_that_a_loop_of_its_own_begins_late_are_counted_though_none_is_skipped(
    insertion: rcmqp.Insertion, controller: Controller, tmp_path: Path
) -> None:
    robot, record = Joints(insertion), LoopRecorder(tmp_path / "run.h5", controller)

    def oversleep(seconds: float) -> None:
        robot.sleep(seconds)
        robot.now += 0.8 * T

    run_realtime(
        robot,
        controller,
        circles(robot),
        300 * T,
        lateness=1.0,
        record=record,
        clock=robot.clock,
        sleep=oversleep,
    )
    metrics = compute_metrics(Run.load(tmp_path / "run.h5"))
    assert metrics.late_share > 0.5
    assert metrics.behind_s == pytest.approx(0.0, abs=1e-9)


def test_a_loop_in_time_is_not_behind_the_clock(
    insertion: rcmqp.Insertion, controller: Controller, tmp_path: Path
) -> None:
    run(Joints(insertion), controller, LoopRecorder(tmp_path / "run.h5", controller), 300)
    metrics = compute_metrics(Run.load(tmp_path / "run.h5"))
    assert metrics.late_share == 0.0
    assert metrics.behind_s == pytest.approx(0.0, abs=1e-9)


def test_a_fault_is_told_in_the_file(
    insertion: rcmqp.Insertion, controller: Controller, tmp_path: Path
) -> None:
    """A reading is not finite, and in the stop, too, nothing can be read."""
    robot = Joints(insertion, spoil=lambda k, q: q if k < 50 else np.nan * q)
    report = run(robot, controller, LoopRecorder(tmp_path / "run.h5", controller), 300)
    found = Run.load(tmp_path / "run.h5")
    assert "not finite" in report.stop.fault
    (reason,) = found.stops
    assert reason.endswith(f"rest: {report.stop.fault}")
    assert found.stops[reason][0] == 50
    assert np.isnan(found.q_measured[50:]).all()
    assert np.array_equal(found.q[50:], np.tile(found.q[49], (report.cycles - 50, 1)))


def test_a_skipped_cycle_has_no_row(
    insertion: rcmqp.Insertion, controller: Controller, tmp_path: Path
) -> None:
    robot = Joints(insertion)
    robot.on_send = lambda k: robot.sleep(3.5 * T if k == 20 else 0.0)
    report = run(robot, controller, LoopRecorder(tmp_path / "run.h5", controller), 60)
    found = Run.load(tmp_path / "run.h5")
    assert report.skipped > 0
    rows = np.round(found.time / T).astype(int)
    assert list(rows[:24]) == [*range(21), 23, 24, 25]
    assert found.diagnostics["sent_after"][20] > 3.5 * T


def test_a_loop_that_is_stepped_is_recorded_too(
    insertion: rcmqp.Insertion, controller: Controller, tmp_path: Path
) -> None:
    robot, record = Joints(insertion), LoopRecorder(tmp_path / "run.h5", controller)
    with RealtimeLoop(
        robot, controller, circles(robot), 1.0, lateness=5.0, hung=9.0, record=record
    ) as loop:
        for _ in range(30):
            loop.cycle()
            time.sleep(T)
    found = Run.load(tmp_path / "run.h5")
    assert np.array_equal(found.v, robot.sent)
    assert any("asked to stop" in reason for reason in found.stops)
    assert loop.report().recorded.startswith(f"{len(robot.sent)} cycles in ")
    assert record.whole


def test_what_cannot_be_recorded_is_refused_before_anything_moves(
    insertion: rcmqp.Insertion, controller: Controller, tmp_path: Path
) -> None:
    with pytest.raises(RunFileError, match="there is no folder"):
        LoopRecorder(tmp_path / "none" / "run.h5", controller)
    (tmp_path / "later").mkdir()
    record, robot = LoopRecorder(tmp_path / "later" / "run.h5", controller), Joints(insertion)
    (tmp_path / "later").rmdir()
    with pytest.raises(RunFileError, match=r"run\.h5: cannot be recorded: there is no folder"):
        run(robot, controller, record, 10)
    assert not robot.sent
    moving = Joints(insertion)
    moving.v = 9.0 * insertion.arm.velocity
    with pytest.raises(LoopFault, match="moves before the loop begins"):
        run(moving, controller, LoopRecorder(tmp_path / "run.h5", controller), 10)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("weight", [np.ones(2), np.int64(3)])
def test_an_option_that_no_file_holds_is_named_before_a_process_starts(
    weight: object, insertion: rcmqp.Insertion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @dataclass(frozen=True, eq=False)
    class Weighted(rcmqp.controllers.DualQuaternion):
        weight: object = None

    monkeypatch.setattr(subprocess, "Popen", None)
    law, robot = Weighted(insertion, T, weight=weight), Joints(insertion)
    record = LoopRecorder(tmp_path / "run.h5", law)
    with pytest.raises(OptionError, match=r"^weight = .*, of type \w+, cannot be kept"):
        run(robot, law, record, 10)
    assert not robot.sent


def test_a_recorder_is_not_used_twice(
    insertion: rcmqp.Insertion,
    controller: Controller,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record, again = LoopRecorder(tmp_path / "run.h5", controller), Joints(insertion)
    run(Joints(insertion), controller, record, 10)
    monkeypatch.setattr(subprocess, "Popen", None)
    with pytest.raises(OptionError, match=r"run\.h5: a LoopRecorder records one loop; make"):
        run(again, controller, record, 10)
    assert not again.sent


# Disks and processes -----------------------------------------------------------------------


def process_of(record: LoopRecorder) -> int:
    """Number of the process that writes."""
    assert record._process is not None
    return record._process.pid


def test_a_disk_that_is_too_slow_ends_the_recording_and_not_the_loop(
    insertion: rcmqp.Insertion,
    controller: Controller,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The process that writes stands still until the loop is over."""
    most, waited = 300, list[int]()
    monkeypatch.setattr(loop_record, "BACKLOG", most)
    record, robot = LoopRecorder(tmp_path / "run.h5", controller), Joints(insertion)

    def stand_still(k: int) -> None:
        waited.append(len(record._rows))
        if k in (0, 2000 + HELD - 1):
            os.kill(process_of(record), signal.SIGCONT if k else signal.SIGSTOP)

    robot.on_send = stand_still
    report = run(robot, controller, record, 2000)
    assert (report.stop.fault, report.stop.at > 1.9) == ("", True)
    assert len(robot.sent) == report.cycles > 2000 + HELD
    assert max(waited) == most
    found = Run.load(tmp_path / "run.h5")
    assert most <= len(found.time) < 2000
    assert np.array_equal(found.v, robot.sent[: len(found.time)])
    why = f"the disk is too slow, {most} cycles waited to be written"
    assert (
        report.recorded
        == f"{len(found.time)} cycles in {tmp_path / 'run.h5'}; it ends early: {why}"
    )
    assert not record.whole
    assert found.stops == {f"recorded until here only: {why}": [len(found.time) - 1]}


def test_a_full_disk_ends_the_recording_and_not_the_loop(
    insertion: rcmqp.Insertion, controller: Controller, tmp_path: Path
) -> None:
    record, robot = LoopRecorder(tmp_path / "run.h5", controller), Joints(insertion)

    def fill(k: int) -> None:
        if k == 0:
            resource.prlimit(process_of(record), resource.RLIMIT_FSIZE, (100_000, 100_000))

    robot.on_send = fill
    report = run(robot, controller, record, 1500)
    assert (report.stop.fault, len(robot.sent)) == ("", report.cycles)
    assert report.recorded == "nothing: could not be written: File too large"
    assert not record.whole
    assert list(tmp_path.iterdir()) == []


def test_the_loop_goes_on_without_the_process_that_writes(
    insertion: rcmqp.Insertion, controller: Controller, tmp_path: Path
) -> None:
    """Its part file is left, and swept by the next that writes there."""
    record, robot = LoopRecorder(tmp_path / "run.h5", controller), Joints(insertion)
    robot.on_send = lambda k: os.kill(process_of(record), signal.SIGKILL) if k == 99 else None
    report = run(robot, controller, record, 300)
    assert (report.stop.fault, len(robot.sent)) == ("", report.cycles)
    assert report.recorded == "nothing: the process that writes the file was killed"
    assert not record.whole
    assert len(list(tmp_path.iterdir())) == 1
    run(Joints(insertion), controller, LoopRecorder(tmp_path / "run.h5", controller), 20)
    assert [path.name for path in tmp_path.iterdir()] == ["run.h5"]


KILLED_LOOP = """
import sys
sys.path.insert(0, {tests!r})
from test_loop_record import *
insertion = rcmqp.Insertion.on_shaft(rcmqp.load_arm("panda"), rcmqp.Instrument(), depth=0.1)
controller = rcmqp.make_controller("hierarchical_qp", insertion, T)
robot = Joints(insertion, on_send=lambda k: (k % 100 or print(k, flush=True), time.sleep(T)))
run(robot, controller, LoopRecorder({file!r}, controller), 100_000)
"""


def test_a_loop_that_is_killed_leaves_a_whole_file(tmp_path: Path) -> None:
    file = tmp_path / "run.h5"
    program = KILLED_LOOP.format(tests=str(Path(__file__).parent), file=str(file))
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        lines = itertools.takewhile(lambda line: int(line) < 400, process.stdout)
        assert len(list(lines)) == 4
        process.kill()
    until = time.monotonic() + 60.0
    while not file.exists() and time.monotonic() < until:
        time.sleep(0.05)
    found = Run.load(file)
    assert len(found.time) > 300
    assert found.stops == {KILLED: [len(found.time) - 1]}
    assert list(tmp_path.iterdir()) == [file]


# The loopback ------------------------------------------------------------------------------


def test_a_run_of_the_loopback_is_shown_viewed_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The machine may be busy; the loop then stops early."""
    file = tmp_path / "run.h5"
    report = run_loopback(
        0.5,
        period=0.002,
        controller="hierarchical_qp",
        record=lambda made: LoopRecorder(file, made, "loopback"),
    )
    assert report.loop.recorded.endswith(f"cycles in {file}")
    found = Run.load(file)
    assert len(found.time) == report.loop.cycles - report.loop.unsent == report.sent
    assert compute_metrics(found).rcm_max_mm < 0.1
    for command in (
        ["show", str(file)],
        ["view", str(file), "--html", str(tmp_path / "page.html"), "--no-open"],
        ["report", str(file), "--out", str(tmp_path / "report")],
    ):
        with pytest.raises(SystemExit) as ended:
            main(command)
        assert ended.value.code == 0
    shown = capsys.readouterr().out
    assert "loopback on panda, hierarchical_qp" in shown
    assert (tmp_path / "page.html").stat().st_size > 1e6
    assert "loopback" in (tmp_path / "report" / "report.md").read_text(encoding="utf-8")


def test_the_command_records_into_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, controller: Controller
) -> None:
    asked = list[object]()

    def loopback(duration: float, **options: Callable[[Controller], object]) -> None:
        asked.append(options["record"](controller))
        raise KeyboardInterrupt

    monkeypatch.setattr("rcmqp.realtime.loopback.run_loopback", loopback)
    for words in ([], ["--out", str(tmp_path / "run.h5")]):
        with pytest.raises((SystemExit, KeyboardInterrupt)):
            main(["loopback", *words])
    none, recorder = asked
    assert none is None
    assert isinstance(recorder, LoopRecorder)


def test_the_process_that_writes_is_started_at_ordinary_priority(
    controller: Controller, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its imports, too, do not run before ordinary processes; the loop's thread stays as it is.

    The scheduler is a stand-in, so every system can be asked.
    """
    ordinary, first = 0, 1
    for name, value in (("SCHED_OTHER", ordinary), ("SCHED_FIFO", first), ("sched_param", int)):
        monkeypatch.setattr(os, name, value, raising=False)
    policies, found = {threading.get_native_id(): first}, list[int]()

    def policy(thread: int) -> int:  # a new thread inherits the loop's
        return policies.setdefault(thread or threading.get_native_id(), first)

    def change(thread: int, to: int, _: object) -> None:
        policies[thread or threading.get_native_id()] = to

    class Starting(subprocess.Popen[bytes]):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            found.append(policy(0))
            super().__init__(*args, **kwargs)

    monkeypatch.setattr(os, "sched_getscheduler", policy, raising=False)
    monkeypatch.setattr(os, "sched_setscheduler", change, raising=False)
    recorder = LoopRecorder(tmp_path / "run.h5", controller)
    monkeypatch.setattr("subprocess.Popen", Starting)
    recorder.start()
    recorder.close("")
    assert found == [ordinary]
    assert policy(0) == first
