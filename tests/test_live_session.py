"""The loop's process of rcmqp live, without its server."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from at_the_console import ARM, until
from priorities import may_be_real_time, policies, shows_priorities

from rcmqp import load_scenario, make_controller
from rcmqp.live.loop_process import LoopProcess, channel_ends, loop_process
from rcmqp.live.messages import Hand
from rcmqp.live.session import Session, simulated
from rcmqp.live.steering import Held
from rcmqp.realtime.latency import RECENT, Ticks
from rcmqp.realtime.loop import RealtimeLoop
from rcmqp.realtime.simulated_arm import SimulatedArm

SCENARIO = load_scenario("camera_task", ARM)
HAND = {"scale": 1.0, "viscosity": 15.0}


def header(law: Path, body: str) -> dict[str, Any]:
    """Of a session with a law of one's own, whose step() does what ``body`` says, then its own."""
    law.write_text(
        "import os, sys, time\n"
        "from dataclasses import dataclass\n"
        "from rcmqp.controllers.hierarchical_qp import HierarchicalQP\n"
        "print('hello from the file')\n"
        "os.write(1, b'hello from below\\n')\n"
        "@dataclass(frozen=True, eq=False)\n"
        "class MyLaw(HierarchicalQP):\n"
        "    def _step(self, state, reference):\n"
        f"        {body}\n"
        "        return super()._step(state, reference)\n"
    )
    return {
        "scenario": SCENARIO.to_json(carry=True),
        "controller": f"{law}:MyLaw",
        "options": {},
        "hand": HAND,
        "out": None,
    }


def hold(loop: LoopProcess, number: int) -> bool:
    """Hold on and move the hand; whether the arm moves now."""
    at, moving = time.monotonic(), False
    way = (0.01 * np.sin(at), 0.0, 0.0, 0.0)
    grip = number // 50  # one that a busy machine has ended does not begin again
    with contextlib.suppress(BlockingIOError):
        loop.channel.send(Hand(number, grip, True, at, np.nan, way).pack())
    with contextlib.suppress(BlockingIOError):
        while True:
            moving = json.loads(loop.channel.recv(1 << 16))["moving"]
    return bool(moving)


def test_what_a_law_prints_is_no_answer_to_the_server(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    with loop_process(header(tmp_path / "own.py", "print('hello from a step')")) as loop:
        loop.prepare()
        at_once = capfd.readouterr()
        loop.start()
        numbers = itertools.count(1)
        until(lambda: hold(loop, next(numbers)), "the arm to move")
        loop.stop()
        last = loop.last_words()
    assert last["fault"] == ""
    said = capfd.readouterr()
    assert at_once.out == said.out == ""
    for place, text in (("the file", at_once.err), ("below", at_once.err), ("a step", said.err)):
        assert f"hello from {place}\n" in text


@shows_priorities
def test_a_loop_whose_law_is_too_slow_does_not_hold_a_core_at_real_time_priority(
    tmp_path: Path,
) -> None:
    """Where none is permitted, it is at ordinary priority throughout, and says so."""
    slow, real_time = f"time.sleep({3.0 * SCENARIO.period})", may_be_real_time()
    with loop_process(header(tmp_path / "own.py", slow)) as loop:
        loop.prepare()
        assert policies(loop.number) == {os.SCHED_FIFO if real_time else os.SCHED_OTHER}
        loop.start()
        numbers = itertools.count(1)

        def gave_up() -> bool:
            hold(loop, next(numbers))
            return policies(loop.number) == {os.SCHED_OTHER}

        until(gave_up, "the loop to be at ordinary priority")
        loop.stop()
        last = loop.last_words()
    if real_time:
        why = "then ordinary, as more than 20% of the cycles of 3 s were skipped"
        assert last["priority"].endswith(why)
        assert last["skipped"] > 0.2
    else:
        assert last["priority"].startswith("ordinary, as")
    assert f"| priority | {last['priority']} |" in last["report"]


@pytest.mark.parametrize("lateness", [1.0, 1.9])
def test_page_notes_and_report_agree_on_the_share_of_skipped_cycles(lateness: float) -> None:
    """Cycles of 1.9 periods skip none as a whole, but the arm goes at about half its speed."""
    insertion, T, clock = simulated(SCENARIO), SCENARIO.period, [100.0]
    controller = make_controller("hierarchical_qp", insertion, T)
    robot, (ours, theirs) = SimulatedArm(insertion, T), channel_ends()
    with closing(ours), closing(theirs):
        for end in (ours, theirs):
            end.setblocking(False)
        session = Session(insertion, robot, theirs, T, HAND)
        timing = Ticks(T, 0.0, lambda: clock[0], lambda _: None)
        held = Held.by(session.steering, controller)
        loop = RealtimeLoop(robot, held, session, 1.5 * RECENT, lateness=10.0, timing=timing)
        with loop:
            told = [json.loads(text) for text in _after(loop, ours, clock, lateness * T)]
    report = loop.report()
    share = 1.0 - 1.0 / lateness
    assert told[0]["skipped"] == 0.0
    later = [state["skipped"] for state in told if state["time"] > 0.6 * RECENT]
    assert later == pytest.approx([share] * len(later), abs=2e-3)
    assert told[-1]["time"] > RECENT
    assert report.skipped_share == pytest.approx(share, abs=2e-3)
    assert report.skipped == pytest.approx((lateness - 1.0) * report.cycles, abs=2)
    assert np.isclose(session.skipped, told[-1]["skipped"], atol=1e-3)


def _after(
    loop: RealtimeLoop, channel: socket.socket, clock: list[float], step: float
) -> Iterator[bytes]:
    """Run all cycles, one every ``step`` [s] of a clock that stands still in between."""
    while True:
        clock[0] += step
        more = loop.cycle()
        while True:
            try:
                yield channel.recv(1 << 16)
            except BlockingIOError:
                break
        if not more:
            return
