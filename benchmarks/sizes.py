"""How the time of a step of hierarchical_qp grows with joints, levels and hard rows.

    python benchmarks/sizes.py > sizes.md

The arm is a chain of links, 1.2 m in all, whose joints turn about z and y in turns. Levels are
RCM > tip, then roll, direction and depth as far as they are wanted, and posture last. Hard rows
are spheres that the shaft is to keep out of, beside and beyond the tip, whose way leads along a
conical helix into some of them. Position, speed, acceleration and jerk are limited. The cases of
an arm take their steps in turns, timed in the processor's time of the thread: the median [us], and
in brackets the 99th percentile and the share of the steps in which a hard row is at its bound. The
first steps are not counted.
"""

from __future__ import annotations

import argparse
import itertools
import os
import time

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is imported

import numpy as np
import pinocchio as pin

from rcmqp import Arm, Insertion, view_pose
from rcmqp.controllers import HierarchicalQP
from rcmqp.limits import JointLimits, KeepOut
from rcmqp.qp import HierarchySolution
from rcmqp.references.paths import ConicalHelix
from rcmqp.references.view import Reference
from rcmqp.show.table import Table
from rcmqp.tasks import DepthTask, DirectionTask, PostureTask, RcmTask, RollTask, Task, TipTask
from rcmqp.world.instrument import Instrument

JOINTS = (7, 10, 14, 20)
LEVELS = (2, 3, 4, 5, 6)
HARD_ROWS = (0, 10, 20, 40)
PERIOD = 5e-3
COLD = 50
"""Steps that are not counted; there must be more."""


def chain(joints: int) -> Arm:
    """An arm of so many joints, bent so that it is far from its singularities."""
    model, link = pin.Model(), pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.2 / joints]))
    parent = 0
    for k in range(joints):
        joint = pin.JointModelRY() if k % 2 else pin.JointModelRZ()
        parent = model.addJoint(parent, joint, link, f"joint_{k + 1}")
    model.addFrame(pin.Frame("flange", parent, 0, link, pin.FrameType.OP_FRAME))
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -2.8, 2.8
    model.velocityLimit[:] = 2.0
    home = np.where(np.arange(joints) % 2, 4.0 / joints, 0.3)
    return Arm(model, "flange", name=f"chain_{joints}", home=home)


def controller(insertion: Insertion, levels: int, rows: int) -> HierarchicalQP:
    """With so many levels, and so many spheres beside the way."""
    others: list[Task] = [RollTask(), DirectionTask(), DepthTask()]
    tasks: list[Task] = [RcmTask(period=PERIOD), TipTask()]
    if levels > 2:
        tasks += [*others[: levels - 3], PostureTask.made_for(insertion)]
    rng, tip = np.random.default_rng(3), insertion.tip(insertion.x_rcm)
    shaft = np.array(insertion.trocar.axis)
    spheres = []
    for _ in range(rows):
        way = rng.normal(size=3)
        way -= min(0.0, float(way @ shaft)) * shaft  # not back along the shaft
        centre = tip + rng.uniform(0.035, 0.06) * way / np.linalg.norm(way)
        spheres.append(KeepOut(centre=tuple(centre), radius=0.02, instrument=insertion.instrument))
    limits = [JointLimits(insertion.arm, PERIOD), *spheres]
    return HierarchicalQP(insertion, PERIOD, levels=tasks, limits=limits)


class Case:
    """A controller in a loop of its own.

    Attributes:
        steps: time of each step [us].
        met: whether a hard row was at its bound, for each step.
    """

    def __init__(self, insertion: Insertion, levels: int, rows: int) -> None:
        self._insertion, self._controller = insertion, controller(insertion, levels, rows)
        self._q = insertion.q_start
        self._v = self._a = np.zeros(insertion.arm.nv)
        self.steps, self.met = list[float](), list[bool]()

    def go_on(self, reference: Reference) -> None:
        """One cycle."""
        state = self._insertion.state(self._q, self._v, self._a)
        start = time.thread_time_ns()
        command = self._controller.step(state, reference)
        self.steps.append((time.thread_time_ns() - start) / 1e3)
        assert isinstance(command.account, HierarchySolution)
        self.met.append(bool(command.account.at_upper[self._v.size :].any()))
        self._a, self._v = (command.v - self._v) / PERIOD, command.v
        self._q = self._insertion.arm.integrate(self._q, command.v, PERIOD)


def main() -> None:
    """Print a table as Markdown: a line for joints and levels, a column for hard rows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cycles", type=int, default=600)
    parser.add_argument("--joints", type=int, nargs="+", default=JOINTS)
    asked = parser.parse_args()
    lasting, rows = PERIOD * asked.cycles, []
    path = ConicalHelix(turns=1.0, pitch=0.02, duration=lasting, ramp=lasting / 4.0)
    for joints in asked.joints:
        insertion = Insertion.on_shaft(chain(joints), Instrument())
        sizes = list(itertools.product(LEVELS, HARD_ROWS))
        cases = {size: Case(insertion, *size) for size in sizes}
        for k in range(asked.cycles):
            view = path.command(k * PERIOD, insertion.tip_depth)
            reference = view_pose(insertion.x_rcm, view)
            for case in cases.values():
                case.go_on(reference)
        for levels in LEVELS:
            cells = []
            for count in HARD_ROWS:
                case = cases[levels, count]
                median, late = np.percentile(case.steps[COLD:], [50.0, 99.0])
                met = f", {np.mean(case.met[COLD:]):.0%}" if count else ""
                cells.append(f"{median:.0f} ({late:.0f}{met})")
            rows.append([str(joints), str(levels), *cells])
    heads = ["joints", "levels", *(f"{count} hard rows" for count in HARD_ROWS)]
    print(Table(heads, rows).markdown(), end="")


if __name__ == "__main__":
    main()
