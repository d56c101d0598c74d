"""What a task or a limit of one's own costs a step of hierarchical_qp: in turns, step by step."""

from __future__ import annotations

import argparse
import itertools
import os
import time
from dataclasses import dataclass
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is imported

import numpy as np

import rcmqp
from rcmqp.controllers import HierarchicalQP
from rcmqp.limits import Constraint, JointLimits, Limit, TrocarDepth
from rcmqp.references.view import Reference
from rcmqp.tasks import DepthTask, DirectionTask, RcmTask, Residual, RollTask, Task, TipTask
from rcmqp.world.arm import ArmState

COLD = 100
"""Steps that are not counted."""

ROLL = RollTask()


@dataclass(frozen=True, eq=False)
class LevelCamera(Task):
    """The README's task: turn about the shaft until the image's x axis is level."""

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """One row."""
        up = state.oMe.rotation[2]
        by_omega = np.array([[0.0, -up[2], up[1]]])
        return Residual(up[:1], by_omega @ state.J_local[3:], np.zeros(1))


@dataclass(frozen=True, eq=False)
class GentleInsertion(Limit):
    """The README's limit: go into the patient no faster than ``speed`` [m/s]."""

    speed: float

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """One row."""
        along = state.J_local[2:3]
        return Constraint.rows(along, [self.speed], ["insertion speed"])


@dataclass(frozen=True, eq=False)
class OwnRoll(Task):
    """The rows of RollTask, as if they were somebody's own."""

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """One row."""
        return ROLL.evaluate(state, reference)


@dataclass(frozen=True, eq=False)
class OwnDepth(Limit):
    """The rows of TrocarDepth, as if they were somebody's own."""

    depth: TrocarDepth

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """Two rows."""
        return self.depth.evaluate(state, reference)


class Case:
    """A controller in a loop of its own.

    Attributes:
        name: of it.
        own: what it is given that is written in Python, if anything.
    """

    def __init__(
        self,
        name: str,
        scenario: rcmqp.Scenario,
        levels: list[Task],
        more: list[Limit],
        own: Task | Limit | None = None,
    ) -> None:
        self.name, self.own, self.insertion = name, own, scenario.insertion()
        self.period, self.q = scenario.period, self.insertion.q_start
        limits = [JointLimits(self.insertion.arm, self.period), *more]
        self.controller = HierarchicalQP(self.insertion, self.period, levels=levels, limits=limits)
        self.v = self.a = np.zeros(self.insertion.arm.nv)
        self.steps: list[float] = []
        self.evaluations: list[float] = []

    def go_on(self, reference: Reference) -> None:
        """A cycle; its step, and what is in Python of it, are timed in a processor's time."""
        state = self.insertion.state(self.q, self.v, self.a)
        start = time.thread_time_ns()
        v = self.controller.step(state, reference).v
        self.steps.append((time.thread_time_ns() - start) / 1e3)
        if self.own is not None:
            start = time.thread_time_ns()
            self.own.evaluate(state, reference)
            self.evaluations.append((time.thread_time_ns() - start) / 1e3)
        self.a, self.v = (v - self.v) / self.period, v
        self.q = self.insertion.arm.integrate(self.q, v, self.period)


def cases(scenario: rcmqp.Scenario) -> list[Case]:
    """What is timed; the first is the plain step, with which the others are compared."""
    insertion = scenario.insertion()
    rcm, tip = RcmTask(period=scenario.period), TipTask(insertion.tip_depth)
    depth = TrocarDepth(insertion.trocar, insertion.tip_depth)
    camera, gentle, blocked = LevelCamera(gain=8.0), GentleInsertion(0.5), GentleInsertion(1e-3)
    own_roll, own_depth = OwnRoll(), OwnDepth(depth)

    def case(name: str, levels: list[Task], more: list[Limit], own: Any = None) -> Case:
        return Case(name, scenario, levels, more, own)

    return [
        case("RCM > tip > roll", [rcm, tip, ROLL], [depth]),
        case("the same, roll in Python", [rcm, tip, own_roll], [depth], own_roll),
        case("the same, depth limit in Python", [rcm, tip, ROLL], [own_depth], own_depth),
        case("README's task: RCM > tip > LevelCamera", [rcm, tip, camera], [depth], camera),
        case("README's limit: GentleInsertion", [rcm, tip, ROLL], [depth, gentle], gentle),
        case("the same, in the way", [rcm, tip, ROLL], [depth, blocked], blocked),
        case("RCM > DirectionTask > roll", [rcm, DirectionTask(), ROLL], [depth]),
        case("RCM > DepthTask > roll", [rcm, DepthTask(), ROLL], [depth]),
    ]


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
        for case in timed:
            case.go_on(reference)
    plain = float(np.median(timed[0].steps[COLD:]))
    print("| step | median | p99 | times the plain step | its evaluate() | beyond both |")
    print("| --- | --- | --- | --- | --- | --- |")
    for case in timed:
        median, late = np.percentile(case.steps[COLD:], [50.0, 99.0])
        own = float(np.median(case.evaluations[COLD:])) if case.evaluations else 0.0
        print(
            f"| {case.name} | {median:.1f} us | {late:.1f} us | {median / plain:.2f} | "
            f"{own:.1f} us | {median - plain - own:.1f} us |"
        )


if __name__ == "__main__":
    main()
