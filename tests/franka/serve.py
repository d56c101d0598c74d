"""The simulator of Franka's control interface, in an environment of its own; see simulator.py.

    python serve.py ADDRESS SLOWNESS

It checks what a robot checks: each joint's speed, acceleration and jerk as commanded, the packets
that are missing, and the speed and the collisions of the arm as it moves. Everything is counted in
cycles of 1 ms. Its clock may be slower than others, so that a busy machine loses no packet.
"""

from __future__ import annotations

import logging
import signal
import sys
import time
from typing import Any

import franka_sim
import franka_sim.mujoco_franka_sim
import franka_sim.server.motion_session
import franka_sim.server.state_stream


class SlowClock:
    """The module ``time``, in which a second takes ``slowness`` seconds."""

    def __init__(self, slowness: float) -> None:
        self._slowness = slowness

    def __getattr__(self, name: str) -> Any:
        return getattr(time, name)

    def time(self) -> float:
        return time.time() / self._slowness

    def perf_counter(self) -> float:
        return time.perf_counter() / self._slowness

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds * self._slowness)


def main(address: str, slowness: float) -> None:
    """Serve until SIGTERM."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    paced = franka_sim.mujoco_franka_sim, franka_sim.server.motion_session
    for module in (*paced, franka_sim.server.state_stream):
        module.time = SlowClock(slowness)
    server = franka_sim.FrankaSimServer(
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
    main(sys.argv[1], float(sys.argv[2]))
