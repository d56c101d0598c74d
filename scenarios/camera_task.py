"""Experiment B of the paper: an operator finds four views with the camera, past an obstacle.

The operator is a model (rcmqp.references.operators); this is no human study. The paper gives the
spheres' square of 5 cm, the order of the views, the tolerance of 1 mm, the place of the obstacle,
and the mapping of the hand's translations to (t_z, alpha, beta). It leaves some things open: where
camera and spheres stand, the size of the spheres, the scale from hand to camera, the viscosity of
the device, the sampling period, the arm, and between which points the distance to the obstacle is
measured. The choices are in CameraTask, HandMapping and Omega7.

The tip starts 10 cm inside, where the helix of experiment A starts. From there all spheres and
most of the obstacle are in view. The objectives are 4 cm deeper, where the helix ends. With two
centimetres less, the LWA3 reaches the limit of its sixth joint in one trial of seven. References
that are far apart go through the paper's planner.
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
