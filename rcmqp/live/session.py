"""The process of the loop: the arm, its controller, and the hand that comes from the server.

The server starts it, writes a line of JSON to its stdin, another line to begin, and closes stdin
to end it. It writes a line of JSON when it is ready, and another one at the end. Hands come, and
states go, by a socket that it inherits.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import json
import math
import os
import socket
import sys
import threading
import time
from collections.abc import Callable
from typing import IO, Any

import numpy as np

from rcmqp.controllers import make_controller
from rcmqp.controllers.settings import registered
from rcmqp.errors import RcmqpError
from rcmqp.live.page_hand import PageHand
from rcmqp.live.steering import Held, Steering
from rcmqp.realtime.latency import RECENT, Latency, LatencyCounter, Pace
from rcmqp.realtime.loop import RealtimeLoop
from rcmqp.realtime.simulated_arm import SimulatedArm
from rcmqp.realtime.system import priority_if_permitted
from rcmqp.references.governor import tip_distance
from rcmqp.references.operators.camera_task import Goals
from rcmqp.references.paths import Search
from rcmqp.references.view import Stamped
from rcmqp.runs.loop_record import LoopRecorder
from rcmqp.runs.scenario import Scenario
from rcmqp.show.viewer.timeline import FRAME_RATE, slip
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion

LONGEST = 86400.0
"""A session ends after a day [s]."""

TOO_SLOW = 0.2
"""A loop that skips a larger share holds a core for ever: it goes on at ordinary priority."""

LATENESS = 10.0
"""How late a cycle may be [s]: the simulated arm waits for it."""


class Session:
    """Gives the loop its references, and the pages what the arm does.

    Attributes:
        steering: makes the references.
        hand: of the page that steers.
        goals: places that the tip is to reach; without any, none.
        input: from an input event to the command that follows it.
        state: from that command to the state that is sent of it.
        skipped: the share of the last cycles that was skipped, see Pace.
    """

    def __init__(
        self,
        insertion: Insertion,
        robot: SimulatedArm,
        channel: socket.socket,
        period: float,
        hand: dict[str, float],
        goals: Goals | None = None,
    ) -> None:
        """Begin at rest; ``hand`` has the options of Steering."""
        self.goals = goals or Goals(np.zeros((0, 3)), math.inf)
        self.input, self.state = LatencyCounter(), LatencyCounter()
        self.hand = PageHand(channel, time.monotonic)
        self._insertion, self._robot, self._channel = insertion, robot, channel
        self.steering = Steering(insertion, self.hand, period, **hand)
        self._time, self._cycle = 0.0, 0
        self._every = max(1, math.floor(1.0 / (FRAME_RATE * period) + 1e-9))
        self._followed = self._commanded = math.nan
        self._pace, self.skipped = Pace(period), 0.0

    def __call__(self, t: float) -> Stamped:
        """The reference at ``t`` [s]."""
        if not math.isnan(self._followed):  # its command has left meanwhile
            self._commanded = self._robot.sent_at
            self.input.add(self._commanded - self._followed, t)
        self._time, found = t, self.steering(t)
        self._followed = self.hand.take_event()
        return found

    def see(self, state: ArmState) -> None:
        """Take the state that was measured; every sixtieth of a second, tell the pages."""
        self.steering.see(state)
        if self.goals.left:
            self.goals.see(self._time, self._insertion.tip(state.x))
        if self._cycle % self._every == 0:
            self._tell(state)
        self._cycle += 1

    def _tell(self, state: ArmState) -> None:
        insertion, pivot = self._insertion, np.array(self._insertion.trocar.pivot)
        at = time.monotonic()
        if not math.isnan(self._commanded):
            self.state.add(at - self._commanded, self._time)
            self._commanded = math.nan
        asked = self.steering.reference
        if self._time > 0.0:  # the warm-up is at 0 and has no pace
            self.skipped = self._pace.skipped(self._time, self._cycle)
        words = {
            "kind": "state",
            "time": self._time,
            "at": at,
            "angles": state.angles.tolist(),
            "tip": insertion.tip(state.x).tolist(),
            "tip_d": insertion.tip(asked.x_d).tolist(),
            "pivot": pivot.tolist(),
            "slip": slip(state.x, pivot).tolist(),
            "tip_error": [tip_distance(state, asked, insertion)],
            "depth": [float(insertion.depth(state.x, pivot))],
            "moving": bool(state.v.any()),
            "stopped": self.hand.stopped,
            "skipped": round(self.skipped, 3),
            "viscosity": self.steering.viscosity,
            "reached": self.goals.reached,
        }
        if self._cycle // self._every % 60 == 0:
            words["latency"] = self.latency()
        try:
            self._channel.send(json.dumps(words).encode())
        except OSError:  # nobody reads them now
            pass

    def latency(self) -> dict[str, list[float]]:
        """Latency of ``input`` and ``state``, each as quantiles() gives it."""
        return {"input": quantiles(self.input.latency()), "state": quantiles(self.state.latency())}


def quantiles(latency: Latency) -> list[float]:
    """Median, p95 and p99 [s], and the number of values."""
    return [*(latency.quantile(share) for share in (0.5, 0.95, 0.99)), latency.total]


def simulated(scenario: Scenario) -> Insertion:
    """The scenario's instrument in its trocar, on an arm whose limits count as confirmed."""
    given = scenario.insertion()
    return Insertion(
        given.bare.confirmed(),
        given.instrument,
        given.trocar,
        given.angles_start,
        tolerance=scenario.shaft_tolerance,
        obstacles=given.obstacles,
    )


def run(
    header: dict[str, Any], channel: socket.socket, ready: Callable[[], None]
) -> dict[str, Any]:
    """Run the loop until stdin closes or it stops by itself; what the server is told of it.

    Args:
        header: from the server.
        channel: hands come and states go by it.
        ready: is called when the loop can begin.

    Raises:
        RcmqpError: the loop cannot begin.
    """
    scenario = Scenario.from_json(header["scenario"])
    path, goals = scenario.path, None
    insertion, period = simulated(scenario), scenario.period
    name = registered(header["controller"])
    controller = make_controller(name, insertion, period, **header["options"])
    robot = SimulatedArm(insertion, period)
    if isinstance(path, Search) and not header.get("practice"):
        goals = Goals.of(path, insertion)
    session = Session(insertion, robot, channel, period, header["hand"], goals)
    record = None
    if header["out"] is not None:
        follows = path if isinstance(path, Search) else None
        name = f"live {scenario.name}"[:200]
        record = LoopRecorder(header["out"], controller, name, follows=follows)
    duration = header.get("duration", LONGEST)
    held = Held.by(session.steering, controller)
    loop = RealtimeLoop(robot, held, session, duration, lateness=LATENESS, record=record)

    def listen() -> None:
        sys.stdin.read()
        loop.stop()

    def runs() -> bool:
        if session.goals.done:
            loop.stop()
        if session.skipped > TOO_SLOW:
            priority.give_up(
                f"more than {TOO_SLOW:.0%} of the cycles of {RECENT:g} s were skipped"
            )
        return loop.cycle()

    with priority_if_permitted() as priority, loop:
        ready()
        begun = bool(sys.stdin.readline())
        threading.Thread(target=listen, daemon=True).start()
        gc.collect()
        gc.freeze()
        gc.disable()
        due = time.perf_counter()
        while begun and runs():
            due = max(due + period, time.perf_counter() - period)
            time.sleep(max(0.0, due - time.perf_counter()))
    report = dataclasses.replace(loop.report(), priority=priority.words)
    hand = session.hand
    counted = [
        ("messages that the loop took", str(hand.taken)),
        ("grips ended by 100 ms of silence", str(hand.stopped)),
    ]
    return {
        "report": report.as_markdown(),
        "fault": "" if report.stop.fault == "asked to stop" else report.stop.fault,
        "recorded": report.recorded,
        "recorded_whole": record is None or record.whole,
        "latency": session.latency(),
        "priority": report.priority,
        "skipped": report.skipped_share,
        "rows": counted,
        "reached": session.goals.reached,
    }


def answers() -> IO[str]:
    """The stream to the server, which was stdout.

    From now on stdout goes to stderr, so the server never reads what a user's law prints.
    """
    stream = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    return stream


def say(stream: IO[str], **words: Any) -> None:
    """Tell the server something, unless it was killed."""
    with contextlib.suppress(BrokenPipeError):
        print(json.dumps(words), file=stream, flush=True)


def main() -> None:
    """Be the loop's process."""
    stream, header = answers(), json.loads(sys.stdin.readline())
    channel = socket.socket(fileno=header["channel"])
    channel.setblocking(False)
    try:
        say(stream, **run(header, channel, lambda: say(stream, ready=True)))
    except RcmqpError as error:
        say(stream, error=str(error))


if __name__ == "__main__":
    main()
