"""What simulate() adds to a control cycle, and what a second process brings: rcmqp alone."""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is imported

import rcmqp
from rcmqp.controllers import Controller
from rcmqp.experiments.compare import cases, compare
from rcmqp.references.view import Reference
from rcmqp.runs.simulate import record
from rcmqp.show.table import Table
from rcmqp.world.loading import arm_names

LAWS = ("dual_quaternion", "hierarchical_qp")


def control(scenario: rcmqp.Scenario, controller: Controller, references: list[Reference]) -> None:
    """State, step and integration, with references made beforehand: what counts as control."""
    arm, T = controller.insertion.arm, scenario.period
    q, v, a = controller.insertion.q_start, 0.0 * arm.velocity, 0.0 * arm.velocity
    controller.reset()
    for reference in references:
        before, v = v, controller.step(arm.state(q, v, a), reference).v
        a, q = (v - before) / T, arm.integrate(q, v, T)


def processor_time(work: Callable[[], object]) -> float:
    """Seconds that a processor spent on it: what others do meanwhile does not count."""
    start = time.process_time()
    work()
    return time.process_time() - start


def added(scenario: rcmqp.Scenario, law: str, rounds: int) -> list[str]:
    """A row: microseconds a step, the least of several rounds in turns."""
    controller = rcmqp.make_controller(law, scenario.insertion(), scenario.period)
    references = list(scenario.references(controller.insertion))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.h5"
        ways: tuple[Callable[[], object], ...] = (
            lambda: control(scenario, controller, references),
            lambda: rcmqp.simulate(scenario, controller),
            lambda: record(scenario, controller, file),
        )
        times = [[processor_time(way) for way in ways] for _ in range(rounds)]
    alone, memory, streamed = (
        1e6 * min(column) / len(references) for column in zip(*times, strict=True)
    )
    return [law, f"{alone:.1f}", f"{memory - alone:.1f}", f"{streamed - alone:.1f}"]


def jobs(duration: float, rounds: int) -> list[str]:
    """A row: seconds on the clock of 16 runs in one process and in two, the least of several."""
    todo = cases(["conical_helix"], arm_names(), LAWS, {"duration": duration})
    times: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(rounds):
        for count, found in times.items():
            with tempfile.TemporaryDirectory() as folder:  # a comparison goes on in its folder
                start = time.perf_counter()
                compare(todo, folder, jobs=count)
                found.append(time.perf_counter() - start)
    one, two = min(times[1]), min(times[2])
    return [f"{one:.1f}", f"{two:.1f}", f"{one / two:.2f}"]


def main() -> None:
    """Print both tables as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=20.0, help="of each run [s]")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--jobs", action="store_true", help="time a comparison instead")
    asked = parser.parse_args()
    if asked.jobs:
        rows = [jobs(asked.duration, asked.rounds)]
        print(Table(["1 job [s]", "2 jobs [s]", "ratio"], rows, words=0).markdown(), end="")
        return
    scenario = rcmqp.load_scenario("conical_helix", duration=asked.duration)
    heads = ["controller", "control [us]", "simulate adds [us]", "to a file [us]"]
    rows = [added(scenario, law, asked.rounds) for law in LAWS]
    print(Table(heads, rows).markdown(), end="")


if __name__ == "__main__":
    main()
