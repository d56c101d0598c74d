"""mink: pink's tasks on MuJoCo, which reads the arm's URDF."""

from __future__ import annotations

from functools import partial

import mink
import mujoco
import numpy as np
from loop import Array, Cycle, Work, serve


def _pose(work: Work, solver: str) -> Cycle:
    model = mujoco.MjModel.from_xml_path(work.urdf)
    configuration = mink.Configuration(model, work.q_start)
    tip = mink.FrameTask("tip", "body", position_cost=1.0, orientation_cost=1.0)
    posture = mink.PostureTask(model, cost=1e-3)
    posture.set_target(work.q_start)
    names = [f"panda_joint{i + 1}" for i in range(7)]
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, dict(zip(names, work.velocity, strict=True))),
    ]
    T, targets = work.period, [mink.SE3.from_matrix(pose) for pose in work.tips]

    def cycle(k: int) -> Array:
        tip.set_target(targets[k + 1])
        v = mink.solve_ik(configuration, [tip, posture], T, solver, limits=limits)
        configuration.integrate_inplace(v, T)
        return np.asarray(configuration.q)

    return cycle


CASES = {
    f"pose/pose, {solver}": partial(_pose, solver=solver)
    for solver in ("daqp", "quadprog", "proxqp")
}

if __name__ == "__main__":
    serve(CASES, ["mink", "mujoco", "numpy", "qpsolvers", "daqp", "quadprog", "proxsuite"])
