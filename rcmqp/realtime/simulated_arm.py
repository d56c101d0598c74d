"""An arm's controller box in a process of its own: joint velocities in, joint states out, by UDP.

It does what boxes of real arms do, at their own fixed rate: apply the newest command, send a
state, keep an account. ``rcmqp.realtime.loopback`` starts it:

    python -m rcmqp.realtime.simulated_arm panda 0.001

It tells its port in a line of JSON on stdout, waits for a first packet to know whom to send
states to, and ends, with its account in a line of JSON, when its stdin closes.
"""

from __future__ import annotations

import json
import select
import socket
import struct
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.world.insertion import Insertion, rcm_error
from rcmqp.world.instrument import Instrument
from rcmqp.world.loading import load_arm

HOST = "127.0.0.1"

TOO_OLD = 20
"""A command that answers a state this many cycles old is refused."""

PATIENCE = 50
"""Cycles without a command after which the box stops the joints by itself."""


def insertion_of(arm: str) -> Insertion:
    """What both processes take for granted: the arm at home, its shaft 10 cm in the trocar.

    It is a simulation: limits that are only assumed of the real arm are this one's.
    """
    return Insertion.on_shaft(load_arm(arm).confirmed(), Instrument(), depth=0.1)


class Packets:
    """The two kinds of packet, little-endian.

    A state: its number, joint positions (nq,) [rad], joint velocities (nv,) [rad/s].
    A command: its number, that of the state it answers, joint velocities (nv,) [rad/s].
    """

    def __init__(self, nq: int, nv: int) -> None:
        self._nq = nq
        self._state = struct.Struct(f"<q{nq + nv}d")
        self._command = struct.Struct(f"<qq{nv}d")

    def state(self, number: int, q: Array, v: Array) -> bytes:
        """Pack a state."""
        return self._state.pack(number, *q, *v)

    def command(self, number: int, answers: int, v: Array) -> bytes:
        """Pack a command."""
        return self._command.pack(number, answers, *v)

    def read_state(self, packet: bytes) -> tuple[int, Array, Array]:
        """Number, q and v."""
        number, *values = self._state.unpack(packet)
        return number, np.array(values[: self._nq]), np.array(values[self._nq :])

    def read_command(self, packet: bytes) -> tuple[int, int, Array]:
        """Number, the state's number, and v."""
        number, answers, *v = self._command.unpack(packet)
        return number, answers, np.array(v)


@dataclass
class Account:
    """Where every command went, as the arm saw it.

    ``received`` is the sum of used, superseded, refused and disordered.

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
    rcm_max_mm: float = 0.0
    speed_end: float = 0.0


class Box:
    """The arm and its account; knows no clock and no socket."""

    def __init__(self, insertion: Insertion, period: float) -> None:
        self.insertion, self.period, self.account = insertion, period, Account()
        self.q, self.v = np.array(insertion.q_start), np.zeros(insertion.arm.nv)
        self.number = 0
        self._waiting: tuple[int, Array] | None = None
        self._without = 0

    def receive(self, number: int, answers: int, v: Array) -> None:
        """Take a command that has arrived; the next cycle uses it."""
        account = self.account
        account.received += 1
        if number <= account.highest:
            account.disordered += 1
            account.lost -= 1  # it was missed when the newer one came
            return
        account.lost += number - account.highest - 1
        account.highest = number
        if self.number - answers > TOO_OLD:
            account.refused += 1
            return
        if self._waiting is not None:
            account.superseded += 1
        self._waiting = (answers, v)

    def cycle(self, periods: int = 1) -> None:
        """Use what has arrived and move on, by more than one period if cycles were overslept."""
        account = self.account
        if self._waiting is None:
            self._without += periods
            if self._without > PATIENCE and self.v.any():
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


def serve(arm: str, period: float) -> None:
    """Be the box until stdin closes."""
    insertion = insertion_of(arm)
    box, packets = Box(insertion, period), Packets(insertion.arm.nq, insertion.arm.nv)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind((HOST, 0))
        print(json.dumps({"port": udp.getsockname()[1]}), flush=True)
        _, whom = udp.recvfrom(64)  # says hello
        udp.connect(whom)
        udp.setblocking(False)
        clock = time.perf_counter
        start = clock()
        done = 0
        while True:
            due = start + (done + 1) * period
            while (left := due - clock()) > 0.0:
                ready, _, _ = select.select([udp, sys.stdin], [], [], left)
                if sys.stdin in ready:
                    _drain(udp, packets, box)
                    box.cycle()
                    print(json.dumps(asdict(box.close())), flush=True)
                    return
                first = not box.account.received
                _drain(udp, packets, box)
                if first and box.account.received:  # half a period to answer, half to be late
                    start, done = clock() - 0.5 * period, 0
                    due = start + period
            periods = max(1, int((clock() - start) / period) - done)
            box.cycle(periods)
            done += periods
            try:
                udp.send(packets.state(box.number, box.q, box.v))
            except OSError:  # nobody listens any more
                pass


def _drain(udp: socket.socket, packets: Packets, box: Box) -> None:
    while True:
        try:
            packet = udp.recv(4096)
        except OSError:  # no more, or nobody there any more
            return
        box.receive(*packets.read_command(packet))


if __name__ == "__main__":
    serve(sys.argv[1], float(sys.argv[2]))
