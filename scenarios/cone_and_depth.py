"""Views beyond what the trocar allows: tilted out of its cone, and too far in and out.

The trocar allows a tilt of 15 degrees and depths of 8 to 12 cm. The path asks for 23 degrees at 14
cm, then for 23 degrees in another direction at 6 cm, then for the view of the start. A controller
that keeps the limits of the trocar stays at their edge. A controller without them goes beyond.
"""

from __future__ import annotations

import dataclasses
import math

from rcmqp import Scenario
from rcmqp.references.paths import ViewMoves


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """From the arm's home, the tip 10 cm inside, the cone about the shaft at the start."""
    views = ((0.4, 0.0, 0.0, 0.04), (0.0, -0.4, 0.0, -0.04), (0.0, 0.0, 0.0, 0.0))
    path = ViewMoves(views=views, move=3.0, dwell=0.3)
    wide = Scenario.on_shaft("cone_and_depth", arm, path, flange=flange)
    trocar = dataclasses.replace(
        wide.trocar, cone_half_angle=math.radians(15.0), depth_range=(0.08, 0.12)
    )
    return dataclasses.replace(wide, trocar=trocar)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
