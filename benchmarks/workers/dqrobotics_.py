"""dqrobotics: the pseudoinverse controller on dual quaternions, the law of 2014 in C++."""

from __future__ import annotations

from typing import Any

import numpy as np
from dqrobotics import DQ
from dqrobotics.robot_control import (
    ControlObjective,
    DQ_ClassicQPController,
    DQ_PseudoinverseController,
)
from dqrobotics.robots import FrankaEmikaPandaRobot
from dqrobotics.solvers import DQ_QuadprogSolver
from loop import Array, Cycle, Work, serve


def _arm(work: Work) -> Any:
    """Dqrobotics' own Panda, its base where the URDF has it, its effector at our tip."""
    arm = FrankaEmikaPandaRobot.kinematics()
    for place in (arm.set_base_frame, arm.set_reference_frame, arm.set_effector):
        place(DQ([1.0]))
    arm.set_effector(arm.fkm(work.q_start).conj() * DQ(work.tips_dq[0]))
    return arm


def _pseudoinverse(work: Work) -> Cycle:
    """Without limits and posture, which it has not."""
    controller = DQ_PseudoinverseController(_arm(work))
    controller.set_control_objective(ControlObjective.Pose)
    controller.set_gain(1.0 / work.period)
    q, T, targets = work.q_start, work.period, list(work.tips_dq)

    def cycle(k: int) -> Array:
        nonlocal q
        q = q + T * np.asarray(controller.compute_setpoint_control_signal(q, targets[k + 1]))
        return q

    return cycle


def _quadratic(work: Work) -> Cycle:
    """With position and velocity limits as rows, the damping that keeps it regular."""
    solver = DQ_QuadprogSolver()
    controller = DQ_ClassicQPController(_arm(work), solver)
    controller.set_control_objective(ControlObjective.Pose)
    controller.set_gain(1.0 / work.period)
    controller.set_damping(1e-4)
    q, T, targets = work.q_start, work.period, list(work.tips_dq)
    rows = np.vstack([np.eye(len(q)), -np.eye(len(q))])

    def cycle(k: int, solver: object = solver) -> Array:  # or the solver would be freed
        nonlocal q
        most = np.minimum(work.velocity, (work.upper - q) / T)
        least = np.maximum(-work.velocity, (work.lower - q) / T)
        controller.set_inequality_constraint(rows, np.concatenate([most, -least]))
        q = q + T * np.asarray(controller.compute_setpoint_control_signal(q, targets[k + 1]))
        return q

    return cycle


CASES = {
    "pose/pseudoinverse, no limits": _pseudoinverse,
    "pose/ClassicQP, quadprog": _quadratic,
}

if __name__ == "__main__":
    serve(CASES, ["dqrobotics", "numpy", "quadprog"])
