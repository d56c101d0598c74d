"""A ball stands in the way of the tip: views that lead through it, and on to the other side.

The ball has a radius of 10 mm. Its centre is 110 mm deep, 20 mm to the right of the shaft at the
start. The view goes to the right at that depth, through the ball, and comes back. A controller
that knows obstacles stops before it and keeps the RCM. A controller that does not goes through.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from rcmqp import Scenario
from rcmqp.references.paths import ViewMoves
from rcmqp.world.instrument import vector3
from rcmqp.world.obstacles import Sphere

CENTRE = (0.02, 0.0, 0.11)
"""Of the ball, seen from the trocar in the axes of the shaft at the start [m]."""


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """From the arm's home, the tip 10 cm inside."""
    path = ViewMoves(views=((0.36, 0.0, 0.0, 0.02), (0.0, 0.0, 0.0, 0.0)), move=2.0, dwell=0.5)
    free = Scenario.on_shaft("obstacle", arm, path, flange=flange)
    centre = np.array(free.trocar.pivot) + free.insertion().from_start(CENTRE)
    return dataclasses.replace(free, obstacles=(Sphere(vector3("centre", centre), 0.01),))


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
