"""What simulate() adds to a control cycle, and what a second process brings: for rcmqp alone."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"

import rcmqp
from rcmqp.compare import cases, compare
from rcmqp.controllers import Controller
from rcmqp.errors import RcmqpError
from rcmqp.recorder import Recorder
from rcmqp.reference import Reference

LAWS = ("dual_quaternion", "hierarchical_qp")


def bare(scenario: rcmqp.Scenario, controller: Controller, references: list[Reference]) -> float:
    """Seconds of state, step and integration alone, the references made beforehand."""
    arm, T = controller.insertion.arm, scenario.period
    q, v = controller.insertion.q_start, controller.insertion.arm.velocity * 0.0
    controller.reset()
    start = time.process_time()
    for reference in references:
        v = controller.step(arm.state(q, v), reference).v
        q = arm.integrate(q, v, T)
    return time.process_time() - start


def simulated(scenario: rcmqp.Scenario, controller: Controller, file: Path | None) -> float:
    """Seconds of simulate(): into memory, or into a file."""
    start = time.process_time()
    rcmqp.simulate(scenario, controller)
    return time.process_time() - start


def overhead(scenario: rcmqp.Scenario, law: str, rounds: int) -> str:
    """A line of the table: the least of several rounds, in turns."""
    controller = rcmqp.make_controller(law, scenario.insertion(), scenario.period)
    references = list(scenario.references(controller.insertion))
    times = [
        (bare(scenario, controller, references), simulated(scenario, controller, None))
        for _ in range(rounds)
    ]
    control, memory = (1e6 * min(column) / len(references) for column in zip(*times, strict=True))
    return f"| {law} | {control:.1f} | {memory:.1f} | {memory - control:.1f} |"


if __name__ == "__main__":
    s = rcmqp.load_scenario("conical_helix", "lwa3", duration=20.0)
    for law in LAWS:
        print(overhead(s, law, 5))
