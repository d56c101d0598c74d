"""Both ends of the loopback: where every packet went. Their timing is for ``rcmqp loopback``."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest

from rcmqp import Insertion
from rcmqp.loopback import ArmLost, Readings, UdpArm, run_loopback
from rcmqp.simulated_arm import HOST, PATIENCE, TOO_OLD, Box, Packets, insertion_of

T = 0.001
V = np.full(7, 0.1)


@pytest.fixture(scope="module")
def insertion() -> Insertion:
    return insertion_of("panda")


def test_packets_are_read_as_they_were_written() -> None:
    rng = np.random.default_rng(7)
    packets, q, v = Packets(8, 7), rng.normal(size=8), rng.normal(size=7)
    number, q_read, v_read = packets.read_state(packets.state(3, q, v))
    assert number == 3
    assert np.array_equal(q_read, q)
    assert np.array_equal(v_read, v)
    assert packets.read_command(packets.command(5, 3, v))[:2] == (5, 3)
    assert np.array_equal(packets.read_command(packets.command(5, 3, v))[2], v)


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
    packets, still = Packets(7, 7), np.zeros(7)
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
        assert packets.read_command(peer.recv(4096))[:2] == (2, 6)


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
    packets = Packets(7, 7)
    with closing(_connected(peer, packets)) as robot:
        monkeypatch.setattr("rcmqp.loopback.PATIENCE", 0.0)
        with pytest.raises(ArmLost, match="newest state is"):
            robot.read()


def test_no_arm_at_all_is_an_error(peer: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("select.select", lambda *_: ([], [], []))
    with pytest.raises(ArmLost, match="nothing came back"):
        UdpArm(peer.getsockname()[1], Packets(7, 7))


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
