"""The real-time loop against a simulated arm in another process, over UDP on this machine."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from rcmqp.controllers import Controller, make_controller
from rcmqp.errors import OptionError, RcmqpError
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime import simulated_arm
from rcmqp.realtime.packets import Packets, Rejected, new_key
from rcmqp.realtime.report import CycleRecorder, LoopReport
from rcmqp.realtime.run import run_realtime
from rcmqp.realtime.simulated_arm import AT_ONCE, HOST, TOO_OLD, Account, insertion_of
from rcmqp.realtime.system import real_time_priority
from rcmqp.references.paths import Circle
from rcmqp.references.view import Stamped, view_pose
from rcmqp.show.table import Table

PATIENCE = 0.02
"""How old the newest state may be before the arm is taken for gone [s]."""

HELLO = 1.0
"""How long the first state may take [s]."""

HALTS = 3
"""Packets of one halt()."""

TURN = 8.0
"""How long the tip takes for a circle [s]."""

LONGEST = 86400.0
"""A day [s]."""

BUSY = "import select, sys\nwhile not select.select([sys.stdin], [], [], 0)[0]: pass"
"""What a busy core does, until its stdin closes."""


class ArmLost(RcmqpError):
    """An arm sends no states any more, or never began to."""


@dataclass
class Readings:
    """Where every state went, as the loop saw it.

    Attributes:
        received: states that arrived.
        lost: numbers left out before the highest that arrived, and never seen.
        overtaken: states that a newer one overtook before they were read.
        again: readings that found no newer state and gave the last one again.
        rejected: packets that are not states made with the key.
    """

    received: int = 0
    lost: int = 0
    overtaken: int = 0
    again: int = 0
    rejected: int = 0


class UdpArm:
    """An arm at the other end of a socket, as run_realtime() wants it.

    Attributes:
        sent: commands sent.
        readings: where every state went.
    """

    def __init__(self, port: int, packets: Packets) -> None:
        """Say hello, and wait for the first state; ``packets`` has the key of the arm.

        Raises:
            ArmLost: none comes within a second, or nobody is there.
        """
        self._packets, self.sent, self.readings = packets, 0, Readings()
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.settimeout(HELLO)
        try:
            self._udp.connect((HOST, port))
            self._udp.send(packets.hello())
            self._newest = self._first_state()
        except OSError as error:
            self.close()
            raise ArmLost(
                f"nothing came back from port {port} within {HELLO:g} s ({error}); "
                "is the arm running?"
            ) from error
        self._udp.setblocking(False)
        self._came = time.perf_counter()

    def _first_state(self) -> tuple[int, Array, Array]:
        """The first packet that is a state made with the key."""
        until = time.monotonic() + HELLO
        while (left := until - time.monotonic()) > 0.0:
            self._udp.settimeout(left)
            try:
                return self._packets.read_state(self._udp.recv(4096))
            except Rejected:
                self.readings.rejected += 1
        raise TimeoutError("no packet was made with the key")

    def read(self) -> tuple[Array, Array]:
        """The newest state's q and v.

        Raises:
            ArmLost: it is older than 20 ms.
        """
        before, readings = self._newest, self.readings
        for _ in range(AT_ONCE):
            try:
                state = self._packets.read_state(self._udp.recv(4096))
            except BlockingIOError:
                break
            except Rejected:
                readings.rejected += 1
                continue
            left_out = state[0] - self._newest[0] - 1
            readings.received += 1
            readings.overtaken += left_out < 0 or self._newest is not before
            readings.lost = max(0, readings.lost + max(-1, left_out))  # an older one is back
            if left_out >= 0:
                self._newest, self._came = state, time.perf_counter()
        readings.again += self._newest is before
        if (age := time.perf_counter() - self._came) > PATIENCE:
            raise ArmLost(f"the arm's newest state is {age:.3f} s old, allowed {PATIENCE} s")
        return self._newest[1:]

    def send(self, v: Array) -> None:
        """Send a command that answers the newest state."""
        if not self.sent:  # what was read to warm up does not count
            self.readings = Readings()
        self._udp.send(self._packets.command(self.sent + 1, self._newest[0], v))
        self.sent += 1

    def halt(self) -> None:
        """Stop the joints, from any thread; three packets, as one may be lost."""
        for _ in range(HALTS):
            self._udp.send(self._packets.halt())

    def close(self) -> None:
        """Hang up."""
        self._udp.close()


@dataclass(frozen=True)
class LoopbackReport:
    """The loop's own report, and both ends' accounts of what went between them.

    Attributes:
        loop: of run_realtime().
        sent: commands sent.
        readings: the loop's account of states.
        arm: the arm's account of commands.
    """

    loop: LoopReport
    sent: int
    readings: Readings
    arm: Account

    @property
    def unaccounted(self) -> int:
        """Commands sent that are not in the arm's account; if not 0, something is wrong."""
        arm = self.arm
        known = (
            arm.used + arm.superseded + arm.refused + arm.disordered + arm.after_halt + arm.lost
        )
        return self.sent - known - (self.sent - arm.highest)

    def rows(self) -> list[tuple[str, str]]:
        """Names and counts of both sides."""
        arm, readings = self.arm, self.readings
        return [
            ("commands sent", str(self.sent)),
            ("- used by the arm", str(arm.used)),
            ("- overtaken by a newer one before the arm's next cycle", str(arm.superseded)),
            (
                f"- refused, as they answered a state more than {TOO_OLD} cycles old",
                str(arm.refused),
            ),
            ("- dropped, as they came after a newer one", str(arm.disordered)),
            ("- dropped, as they came after a halt", str(arm.after_halt)),
            ("- lost on the way", str(arm.lost + self.sent - arm.highest)),
            ("- unaccounted for", str(self.unaccounted)),
            ("used late, answering a state 2 cycles old or more", str(arm.late)),
            ("oldest state that was answered, in cycles", str(arm.oldest)),
            ("arm's cycles without a new command", f"{arm.held} of {arm.cycles}"),
            ("arm's cycles that it overslept itself", str(arm.overslept)),
            ("arm's own emergency stops", str(arm.stopped)),
            ("arm halted by the controller", "yes" if arm.halted else "no"),
            (
                "packets dropped: foreign, malformed, forged, replayed",
                f"{arm.foreign}, {arm.malformed}, {arm.forged}, {arm.replayed}",
            ),
            ("states received by the loop", str(readings.received)),
            ("- overtaken by a newer one before they were read", str(readings.overtaken)),
            ("states lost on the way", str(readings.lost)),
            ("readings that found no new state", str(readings.again)),
            ("packets that were no states of the arm's", str(readings.rejected)),
            ("RCM error of the arm, max", f"{arm.rcm_max_mm:.4f} mm"),
            ("joint speed at the end", f"{arm.speed_end:.3g} rad/s"),
        ]

    def as_markdown(self) -> str:
        """All tables as Markdown."""
        between = Table(("between the two", ""), self.rows())
        return f"{self.loop.as_markdown()}\n\n{between.markdown().rstrip()}"


def run_loopback(
    duration: float,
    *,
    arm: str = "panda",
    controller: str = "dual_quaternion",
    period: float = 1e-3,
    busy: bool = False,
    priority: bool = False,
    record: Callable[[Controller], CycleRecorder | None] = lambda controller: None,
    **options: Any,
) -> LoopbackReport:
    """Circles of the tip, by a simulated arm in another process, for ``duration`` [s].

    Both processes keep time by themselves; the arm cycles half a period after the first command
    came, so that a command has half a period to arrive in.

    Args:
        duration: how long [s], a day at most.
        arm: its name.
        controller: its name.
        period: of both ends [s].
        busy: keep one core busy with something else meanwhile.
        priority: run both ends at real-time priority, as a real controller would.
        record: makes, of the controller, what keeps the run, see run_realtime(); None for nothing.
        options: of the controller.

    Raises:
        ArmLost: the other process does not come up.
        OptionError: the duration or an option is not allowed, or no such priority.
        RcmqpError: there is no such arm or controller.
    """
    if not 0.0 < duration <= LONGEST:
        raise OptionError(
            f"duration = {duration:g} s, it must be positive and finite, a day ({LONGEST:g} s) "
            "at most"
        )
    insertion = insertion_of(arm)
    made = make_controller(controller, insertion, period, **options)
    path = Circle(turns=max(1.0, round(duration / TURN)), duration=max(TURN, duration))

    def references(t: float) -> Stamped:
        return Stamped(view_pose(insertion.x_rcm, path.command(t, insertion.tip_depth)), t)

    keeper = record(made)
    key = new_key()
    packets = Packets(insertion.arm.nq, insertion.arm.nv, key)
    with contextlib.ExitStack() as stack:
        if busy:
            stack.enter_context(_process(["-c", BUSY]))
        if priority:
            stack.enter_context(real_time_priority())
        box = stack.enter_context(arm_process(arm, period, key))
        robot = UdpArm(port_of(box), packets)
        with contextlib.closing(robot):
            loop = run_realtime(robot, made, references, duration, record=keeper)
        account = account_of(box)
    return LoopbackReport(loop, robot.sent, robot.readings, account)


@contextlib.contextmanager
def arm_process(
    arm: str, period: float, key: bytes, patience: int = simulated_arm.PATIENCE
) -> Iterator[subprocess.Popen[str]]:
    """The simulated arm in a process of its own, which gets the key by its stdin."""
    command = ["-m", "rcmqp.realtime.simulated_arm", arm, str(period), str(patience)]
    with _process(command) as box:
        assert box.stdin is not None
        box.stdin.write(f"{key.hex()}\n")
        box.stdin.flush()
        yield box


def account_of(box: subprocess.Popen[str]) -> Account:
    """End the arm's process; its account."""
    assert box.stdin is not None
    box.stdin.close()
    return Account(**_line(box))


@contextlib.contextmanager
def _process(arguments: list[str]) -> Iterator[subprocess.Popen[str]]:
    """Another Python, gone afterwards."""
    pipe = subprocess.PIPE
    command = [sys.executable, *arguments]
    with subprocess.Popen(  # Ctrl-C is for this process alone: the arm must see it stop
        command, stdin=pipe, stdout=pipe, text=True, process_group=0
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def port_of(box: subprocess.Popen[str]) -> int:
    """Where the arm's process listens."""
    return int(_line(box)["port"])


def _line(process: subprocess.Popen[str]) -> dict[str, Any]:
    """The next line of JSON that a process prints."""
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        raise ArmLost("the simulated arm's process has ended; its reason is on stderr")
    found: dict[str, Any] = json.loads(line)
    return found
