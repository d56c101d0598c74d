"""roboplan: OInK, weighted or prioritised tasks on ProxQP in C++."""

from __future__ import annotations

from functools import partial

import numpy as np
from loop import Array, Cycle, Work, serve
from roboplan.core import CartesianConfiguration, Scene, loadUrdfSceneDescription
from roboplan.optimal_ik import (
    ConfigurationTask,
    ConfigurationTaskOptions,
    FrameTask,
    FrameTaskOptions,
    Oink,
    PositionLimit,
    VelocityLimit,
)


def _pose(work: Work, priority: int, weight: float) -> Cycle:
    scene = Scene("panda", loadUrdfSceneDescription(work.urdf))
    oink = Oink(scene)
    start = CartesianConfiguration()
    start.base_frame, start.tip_frame, start.tform = "panda_link0", "tip", work.tips[0]
    tip = FrameTask(oink, scene, start, FrameTaskOptions())
    n = oink.num_variables
    options = ConfigurationTaskOptions(priority=priority)
    posture = ConfigurationTask(oink, work.q_start, np.full(n, weight), options)
    tasks = [tip, posture]
    limits = [PositionLimit(oink), VelocityLimit(oink, work.period, work.velocity)]
    q, step = work.q_start.copy(), np.zeros(n)

    def cycle(k: int) -> Array:
        nonlocal q
        tip.setTargetFrameTransform(work.tips[k + 1])
        oink.solveIk(q, tasks, limits, step)
        q = np.asarray(scene.integrate(q, step))
        return q

    return cycle


CASES = {
    "pose/pose and posture by weight": partial(_pose, priority=1, weight=1e-6),
    "pose/pose > posture": partial(_pose, priority=2, weight=1.0),
}

if __name__ == "__main__":
    serve(CASES, ["roboplan", "numpy"])
