"""What the simulated arm does with packets that its controller did not send, or not now.

The arm runs in a process of its own at 1 kHz and stands still by its controller's commands, which
go on all the time. Between them come packets that are forged, replayed, older than the newest, of
another length, or from another address, each asking for 1 rad/s. Prints how many of each kind were
sent and dropped, and whether the arm moved.

    python benchmarks/packets.py --packets 1000000
"""

from __future__ import annotations

import argparse
import socket
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.loopback import account_of, arm_process, port_of
from rcmqp.realtime.packets import TAG, Packets, new_key
from rcmqp.realtime.simulated_arm import HOST, Account, insertion_of
from rcmqp.show.table import Table

PERIOD = 1e-3

PER_CYCLE = 60
"""Packets from each of the two addresses between two commands: the arm takes 64 a cycle."""

NEVER = 10**9
"""The arm's own patience, in cycles: at rest, it is so by commands."""

ANSWER = 10.0
"""How long the arm may take for a few cycles on a busy machine [s]."""


@dataclass
class Outcome:
    """What was sent, what the arm counted, and what moved.

    Attributes:
        sent: packets by the kind of attack.
        commands: the controller's own.
        moved: largest joint speed or change of angle seen during the attack.
        obeyed: the arm followed its controller before and after.
        account: the arm's.
    """

    sent: Counter[str] = field(default_factory=Counter)
    commands: int = 0
    moved: float = 0.0
    obeyed: bool = False
    account: Account = field(default_factory=Account)

    @property
    def dropped(self) -> dict[str, int]:
        """What the arm counted of each kind of attack."""
        account = self.account
        return {
            "forged": account.forged,
            "replayed": account.replayed,
            "older": account.disordered,
            "malformed": account.malformed,
            "foreign": account.foreign,
        }


class Session:
    """A controller that can also hold packets back, and send what it should not."""

    def __init__(self, port: int, packets: Packets) -> None:
        self.packets, self.number, self.commands = packets, 0, list[bytes]()
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.settimeout(ANSWER)
        self.udp.connect((HOST, port))
        self.udp.send(packets.hello())
        self.state = packets.read_state(self.udp.recv(4096))

    def command(self, v: Array) -> bytes:
        """The next command, not sent."""
        self.number += 1
        return self.packets.command(self.number, self.state[0], v)

    def send(self, v: Array) -> bytes:
        """Send a command."""
        packet = self.command(v)
        self.udp.send(packet)
        return packet

    def after(self, cycles: int) -> tuple[Array, Array]:
        """The arm's q and v so many cycles after its newest state that has come."""
        self.drain()
        until = self.state[0] + cycles
        while self.state[0] < until:
            self.state = self.packets.read_state(self.udp.recv(4096))
        return self.state[1:]

    def drain(self) -> None:
        """Take the states that have come."""
        self.udp.setblocking(False)
        try:
            while True:
                self.state = self.packets.read_state(self.udp.recv(4096))
        except BlockingIOError:
            self.udp.settimeout(ANSWER)

    def reach(self, v: Array) -> bool:
        """Send this velocity until the arm has it; whether it does in the end."""
        until = time.monotonic() + ANSWER
        while time.monotonic() < until:
            self.send(v)
            if np.array_equal(self.after(2)[1], v):
                return True
        return False


class Attacker:
    """Makes packets of every kind; all ask for 1 rad/s."""

    def __init__(self, session: Session, recorded: list[bytes]) -> None:
        self._session, self._recorded = session, recorded
        self._rng = np.random.default_rng(7)
        nv = session.state[2].size
        self._v, other = np.ones(nv), Packets(session.state[1].size, nv, new_key())
        self._other = other

    def own(self, kind: str) -> bytes:
        """A packet that comes from the controller's address."""
        rng, session = self._rng, self._session
        if kind == "replayed":
            return self._recorded[int(rng.integers(len(self._recorded)))]
        if kind == "older":
            return session.command(self._v)  # sent after a newer one
        ahead = session.number + int(rng.integers(1, 100))
        good = session.packets.command(ahead, session.state[0], self._v)
        if kind == "malformed":
            cut = int(rng.integers(2 * len(good)))
            return (good + good)[: cut + (cut == len(good))]
        which = int(rng.integers(3))
        if which == 0:  # one bit
            bit = int(rng.integers(8 * len(good)))
            return (int.from_bytes(good) ^ 1 << bit).to_bytes(len(good))
        if which == 1:  # another key
            return self._other.command(ahead, session.state[0], self._v)
        return good[:-TAG] + rng.bytes(TAG)

    def foreign(self) -> bytes:
        """A packet for another address: even the right key is of no use there."""
        session = self._session
        if self._rng.random() < 0.1:
            return session.packets.hello()
        return session.packets.command(session.number + 1, session.state[0], self._v)


OWN = ("forged", "replayed", "older", "malformed")


def attack(packets: int, arm: str = "panda", per_cycle: int = PER_CYCLE) -> Outcome:
    """Send that many packets, all kinds in equal parts but for half that are foreign."""
    insertion, key, outcome = insertion_of(arm), new_key(), Outcome()
    fast, still = np.full(insertion.arm.nv, 0.1), np.zeros(insertion.arm.nv)
    wire = Packets(insertion.arm.nq, insertion.arm.nv, key)
    with (
        arm_process(arm, PERIOD, key, NEVER) as box,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        port = port_of(box)
        session = Session(port, wire)
        with session.udp:
            recorded = [session.send(fast) for _ in range(20)]
            obeyed = session.reach(fast) and session.reach(still)
            q_before = session.after(2)[0]
            attacker, left = Attacker(session, recorded), packets
            while left > 0:
                own = [OWN[k % len(OWN)] for k in range(min(left, 2 * per_cycle) // 2)]
                made = [attacker.own(kind) for kind in own]
                session.send(still)
                for packet in made:
                    session.udp.send(packet)
                foreign = min(left, 2 * per_cycle) - len(own)
                for _ in range(foreign):
                    stranger.sendto(attacker.foreign(), (HOST, port))
                outcome.sent.update(own)
                outcome.sent["foreign"] += foreign
                left -= len(own) + foreign
                q, v = session.after(3)
                outcome.moved = max(outcome.moved, *np.abs(v), *np.abs(q - q_before))
            outcome.obeyed = obeyed and session.reach(-fast) and session.reach(still)
            outcome.account = account_of(box)
    outcome.commands = session.number - outcome.sent["older"]
    return outcome


def main() -> None:
    """Attack, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--packets", type=int, default=10_000)
    given = parser.parse_args()
    begin = time.monotonic()
    found = attack(given.packets)
    rows = [[kind, found.sent[kind], dropped] for kind, dropped in found.dropped.items()]
    print(Table(["packets", "sent", "dropped"], rows).markdown(), end="")
    account = found.account
    taken = account.received - account.disordered
    print(f"\nmoved: {found.moved:g}; obeys its controller before and after: {found.obeyed}")
    print(f"the controller's own commands: {found.commands} sent, {taken} taken")
    print(f"{account.cycles} cycles, {time.monotonic() - begin:.0f} s")


if __name__ == "__main__":
    main()
