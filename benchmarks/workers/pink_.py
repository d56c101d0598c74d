"""pink, with an RCM task as a user has to write it: derived from pink's own Task."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pink
import pinocchio as pin
from loop import Array, Cycle, Work, serve
from pink.tasks import FrameTask, PostureTask, Task


class RcmTask(Task):  # type: ignore[misc]  # pink has no types here
    """The trocar, seen from the tip, on the shaft: x = y = 0."""

    def __init__(self, pivot: Array, cost: float) -> None:
        super().__init__(cost=cost, gain=1.0)
        self.pivot = pivot

    def __repr__(self) -> str:
        return f"RcmTask({self.pivot}, cost={self.cost})"

    def compute_error(self, configuration: Any) -> Array:
        """Where the trocar is (2,) [m], in the tip's axes."""
        tip = configuration.get_transform_frame_to_world("tip")
        return np.asarray(tip.actInv(self.pivot)[:2])

    def compute_jacobian(self, configuration: Any) -> Array:
        """Of the error: (2, nv)."""
        tip = configuration.get_transform_frame_to_world("tip")
        J = configuration.get_frame_jacobian("tip")
        return np.asarray((pin.skew(tip.actInv(self.pivot)) @ J[3:] - J[:3])[:2])


def _start(work: Work) -> tuple[pink.Configuration, PostureTask]:
    model = pin.buildModelFromUrdf(work.urdf)
    configuration = pink.Configuration(model, model.createData(), work.q_start)
    posture = PostureTask(cost=1e-3)
    posture.set_target(work.q_start)
    return configuration, posture


def _rcm(work: Work, solver: str, hard: bool) -> Cycle:
    configuration, posture = _start(work)
    tip = FrameTask("tip", position_cost=1.0, orientation_cost=0.0)
    rcm = RcmTask(work.pivot, cost=100.0)
    soft = [tip, posture] if hard else [rcm, tip, posture]
    constraints = [rcm] if hard else None
    T, targets = work.period, [pin.SE3(pose) for pose in work.tips]

    def cycle(k: int) -> Array:
        tip.set_target(targets[k + 1])
        v = pink.solve_ik(configuration, soft, T, solver, constraints=constraints)
        configuration.integrate_inplace(v, T)
        return np.asarray(configuration.q)

    return cycle


def _pose(work: Work, solver: str) -> Cycle:
    configuration, posture = _start(work)
    tip = FrameTask("tip", position_cost=1.0, orientation_cost=1.0)
    T, targets = work.period, [pin.SE3(pose) for pose in work.tips]

    def cycle(k: int) -> Array:
        tip.set_target(targets[k + 1])
        v = pink.solve_ik(configuration, [tip, posture], T, solver)
        configuration.integrate_inplace(v, T)
        return np.asarray(configuration.q)

    return cycle


CASES = {
    **{
        f"rcm/RCM {'hard' if hard else 'soft'}, {solver}": partial(_rcm, solver=solver, hard=hard)
        for hard in (True, False)
        for solver in ("daqp", "quadprog")
    },
    **{
        f"pose/pose, {solver}": partial(_pose, solver=solver)
        for solver in ("daqp", "quadprog", "proxqp")
    },
}

if __name__ == "__main__":
    serve(CASES, ["pin-pink", "pin", "numpy", "qpsolvers", "daqp", "quadprog", "proxsuite"])
