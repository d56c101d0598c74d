"""Experiment B of the paper: an operator finds four views with the camera, past an obstacle.

The operator is a model (rcmqp.references.operators): no human study. The paper gives the spheres'
square of 5 cm, the order of the views, the tolerance of 1 mm, the obstacle's place and that the
hand's translations become (t_z, alpha, beta). It leaves open, and CameraTask, HandMapping and
Omega7 say what is taken: where camera and spheres stand, the size of the spheres, the scale from
hand to camera, the device's viscosity, the sampling period, which arm, and from where to where the
distance to the obstacle is measured.

The tip starts 10 cm inside, where the helix of experiment A does, and from where all spheres and
the greater part of the obstacle are in view; the objectives are 4 cm deeper, where it ends. Two
centimetres less, and the LWA3 comes to the limit of its sixth joint in one trial of seven.
References that are far apart go through the paper's planner.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rcmqp import Instrument, Scenario, load_arm
from rcmqp.references.operators import CameraTrial
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import vector3
from rcmqp.world.obstacles import Sphere

DEPTH = 0.10
"""How far the tip is inside at the start [m]."""

START = {"lwa3": (0.0, 0.5, 0.0, 1.3, 0.0, 1.34, math.pi / 2.0)}
"""Joint angles of arms that the task would take from their home to a limit or stretch [rad]."""

PLANNER_TIME = 0.2
"""How long the planner takes to a far reference [s]: about an operator's reaction."""


def scenario(
    arm: str = "lwa3", *, flange: str | None = None, trial: CameraTrial | None = None
) -> Scenario:
    """The task from the arm's home, or START; ``trial`` says who does what."""
    trial = trial or CameraTrial()
    loaded = load_arm(arm, flange)
    insertion = Insertion.on_shaft(loaded, Instrument(), START.get(loaded.name), depth=DEPTH)
    obstacle = trial.task.obstacle
    pivot = insertion.trocar.pivot
    centre = np.array(pivot) + insertion.from_start(obstacle.centre)
    chosen = Scenario.of("camera_task", insertion, trial, planner_time=PLANNER_TIME)
    return dataclasses.replace(
        chosen, obstacles=(Sphere(vector3("centre", centre), obstacle.radius),)
    )


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
