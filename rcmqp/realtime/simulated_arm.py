"""Simulated arms: joints in the loop's process, and a controller box in a process of its own.

The box takes joint velocities and gives joint states, by UDP. It does what boxes of real arms do,
at their own fixed rate: apply the newest command, send a state, keep an account.
``rcmqp.realtime.loopback`` starts it:

    python -m rcmqp.realtime.simulated_arm panda 0.001

It reads a key in hexadecimal from a line of stdin, tells its port in a line of JSON on stdout,
and waits for a hello that was made with the key to know whom to send states to. From then on it
takes orders from there only, and only those made with the key, each once. What else comes it
drops and counts. It ends, with its account in a line of JSON, when its stdin closes.
"""

from __future__ import annotations

import json
import math
import os
import select
import socket
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.packets import Kind, Numbers, Packets, Rejected
from rcmqp.world.insertion import Insertion, rcm_error
from rcmqp.world.instrument import Instrument
from rcmqp.world.loading import load_arm

HOST = "127.0.0.1"

TOO_OLD = 20
"""A command that answers a state this many cycles old is refused."""

PATIENCE = 50
"""Cycles without a command after which the box stops the joints by itself."""

AT_ONCE = 64
"""Packets that are read before the box looks at its clock again."""


def insertion_of(arm: str) -> Insertion:
    """The insertion of both processes: the arm at home, its shaft 10 cm in the trocar.

    It is a simulation: limits that are only assumed for the real arm are exact here.
    """
    return Insertion.on_shaft(load_arm(arm).confirmed(), Instrument(), depth=0.1)


class SimulatedArm:
    """Joints that go on by one period with each command.

    So the arm's time is the loop's: on a busy computer it is slower than the clock, which the
    loop's report counts, and no motion is lost.

    Attributes:
        sent_at: when the last command came, by the clock [s].
    """

    def __init__(self, insertion: Insertion, period: float) -> None:
        """At rest, at the start."""
        self._arm, self._period = insertion.arm, period
        self._q, self._v = np.array(insertion.q_start), np.zeros(insertion.arm.nv)
        self.sent_at = math.nan

    def read(self) -> tuple[Array, Array]:
        """Configuration q (nq,) and velocity v (nv,)."""
        return self._q, self._v

    def send(self, v: Array) -> None:
        """Move at v (nv,) for a period."""
        self._q = self._arm.integrate(self._q, v, self._period)
        self._v = np.array(v)
        self.sent_at = time.monotonic()


@dataclass
class Account:
    """Where every command went, as the arm saw it.

    ``received`` is the sum of used, superseded, refused, disordered and after_halt; what is
    foreign, malformed, forged or replayed is not in it.

    Attributes:
        cycles: of the arm, from the first command used to the last.
        received: commands that arrived.
        used: commands that moved the joints.
        superseded: commands that a newer one overtook before the arm's next cycle.
        refused: commands that answered a state too old.
        disordered: commands that came after a newer one, and were dropped.
        lost: numbers left out before the highest that arrived.
        highest: number of the last command that arrived.
        late: of those used, commands that answered a state two cycles old or older.
        oldest: the oldest state that a command answered, in cycles.
        held: cycles without a new command, in which the joints went on as they were.
        overslept: cycles that the arm itself began too late to run.
        stopped: times that it stopped by itself, for no command came.
        halted: 1 if the controller halted it.
        ran_on: cycles that the joints went on after the last command used, until that.
        after_halt: commands that came after that, and did nothing.
        foreign: packets from elsewhere than the controller.
        malformed: packets of another length, or with numbers that mean nothing.
        forged: packets that were not made with the key.
        replayed: packets that had come before.
        rcm_max_mm: largest distance of the trocar from the shaft's axis.
        speed_end: largest joint speed at the end [rad/s].
    """

    cycles: int = 0
    received: int = 0
    used: int = 0
    superseded: int = 0
    refused: int = 0
    disordered: int = 0
    lost: int = 0
    highest: int = 0
    late: int = 0
    oldest: int = 0
    held: int = 0
    overslept: int = 0
    stopped: int = 0
    halted: int = 0
    ran_on: int = 0
    after_halt: int = 0
    foreign: int = 0
    malformed: int = 0
    forged: int = 0
    replayed: int = 0
    rcm_max_mm: float = 0.0
    speed_end: float = 0.0


class Box:
    """The arm and its account; knows no clock and no socket."""

    def __init__(self, insertion: Insertion, period: float, patience: int = PATIENCE) -> None:
        """At home and at rest; ``patience`` is how many cycles without a command it goes on."""
        self.insertion, self.period, self.account = insertion, period, Account()
        self.q, self.v = np.array(insertion.q_start), np.zeros(insertion.arm.nv)
        self.number = 0
        self._waiting: tuple[int, Array] | None = None
        self._without, self._patience, self._numbers = 0, patience, Numbers()

    def receive(self, number: int, answers: int, v: Array) -> None:
        """Take a command that has arrived; the next cycle uses it."""
        account = self.account
        place = self._numbers.place(number)
        if place == "again":
            account.replayed += 1
            return
        account.received += 1
        if place == "older":
            account.disordered += 1
            account.lost -= 1  # it was missed when the newer one came
            return
        account.lost += number - account.highest - 1
        account.highest = number
        if account.halted:
            account.after_halt += 1
            return
        if self.number - answers > TOO_OLD:
            account.refused += 1
            return
        if self._waiting is not None:
            account.superseded += 1
        self._waiting = (answers, v)

    def halt(self) -> None:
        """Stop the joints, and take no command any more."""
        account = self.account
        if account.halted:
            return
        account.halted, account.ran_on = 1, self._without if self.v.any() else 0
        account.after_halt += self._waiting is not None
        self._waiting, self.v = None, np.zeros_like(self.v)

    def cycle(self, periods: int = 1) -> None:
        """Use what has arrived and move on, by more than one period if cycles were overslept."""
        account = self.account
        if self._waiting is None:
            self._without += periods
            if self._without > self._patience and self.v.any():
                self.v = np.zeros_like(self.v)
                account.stopped += 1
        else:
            answers, self.v = self._waiting
            age = self.number + periods - answers
            if account.used:
                account.held += self._without
                account.cycles += self._without
            account.used += 1
            account.cycles += 1
            account.late += age > 1
            account.oldest = max(account.oldest, age)
            self._waiting, self._without = None, periods - 1
        account.overslept += periods - 1
        self.number += periods
        self.q = self.insertion.arm.integrate(self.q, self.v, periods * self.period)
        off = rcm_error(self.insertion.state(self.q).x, self.insertion.trocar.pivot)
        account.rcm_max_mm = max(account.rcm_max_mm, 1e3 * float(off))

    def close(self) -> Account:
        """The account, at the end."""
        self.account.speed_end = float(np.abs(self.v).max())
        return self.account


class Door:
    """Checks what comes from the sockets before the box gets it."""

    def __init__(self, packets: Packets, box: Box) -> None:
        self._packets, self._box = packets, box

    def opens(self, packet: bytes) -> bool:
        """Whether this packet, the first from its sender, makes that the controller."""
        return self._passes(packet) is Kind.HELLO

    def take(self, packet: bytes) -> None:
        """Do what a packet from the controller's address asks, if the controller made it."""
        if self._passes(packet) is Kind.HELLO:  # it has said so already
            self._box.account.replayed += 1

    def _passes(self, packet: bytes) -> Kind | None:
        box = self._box
        try:
            order = self._packets.read_order(packet)
        except Rejected as error:
            account, fault = box.account, error.fault
            setattr(account, fault, getattr(account, fault) + 1)
            return None
        if order.kind is Kind.MOVE:
            box.receive(order.number, order.answers, order.v)
        elif order.kind is Kind.HALT:
            box.halt()
        return order.kind


def serve(arm: str, period: float, patience: int = PATIENCE) -> None:
    """Be the box until stdin closes."""
    key = bytes.fromhex(sys.stdin.readline())
    insertion = insertion_of(arm)
    box = Box(insertion, period, patience)
    packets = Packets(insertion.arm.nq, insertion.arm.nv, key)
    door = Door(packets, box)
    with _socket() as everybody:
        everybody.bind((HOST, 0))
        port = everybody.getsockname()[1]
        print(json.dumps({"port": port}), flush=True)
        whom = _visitor(everybody, door)
        if whom is not None:
            with _socket() as udp:
                _bind_beside(udp, everybody, whom)
                _serve(udp, everybody, packets, door, box)
        print(json.dumps(asdict(box.close())), flush=True)


def _socket() -> socket.socket:
    return socket.socket(socket.AF_INET, socket.SOCK_DGRAM)


def _visitor(udp: socket.socket, door: Door) -> tuple[str, int] | None:
    """Who says hello with the key; None where stdin closes before."""
    while True:
        ready, _, _ = select.select([udp, sys.stdin], [], [])
        if sys.stdin in ready:
            return None
        packet, (host, port) = udp.recvfrom(4096)
        if door.opens(packet):
            return host, port


def _bind_beside(udp: socket.socket, everybody: socket.socket, whom: tuple[str, int]) -> None:
    """Give the controller a socket of its own at the same port.

    The kernel hands what comes from the controller's address to the connected socket, and all
    else to the other one: a flood from elsewhere fills that one's buffer only.
    """
    for each in (udp, everybody):
        each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    udp.bind(everybody.getsockname())
    udp.connect(whom)
    for each in (udp, everybody):  # nobody else may have the port
        each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)
        each.setblocking(False)


def _serve(
    udp: socket.socket, everybody: socket.socket, packets: Packets, door: Door, box: Box
) -> None:
    """Cycles, from the hello until stdin closes."""
    clock, period = time.perf_counter, box.period
    start = clock()
    done = 0
    while True:
        due = start + (done + 1) * period
        while (left := due - clock()) > 0.0:
            ready, _, _ = select.select([udp, sys.stdin], [], [], left)
            if sys.stdin in ready:
                while _drain(udp, door) == AT_ONCE:
                    pass
                box.cycle()
                return
            first = not box.account.received
            _drain(udp, door)
            if first and box.account.received:  # half a period to answer, half to be late
                start, done = clock() - 0.5 * period, 0
                due = start + period
        periods = max(1, int((clock() - start) / period) - done)
        box.cycle(periods)
        done += periods
        box.account.foreign += len(_arrived(everybody))
        try:
            udp.send(packets.state(box.number, box.q, box.v))
        except OSError:  # nobody listens any more
            pass


def _drain(udp: socket.socket, door: Door) -> int:
    """Read all packets from the controller's address; return how many."""
    packets = _arrived(udp)
    for packet in packets:
        door.take(packet)
    return len(packets)


def _arrived(udp: socket.socket) -> list[bytes]:
    """Packets that have come, AT_ONCE at most: a flood must not hold up the joints."""
    packets = list[bytes]()
    try:
        while len(packets) < AT_ONCE:
            packets.append(udp.recv(4096))
    except OSError:  # no more, or nobody there any more
        pass
    return packets


if __name__ == "__main__":
    try:
        serve(sys.argv[1], float(sys.argv[2]), *map(int, sys.argv[3:]))
    except BrokenPipeError:  # the program that started this one has ended: nobody reads on
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
