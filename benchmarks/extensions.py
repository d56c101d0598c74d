"""What a task or a limit of one's own costs a step of hierarchical_qp: in turns, step by step."""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is imported

import numpy as np

import rcmqp
from rcmqp.controllers import HierarchicalQP
from rcmqp.limits import Constraint, JointLimits, Limit, TrocarCone, TrocarDepth
from rcmqp.references.view import Reference
from rcmqp.tasks import DepthTask, DirectionTask, RcmTask, Residual, RollTask, Task, TipTask
from rcmqp.world.arm import ArmState

COLD = 100
"""Steps that are not counted."""

ROLL = RollTask()

T = TypeVar("T")

SPENT: list[float] = []
"""Times of evaluate() of what is written in Python, since the last step began [us]."""


def timed(evaluate: Callable[[Any, ArmState, Reference], T]) -> Callable[..., T]:
    """Note what an evaluate() takes inside a step, where memory is as cold as it is there."""

    def inner(self: Any, state: ArmState, reference: Reference) -> T:
        start = time.thread_time_ns()
        rows = evaluate(self, state, reference)
        SPENT.append((time.thread_time_ns() - start) / 1e3)
        return rows

    return inner


@dataclass(frozen=True, eq=False)
class LevelCamera(Task):
    """The README's task: turn about the shaft until the image's x axis is level."""

    @timed
    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """One row."""
        up = state.oMe.rotation[2]
        by_omega = np.array([[0.0, -up[2], up[1]]])
        return Residual(up[:1], by_omega @ state.J_local[3:], np.zeros(1))


@dataclass(frozen=True, eq=False)
class GentleInsertion(Limit):
    """The README's limit: go into the patient no faster than ``speed`` [m/s]."""

    speed: float

    @timed
    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """One row."""
        along = state.J_local[2:3]
        return Constraint.rows(along, [self.speed], ["insertion speed"])


@dataclass(frozen=True, eq=False)
class OwnRoll(Task):
    """The rows of RollTask, as if they were somebody's own."""

    @timed
    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """One row."""
        return ROLL.evaluate(state, reference)


@dataclass(frozen=True, eq=False)
class OwnDepth(Limit):
    """The rows of TrocarDepth, as if they were somebody's own."""

    depth: TrocarDepth

    @timed
    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """Two rows."""
        return self.depth.evaluate(state, reference)


class Case:
    """A controller in a loop of its own.

    Attributes:
        name: of it.
        steps: time of each step [us].
        evaluations: time of evaluate() in it, of what is written in Python [us].
    """

    def __init__(
        self,
        name: str,
        scenario: rcmqp.Scenario,
        levels: list[Task],
        more: list[Limit],
    ) -> None:
        self.name, self.insertion = name, scenario.insertion()
        self.period, self.q = scenario.period, self.insertion.q_start
        limits = [JointLimits(self.insertion.arm, self.period), *more]
        self.controller = HierarchicalQP(self.insertion, self.period, levels=levels, limits=limits)
        self.v = self.a = np.zeros(self.insertion.arm.nv)
        self.steps: list[float] = []
        self.evaluations: list[float] = []

    def go_on(self, reference: Reference) -> None:
        """A cycle; its step, and evaluate() in it, are timed in a processor's time."""
        state = self.insertion.state(self.q, self.v, self.a)
        SPENT.clear()
        start = time.thread_time_ns()
        v = self.controller.step(state, reference).v
        self.steps.append((time.thread_time_ns() - start) / 1e3)
        self.evaluations.append(sum(SPENT))
        self.a, self.v = (v - self.v) / self.period, v
        self.q = self.insertion.arm.integrate(self.q, v, self.period)


def cases(scenario: rcmqp.Scenario) -> dict[str, list[Case]]:
    """What is timed, by what all of it in compiled code is called; that comes first."""
    insertion = scenario.insertion()
    trocar, rcm, tip = insertion.trocar, RcmTask(period=scenario.period), TipTask()
    narrow = dataclasses.replace(trocar, depth_range=(0.0, insertion.tip_depth + 1e-3))
    depth, end = TrocarDepth(trocar), TrocarDepth(narrow)
    camera, gentle = LevelCamera(gain=8.0), GentleInsertion(0.5)
    cone = TrocarCone(trocar)

    def case(name: str, levels: list[Task], more: list[Limit]) -> Case:
        return Case(name, scenario, levels, more)

    usual: list[Task] = [rcm, tip, ROLL]
    return {
        "RCM > tip > roll": [
            case("compiled", usual, [depth]),
            case("roll in Python", [rcm, tip, OwnRoll()], [depth]),
            case("depth limit in Python", usual, [OwnDepth(depth)]),
            case("README's LevelCamera for roll", [rcm, tip, camera], [depth]),
            case("DirectionTask for tip", [rcm, DirectionTask(), ROLL], [depth]),
            case("DepthTask for tip", [rcm, DepthTask(), ROLL], [depth]),
        ],
        "the same, one more hard row": [
            case("compiled", usual, [depth, cone]),
            case("README's GentleInsertion", usual, [depth, gentle]),
        ],
        "the same, depth limit in the way": [
            case("compiled", usual, [end]),
            case("depth limit in Python", usual, [OwnDepth(end)]),
        ],
    }


def main() -> None:
    """Print a table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arm", default="panda")
    parser.add_argument("--cycles", type=int, default=5000)
    asked = parser.parse_args()
    scenario = rcmqp.load_scenario("conical_helix", asked.arm)
    timed = cases(scenario)
    references = scenario.references(scenario.insertion())
    for reference in itertools.islice(references, asked.cycles):
        for case in itertools.chain(*timed.values()):
            case.go_on(reference)
    print("| levels | | median | p99 | times compiled | its evaluate() | beyond both |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, group in timed.items():
        plain = float(np.median(group[0].steps[COLD:]))
        for case in group:
            median, late = np.percentile(case.steps[COLD:], [50.0, 99.0])
            own = float(np.median(case.evaluations[COLD:]))
            print(
                f"| {name} | {case.name} | {median:.1f} us | {late:.1f} us | "
                f"{median / plain:.2f} | {own:.1f} us | {median - plain - own:.1f} us |"
            )


if __name__ == "__main__":
    main()
