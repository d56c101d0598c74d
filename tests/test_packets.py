"""Packets that a controller did not make, or not now: none moves the arm, none ends it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rcmqp import Insertion
from rcmqp.realtime.packets import KEY, TAG, WINDOW, Kind, Numbers, Packets, Rejected, new_key
from rcmqp.realtime.simulated_arm import TOO_OLD, Account, Box, Door

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
from packets import OWN, attack

T = 0.001
V = np.linspace(0.1, 0.7, 7)
SECRET = bytes(range(KEY))


@pytest.fixture
def packets() -> Packets:
    return Packets(7, 7, SECRET)


def test_any_changed_bit_and_any_other_length_is_rejected(packets: Packets) -> None:
    good = packets.command(3, 2, V)
    assert packets.read_order(good)[:3] == (Kind.MOVE, 3, 2)
    for bit in range(8 * len(good)):
        bad = (int.from_bytes(good) ^ 1 << bit).to_bytes(len(good))
        with pytest.raises(Rejected, match="forged"):
            packets.read_order(bad)
    for size in {*range(2 * len(good))} - {len(good)}:
        with pytest.raises(Rejected, match="malformed"):
            packets.read_order((2 * good)[:size])


def test_a_packet_of_another_key_is_forged(packets: Packets) -> None:
    other = Packets(7, 7, new_key())
    for read, packet in (
        (packets.read_order, other.command(1, 1, V)),
        (packets.read_order, other.halt()),
        (packets.read_state, other.state(1, V, V)),
    ):
        with pytest.raises(Rejected, match="forged"):
            read(packet)


def test_keys_are_new_each_time_and_long() -> None:
    assert len({new_key() for _ in range(100)}) == 100
    assert len(new_key()) == KEY >= 16
    assert TAG >= 16


@pytest.mark.parametrize("v", [np.full(7, np.nan), np.full(7, np.inf)], ids=["NaN", "infinite"])
def test_a_command_that_is_not_finite_is_malformed(v: np.ndarray, packets: Packets) -> None:
    with pytest.raises(Rejected, match="malformed"):
        packets.read_order(packets.command(1, 1, v))


def test_numbers_are_told_apart_as_newer_older_and_seen() -> None:
    """Against a set that forgets nothing."""
    rng, numbers, seen, kinds = np.random.default_rng(7), Numbers(), set[int](), set[str]()
    for k in range(2000):
        number = max(1, k + int(rng.integers(-50, 50)))
        place = numbers.place(number)
        expected = "again" if number in seen else "newer" if number > max(seen, default=0) else ""
        assert place == (expected or "older")
        kinds.add(place)
        seen.add(number)
        assert numbers.highest == max(seen)
    assert kinds == {"newer", "older", "again"}
    assert numbers.place(10**15) == "newer"
    assert numbers.place(10**15 - WINDOW + 1) == "older"
    assert numbers.place(10**15 - WINDOW) == "again"  # nobody knows any more
    assert numbers.place(-(10**15)) == numbers.place(0) == "again"


def test_an_arm_under_attack_moves_as_if_it_was_alone(
    packets: Packets, insertion: Insertion
) -> None:
    """The same bits, after 6000 packets of all kinds between 500 commands."""
    rng, ends, other = np.random.default_rng(7), list[tuple[bytes, Account]](), new_key()
    foreign, made = Packets(7, 7, other), [packets.hello()]
    attacks: list[Callable[[bytes, int], bytes]] = [
        lambda good, k: rng.bytes(len(good)),
        lambda good, k: good[: int(rng.integers(len(good)))],
        lambda good, k: good + rng.bytes(1),
        lambda good, k: good[:-1] + bytes([good[-1] ^ 1]),
        lambda good, k: made[int(rng.integers(len(made)))],  # all of it came before
        lambda good, k: foreign.command(k + 1, k, V),
    ]
    for attacked in (False, True):
        box = Box(insertion, T)
        door = Door(packets, box)
        assert door.opens(packets.hello())
        for k in range(1, 501):
            good = packets.command(k, box.number, 0.1 * np.sin(0.01 * k) * V)
            door.take(good)
            if attacked:
                made.append(good)
                for each in 2 * attacks:
                    door.take(each(packets.command(k + 1, box.number, V), k))
            box.cycle()
        ends.append((box.q.tobytes() + box.v.tobytes(), box.close()))
    alone, busy = ends
    assert busy[0] == alone[0]
    assert (alone[1].used, alone[1].forged) == (500, 0)
    found = (busy[1].malformed, busy[1].forged, busy[1].replayed)
    assert found == (2000, 3000, 1000)
    assert replace(busy[1], malformed=0, forged=0, replayed=0) == alone[1]


def test_an_older_command_does_nothing(packets: Packets, insertion: Insertion) -> None:
    box = Box(insertion, T)
    door = Door(packets, box)
    held, newer = packets.command(1, 0, V), packets.command(2, 0, 0.0 * V)
    for packet in (newer, held, held):
        door.take(packet)
        box.cycle()
        assert not box.v.any()
    account = box.close()
    assert (account.used, account.disordered, account.replayed, account.lost) == (1, 1, 1, 0)


def test_only_a_hello_with_the_key_makes_a_controller(
    packets: Packets, insertion: Insertion
) -> None:
    box = Box(insertion, T)
    door = Door(packets, box)
    for packet in (b"", b"hello", Packets(7, 7, new_key()).hello(), packets.state(1, V, V)):
        assert not door.opens(packet)
    assert box.close().malformed == 3
    assert box.close().forged == 1
    assert door.opens(packets.hello())


def test_a_halted_arm_takes_no_command_any_more(packets: Packets, insertion: Insertion) -> None:
    box = Box(insertion, T)
    door = Door(packets, box)
    door.take(packets.command(1, 0, V))
    for _ in range(4):
        box.cycle()
    door.take(packets.command(2, box.number, V))
    for packet in 3 * [packets.halt()]:
        door.take(packet)
    door.take(packets.command(3, box.number, V))
    before = box.q.copy()
    for _ in range(TOO_OLD):
        box.cycle()
    account = box.close()
    assert np.array_equal(box.q, before)
    assert (account.halted, account.ran_on, account.after_halt, account.used) == (1, 3, 2, 1)
    known = account.used + account.after_halt
    assert account.received == account.highest == known == 3


def test_the_arms_process_survives_every_kind_of_packet_and_obeys_its_controller() -> None:
    """As benchmarks/packets.py, for some thousands; the arm answers between the batches."""
    found = attack(3000)
    assert sum(found.sent.values()) == 3000
    assert found.moved == 0.0
    assert found.obeyed
    assert found.dropped == {kind: found.sent[kind] for kind in (*OWN, "foreign")}
    assert min(found.dropped.values()) > 300
    assert found.account.received - found.account.disordered == found.commands
