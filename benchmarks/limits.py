"""What a step of hierarchical_qp takes where limits are in the way, beside one where none is.

On every arm, two helices in turns, step by step: one too fast for the arm, and one that it follows
with ease. A step counts as held back where a level takes a round of the active set. Times are of
the processor.

    python benchmarks/limits.py
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is imported

import numpy as np

from rcmqp import arm_names, load_scenario, make_controller
from rcmqp.controllers import Controller
from rcmqp.qp import HierarchySolution
from rcmqp.runs.scenario import Scenario
from rcmqp.show.table import Table

COLD = 20
"""Steps that are not counted."""


def steps(name: str, arm: str, duration: float, backend: str) -> Iterator[tuple[float, int]]:
    """Time [us] and rounds of each step of a run."""
    scenario: Scenario = load_scenario(name, arm, duration=duration, period=0.001)
    insertion, T = scenario.insertion(), scenario.period
    law: Controller = make_controller("hierarchical_qp", insertion, T, backend=backend)
    nothing = np.zeros(insertion.arm.nv)
    q, v, a = insertion.q_start, nothing, nothing
    for reference in scenario.references(insertion):
        state = insertion.state(q, v, a)
        start = time.thread_time_ns()
        answer = law.step(state, reference)
        spent = (time.thread_time_ns() - start) / 1e3
        assert isinstance(answer.account, HierarchySolution)
        yield spent, sum(level.rounds for level in answer.account.levels)
        q, v, a = insertion.arm.integrate(q, answer.v, T), answer.v, (answer.v - v) / T


def row(arm: str, duration: float, backend: str) -> list[str | int | float]:
    """A line of the table."""
    free, held, rounds, count = [], [], [], 0
    easy, fast = (steps(name, arm, duration, backend) for name in ("conical_helix", "fast_helix"))
    for count, ((alone, none), (spent, used)) in enumerate(zip(easy, fast, strict=True), 1):
        if count <= COLD:
            continue
        if none == 0:
            free.append(alone)
        if used > 0:
            held.append(spent)
            rounds.append(used)
    median, late, plain = np.median(held), np.quantile(held, 0.99), np.median(free)
    return [
        arm,
        f"{len(held) / (count - COLD):.0%}",
        f"{plain:.1f}",
        f"{median:.1f}",
        f"{late:.1f}",
        f"{median / plain:.1f}",
        f"{late / median:.1f}",
        f"{np.median(rounds):.0f}",
        f"{np.quantile(rounds, 0.99):.0f}",
    ]


HEADS = (
    "arm",
    "held back",
    "free [us]",
    "held back [us]",
    "p99",
    "held back / free",
    "p99 / median",
    "rounds",
    "rounds, p99",
)


def main() -> None:
    """Run, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--duration", type=float, default=1.5, help="of each run [s]")
    parser.add_argument("--arms", nargs="+", default=arm_names(), choices=arm_names())
    parser.add_argument("--backend", default="active_set")
    given = parser.parse_args()
    rows = [row(arm, given.duration, given.backend) for arm in given.arms]
    print(Table(list(HEADS), rows).markdown(), end="")


if __name__ == "__main__":
    main()
