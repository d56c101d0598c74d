"""Both ends of the loopback: where every packet went. Their timing is for ``rcmqp loopback``."""

from __future__ import annotations

import errno
import gc
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest

from rcmqp import Insertion, load_arm
from rcmqp.cli import main
from rcmqp.errors import OptionError
from rcmqp.realtime.latency import EDGES, Latency
from rcmqp.realtime.loopback import ArmLost, LoopbackReport, Readings, UdpArm, run_loopback
from rcmqp.realtime.packets import Kind, Packets, new_key
from rcmqp.realtime.report import LoopReport, Stop
from rcmqp.realtime.simulated_arm import HOST, PATIENCE, TOO_OLD, Account, Box, insertion_of
from rcmqp.realtime.system import (
    PRIORITY,
    make_ordinary,
    priority_if_permitted,
    real_time_priority,
)

T = 0.001
V = np.full(7, 0.1)
KEY = new_key()


@pytest.fixture(scope="module")
def insertion() -> Insertion:
    return insertion_of("panda")


def test_the_simulated_arm_has_what_is_assumed_of_the_real_one_for_its_limits() -> None:
    assert load_arm("ur5").assumed
    insertion_of("ur5").arm.check_limits_known()


def test_packets_are_read_as_they_were_written() -> None:
    rng = np.random.default_rng(7)
    packets, q, v = Packets(8, 7, KEY), rng.normal(size=8), rng.normal(size=7)
    number, q_read, v_read = packets.read_state(packets.state(3, q, v))
    assert number == 3
    assert np.array_equal(q_read, q)
    assert np.array_equal(v_read, v)
    assert packets.read_order(packets.command(5, 3, v))[:3] == (Kind.MOVE, 5, 3)
    assert np.array_equal(packets.read_order(packets.command(5, 3, v)).v, v)


def test_the_arm_moves_as_the_newest_command_says(insertion: Insertion) -> None:
    box = Box(insertion, T)
    box.cycle()
    box.receive(1, 1, V)
    box.receive(2, 1, -V)
    box.cycle()
    box.cycle(3)
    np.testing.assert_allclose(box.q - insertion.q_start, -4 * T * V, rtol=0, atol=1e-15)
    assert box.number == 5


def test_every_command_is_in_the_account_once(insertion: Insertion) -> None:
    """Numbers 1 to 400, some lost, some swapped, some too old, two of them in a cycle at times."""
    rng, box = np.random.default_rng(7), Box(insertion, T)
    numbers = [k for k in range(1, 401) if rng.random() > 0.1]
    for k in range(len(numbers) - 1):
        if rng.random() < 0.1:
            numbers[k], numbers[k + 1] = numbers[k + 1], numbers[k]
    for number in numbers:
        age = TOO_OLD + 1 if rng.random() < 0.1 else 0
        box.receive(number, box.number - age, V)
        if rng.random() < 0.8:
            box.cycle(2 if rng.random() < 0.1 else 1)
    box.cycle()
    found = box.close()
    assert found.received == len(numbers)
    assert found.received == found.used + found.superseded + found.refused + found.disordered
    assert found.highest - found.received == found.lost == 400 - len(numbers)
    assert min(found.superseded, found.refused, found.disordered, found.overslept) > 5
    assert found.cycles == found.used + found.held


def test_late_commands_and_cycles_without_one_are_counted(insertion: Insertion) -> None:
    box = Box(insertion, T)
    box.cycle()
    box.receive(1, 1, V)
    box.cycle(3)  # the arm overslept two of them
    box.cycle()
    box.receive(2, 5, V)
    box.cycle()
    box.cycle()
    found = box.close()
    assert (found.used, found.held, found.cycles) == (2, 3, 5)  # what follows the last is its end
    assert (found.late, found.oldest, found.overslept) == (1, 3, 2)


def test_a_command_is_late_from_two_cycles_on_and_refused_beyond_twenty(
    insertion: Insertion,
) -> None:
    box = Box(insertion, T)
    for number, age in enumerate((1, 2, TOO_OLD, TOO_OLD + 1), start=1):
        for _ in range(age):
            box.cycle()
        box.receive(number, box.number - age + 1, V)
        box.cycle()  # the command is of age - 1 when it comes, and used when it is of age
    found = box.close()
    assert (found.used, found.late, found.refused, found.oldest) == (4, 3, 0, TOO_OLD + 1)
    for _ in range(TOO_OLD + 1):
        box.cycle()
    box.receive(5, box.number - TOO_OLD - 1, V)
    assert box.close().refused == 1


def test_the_arm_stops_by_itself_when_no_command_comes(insertion: Insertion) -> None:
    box = Box(insertion, T)
    box.receive(1, 0, V)
    box.cycle()
    for _ in range(PATIENCE):
        box.cycle()
    assert box.v.any()
    box.cycle()
    assert not box.v.any()
    assert box.close().stopped == 1


@pytest.fixture
def peer() -> Iterator[socket.socket]:
    """The other end of a UdpArm."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind((HOST, 0))
        udp.settimeout(5.0)
        yield udp


def test_the_loop_reads_the_newest_state_and_counts_the_others(peer: socket.socket) -> None:
    packets, still = Packets(7, 7, KEY), np.zeros(7)
    with closing(_connected(peer, packets)) as robot:
        robot.send(V)  # the account begins
        for number in (2, 3, 6, 5):
            peer.send(packets.state(number, np.full(7, number), still))
        assert robot.read()[0][0] == 6.0
        assert robot.readings == Readings(received=4, overtaken=3, lost=1, again=0)
        assert robot.read()[0][0] == 6.0
        assert robot.readings.again == 1
        robot.send(V)
        peer.recv(4096)
        assert packets.read_order(peer.recv(4096))[1:3] == (2, 6)


def _connected(peer: socket.socket, packets: Packets) -> UdpArm:
    """A UdpArm that has got state 1 of its peer, which answers its hello from a thread."""

    def answer() -> None:
        _, whom = peer.recvfrom(64)
        peer.connect(whom)
        peer.send(packets.state(1, np.ones(7), np.zeros(7)))

    thread = threading.Thread(target=answer)
    thread.start()
    robot = UdpArm(peer.getsockname()[1], packets)
    thread.join()
    return robot


def test_an_arm_that_falls_silent_is_an_error(
    peer: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    packets = Packets(7, 7, KEY)
    with closing(_connected(peer, packets)) as robot:
        monkeypatch.setattr("rcmqp.realtime.loopback.PATIENCE", 0.0)
        with pytest.raises(ArmLost, match="newest state is"):
            robot.read()


@pytest.mark.parametrize("somebody", [True, False], ids=["silent", "nobody"])
def test_no_arm_at_all_is_an_error_and_leaves_no_socket(
    somebody: bool, peer: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rcmqp.realtime.loopback.HELLO", 0.01)
    port = peer.getsockname()[1]
    if not somebody:
        peer.close()
    with pytest.raises(ArmLost, match=f"nothing came back from port {port}"):
        UdpArm(port, Packets(7, 7, KEY))
    gc.collect()  # a socket left open would be a warning, and that an error


def test_an_arm_that_counts_from_the_start_again_is_not_taken_for_the_old_one(
    peer: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    """States come, but none that is newer; after 20 ms that is an arm lost."""
    clock = [100.0]
    monkeypatch.setattr("rcmqp.realtime.loopback.time.perf_counter", lambda: clock[0])
    packets, still = Packets(7, 7, KEY), np.zeros(7)
    with closing(_connected(peer, packets)) as robot:
        peer.send(packets.state(1000, np.ones(7), still))
        robot.read()
        robot.send(V)
        for number in range(4):
            clock[0] += 0.0049
            peer.send(packets.state(number, 2.0 * np.ones(7), still))
            assert robot.read()[0][0] == 1.0
        assert robot.readings == Readings(received=4, overtaken=4, lost=0, again=4)
        clock[0] += 0.0049
        peer.send(packets.state(4, 2.0 * np.ones(7), still))
        with pytest.raises(ArmLost, match=r"newest state is 0.024|newest state is 0.025"):
            robot.read()


@pytest.mark.parametrize("duration", [0.0, -1.0, np.nan, np.inf, 6e301, 86401.0])
def test_a_duration_that_makes_no_sense_is_refused(duration: float) -> None:
    with pytest.raises(OptionError, match=r"duration = .* s, it must be positive and finite"):
        run_loopback(duration)


@pytest.mark.parametrize(
    ("number", "fault", "code"),
    [(0, "", 0), (0, "LoopFault: late", 1), (signal.SIGINT, "", 130), (signal.SIGTERM, "x", 143)],
)
def test_the_command_prints_its_report_and_tells_how_it_ended(
    number: int,
    fault: str,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    none = Latency((0,) * (len(EDGES) + 1), 0.0, 0.0)
    stop = Stop(1.0, fault, signal=number)
    loop = LoopReport("law", T, 7, 7, 0, 0, 0, 0, none, none, stop)
    made = LoopbackReport(loop, 7, Readings(), Account())
    monkeypatch.setattr("rcmqp.realtime.loopback.run_loopback", lambda *_, **__: made)
    with pytest.raises(SystemExit) as ended:
        main(["loopback"])
    found = capsys.readouterr()
    assert (ended.value.code or 0) == code
    assert f"ended | at 1.000 s, {fault or 'as asked'}" in found.out
    assert ("interrupted" in found.err) == (code > 128)


# Priority ----------------------------------------------------------------------------------


class Scheduler:
    """A stand-in for the system's: the policies of threads, and what it was asked to set."""

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        policy: str = "SCHED_OTHER",
        level: int = 0,
        refuses: OSError | None = None,
    ) -> None:
        """All threads have ``policy`` and ``level``; each change is answered with ``refuses``."""
        self.policy, self.level, self.refuses = getattr(os, policy), level, refuses
        self.set_to = list[tuple[int, int, int]]()
        monkeypatch.setattr("os.sched_getscheduler", lambda _: self.policy)
        monkeypatch.setattr("os.sched_getparam", lambda _: os.sched_param(self.level))
        monkeypatch.setattr("os.sched_setscheduler", self.set)

    def set(self, thread: int, policy: int, param: Any) -> None:
        if self.refuses:
            raise self.refuses
        self.set_to.append((thread, policy, param.sched_priority))
        self.policy, self.level = policy, param.sched_priority


has_scheduler = pytest.mark.skipif(
    not hasattr(os, "sched_setscheduler"), reason="this system has no real-time priorities"
)


@has_scheduler
def test_real_time_priority_ends_with_its_block(monkeypatch: pytest.MonkeyPatch) -> None:
    scheduler = Scheduler(monkeypatch)
    with real_time_priority() as priority:
        assert scheduler.set_to == [(0, os.SCHED_FIFO, PRIORITY)]
        assert priority.words == f"real-time (SCHED_FIFO {PRIORITY})"
    assert scheduler.set_to[1:] == [(0, os.SCHED_OTHER, 0)]


@has_scheduler
@pytest.mark.parametrize("policy", ["SCHED_FIFO", "SCHED_RR"])
@pytest.mark.parametrize("processors", [1, 2])
def test_a_process_that_is_real_time_already_stays_as_it_is(
    policy: str, processors: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(processors)))
    scheduler = Scheduler(monkeypatch, policy, 42)
    scheduler.policy |= os.SCHED_RESET_ON_FORK
    with priority_if_permitted() as priority:
        assert priority.words == f"real-time ({policy} 42), as it was started"
        priority.give_up("it is slow")
    assert priority.words == f"real-time ({policy} 42), as it was started"
    assert scheduler.set_to == []


REFUSED = [
    (PermissionError(1, "Operation not permitted"), "real-time priority is not permitted"),
    (
        OSError(errno.ENOSYS, "Function not implemented"),
        "this system gives no real-time priority (Function not implemented)",
    ),
    (
        OSError(errno.EINVAL, "Invalid argument"),
        "this system gives no real-time priority (Invalid argument)",
    ),
]


@has_scheduler
@pytest.mark.parametrize(("refuses", "words"), REFUSED, ids=["EPERM", "ENOSYS", "EINVAL"])
def test_real_time_priority_that_the_system_refuses_says_why_and_a_loop_goes_on_without(
    refuses: OSError, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    scheduler = Scheduler(monkeypatch, refuses=refuses)
    with pytest.raises(OptionError) as refused, real_time_priority():
        pass
    assert str(refused.value).startswith(f"{words}; ")
    assert str(refused.value).endswith("run without")
    with priority_if_permitted() as priority:
        assert priority.words == f"ordinary, as {words}; rcmqp doctor says what to do"
        priority.give_up("it is slow")
    assert priority.words == f"ordinary, as {words}; rcmqp doctor says what to do"
    assert scheduler.set_to == []


@has_scheduler
def test_an_error_in_the_block_of_a_real_time_priority_stays_what_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scheduler = Scheduler(monkeypatch)
    with pytest.raises(PermissionError, match="a file"), real_time_priority():
        raise PermissionError("a file")
    assert scheduler.policy == os.SCHED_OTHER


@has_scheduler
def test_real_time_priority_is_not_asked_for_on_one_processor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0})
    scheduler = Scheduler(monkeypatch)
    with priority_if_permitted() as priority:
        assert priority.words == "ordinary, as there is one processor only"
    assert scheduler.set_to == []


@has_scheduler
def test_a_priority_that_is_given_up_is_that_of_all_threads_and_for_good(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    scheduler, policies = Scheduler(monkeypatch), dict[int, int]()
    with priority_if_permitted() as priority:
        over = threading.Event()
        thread = threading.Thread(target=over.wait)
        thread.start()
        policies |= dict.fromkeys((threading.get_native_id(), thread.native_id or 0), 1)
        monkeypatch.setattr("os.sched_getscheduler", lambda number: policies.get(number, 0))
        monkeypatch.setattr(
            "os.sched_setscheduler", lambda number, to, _: policies.update({number: to})
        )
        priority.give_up("it is slow")
        priority.give_up("it is slow")
        over.set()
        thread.join()
        assert policies == dict.fromkeys(policies, os.SCHED_OTHER)
    assert priority.words == f"real-time (SCHED_FIFO {PRIORITY}), then ordinary, as it is slow"
    assert scheduler.set_to == [(0, os.SCHED_FIFO, PRIORITY)]


@has_scheduler
@pytest.mark.parametrize(
    ("policy", "changes"),
    [("SCHED_FIFO", True), ("SCHED_RR", True), ("SCHED_BATCH", False), ("SCHED_IDLE", False)],
)
def test_only_a_real_time_thread_is_made_ordinary(
    policy: str, changes: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    scheduler = Scheduler(monkeypatch, policy)
    make_ordinary(7)
    assert scheduler.set_to == ([(7, os.SCHED_OTHER, 0)] if changes else [])


def test_the_loopback_accounts_for_every_command_and_ends_at_rest() -> None:
    """In whatever time this machine takes: it may be busy, and the loop then stops early."""
    report = run_loopback(0.2)
    assert report.sent == report.loop.cycles - report.loop.unsent > 0
    assert report.unaccounted == 0
    assert report.arm.received > 0
    assert report.arm.speed_end == 0.0
    assert report.arm.rcm_max_mm < 0.1
    text = report.as_markdown()
    assert f"| commands sent | {report.sent} |" in text
    assert "| deadlines missed |" in text


def test_the_simulated_arm_prints_no_traceback_when_the_program_that_started_it_is_gone() -> None:
    command = [sys.executable, "-m", "rcmqp.realtime.simulated_arm", "panda", str(T)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as arm:
        assert arm.stdin is not None
        assert arm.stdout is not None
        assert arm.stderr is not None
        arm.stdin.write(f"{KEY.hex()}\n")
        arm.stdin.flush()
        assert "port" in arm.stdout.readline()
        arm.stdout.close()
        arm.stdin.close()
        assert arm.stderr.read() == ""
        assert arm.wait() == 1
