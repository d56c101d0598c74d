"""The tool tip draws a circle while the patient breathes: the trocar rises and falls by 1 cm.

There are fifteen breaths a minute under a ventilator, with 1 cm from the end of expiration to that
of inspiration, along the normal of the abdominal wall; see Breathing for the source. The shaft
stands at 30 degrees to this normal, because the RCM does not notice a motion along the shaft. In
two breaths the tip draws a circle of 15 mm radius, which moves along with the trocar.
"""

from __future__ import annotations

import dataclasses
import math

from rcmqp import Scenario
from rcmqp.references.paths import Circle
from rcmqp.world.motions import Breathing

TILT = math.radians(30.0)
"""Between the shaft at the start and the normal of the abdominal wall."""


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """The circle from the arm's home, the tip 10 cm inside."""
    still = Scenario.on_shaft("breathing_trocar", arm, Circle(), flange=flange)
    outwards = still.insertion().from_start((math.sin(TILT), 0.0, -math.cos(TILT)))
    motion = Breathing(amplitude=0.01, rate=0.25, direction=outwards)
    return dataclasses.replace(still, motion=motion)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
