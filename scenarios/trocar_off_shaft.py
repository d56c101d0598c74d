"""The trocar is 5 mm off the shaft: the arm first brings the shaft back, then shows a view.

The distance is five to ten times the play of an instrument in its cannula. It is across the shaft,
3 mm to the left and 4 mm down in the image. For 3 s the view is that of the start, so that the arm
only has to come back. Then the tip goes sideways and in.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from rcmqp import Scenario
from rcmqp.references.paths import ViewMoves
from rcmqp.world.instrument import vector3

OFFSET = (-0.003, 0.004, 0.0)
"""Where the trocar is, seen from the point of the shaft where it should be [m]."""


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """From the arm's home, the tip 10 cm beyond the trocar."""
    path = ViewMoves(views=((0.0, 0.0, 0.0, 0.0), (0.1, 0.1, 0.0, 0.02)), move=2.0, dwell=1.0)
    on = Scenario.on_shaft("trocar_off_shaft", arm, path, flange=flange)
    pivot = np.array(on.trocar.pivot) + on.insertion().from_start(OFFSET)
    trocar = dataclasses.replace(on.trocar, pivot=vector3("pivot", pivot))
    return dataclasses.replace(on, trocar=trocar, shaft_tolerance=6e-3)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
