"""PlaCo: tasks in C++; an RCM is a RelativePositionTask of tip and trocar masked to x and y."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import placo
from loop import Array, Cycle, Work, serve


def _solver(work: Work) -> tuple[Any, Any]:
    """A robot at the start, and a solver that brings it near its posture inside the limits."""
    robot = placo.RobotWrapper(work.urdf, placo.Flags.ignore_collisions)
    for i, angle in enumerate(work.q_start):
        robot.set_joint(f"panda_joint{i + 1}", angle)
    robot.update_kinematics()
    solver = placo.KinematicsSolver(robot)
    solver.mask_fbase(True)
    solver.dt = work.period
    solver.enable_joint_limits(True)
    solver.enable_velocity_limits(True)
    posture = solver.add_joints_task()
    posture.set_joints({f"panda_joint{i + 1}": angle for i, angle in enumerate(work.q_start)})
    posture.configure("posture", "soft", 1e-7)
    return robot, solver


def _rcm(work: Work, priority: str) -> Cycle:
    robot, solver = _solver(work)
    rcm = solver.add_relative_position_task("tip", "trocar", np.zeros(3))
    rcm.mask.set_axises("xy", "local")
    rcm.configure("rcm", priority, 1e4)
    tip = solver.add_position_task("tip", work.tips[0, :3, 3])
    tip.configure("tip", "soft", 1.0)
    targets = work.tips[:, :3, 3].copy()

    def cycle(k: int) -> Array:
        tip.target_world = targets[k + 1]
        solver.solve(True)
        robot.update_kinematics()
        return np.array(robot.state.q[7:])

    return cycle


def _pose(work: Work, priority: str) -> Cycle:
    robot, solver = _solver(work)
    tip = solver.add_frame_task("tip", work.tips[0])
    tip.configure("tip", priority, 1.0, 1.0)

    def cycle(k: int) -> Array:
        tip.T_world_frame = work.tips[k + 1]
        solver.solve(True)
        robot.update_kinematics()
        return np.array(robot.state.q[7:])

    return cycle


CASES = {
    "rcm/RCM hard, tip soft": partial(_rcm, priority="hard"),
    "rcm/RCM soft, tip soft": partial(_rcm, priority="soft"),
    "pose/pose hard": partial(_pose, priority="hard"),
    "pose/pose soft": partial(_pose, priority="soft"),
}

if __name__ == "__main__":
    serve(CASES, ["placo", "pin", "numpy"])
