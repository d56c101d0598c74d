"""The simulator of Franka's control interface, in an environment of its own; see simulator.py.

    python serve.py ADDRESS

It checks what a robot checks: each joint's speed, acceleration and jerk as commanded, the packets
that are missing, and the speed and the collisions of the arm as it moves. All of that is counted
in cycles of 1 ms. Here cycles wait for the client, so that a busy machine changes nothing.
"""

from __future__ import annotations

import logging
import signal
import sys
import threading
import time
from typing import Any

import franka_sim
import franka_sim.mujoco_franka_sim

PATIENCE = 0.05
"""How long a command is waited for before its cycle counts as lost [s]; a robot waits for 1 ms."""

CYCLE = 1e-3
"""[s]."""


class CycleClock:
    """The module ``time``, in which a millisecond is a cycle of the server."""

    def __init__(self) -> None:
        self._cycles = 0
        self._changed = threading.Condition()

    def __getattr__(self, name: str) -> Any:
        return getattr(time, name)

    def tick(self) -> None:
        """A cycle is over."""
        with self._changed:
            self._cycles += 1
            self._changed.notify_all()

    def perf_counter(self) -> float:
        return self._cycles * CYCLE

    def sleep(self, seconds: float) -> None:
        """Wait for the cycle at which ``seconds`` are over; not for long where nobody is there."""
        until = self.perf_counter() + seconds - 0.5 * CYCLE
        with self._changed:
            self._changed.wait_for(lambda: self.perf_counter() >= until, timeout=0.1)


class Server(franka_sim.FrankaSimServer):  # type: ignore[misc]
    """Franka's control interface. A command that is late all the same is dropped, as by a robot.

    As it comes, the simulator takes a late command back into a cycle that it has told the client
    otherwise of, and then finds three times the jerk that the client has commanded.
    """

    clock = CycleClock()
    _DRAIN_GATE_TIMEOUT = 1.0  # [s]; a command that has come is applied before the next state

    def _drain_gate(self, answer_deadline: float = 0.0) -> float:
        waited = float(super()._drain_gate(answer_deadline + PATIENCE))
        self.clock.tick()
        return waited

    def _absorb_within_motion_limits(self, command: dict[str, Any], *, fresh: bool) -> bool:
        return fresh and bool(super()._absorb_within_motion_limits(command, fresh=fresh))


def main(address: str) -> None:
    """Serve until SIGTERM."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    franka_sim.mujoco_franka_sim.time = Server.clock  # physics keep the server's time
    server = Server(
        host=address,
        enable_gripper=False,
        enforce_comm_constraints=True,
        enforce_motion_limits=True,
    )
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit())
    try:
        server.start()
    finally:
        server.stop()


if __name__ == "__main__":
    main(sys.argv[1])
