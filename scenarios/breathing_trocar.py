"""The tool tip draws a circle while the patient breathes: the trocar rises and falls by 1 cm.

Fifteen breaths a minute under a ventilator, 1 cm from the end of expiration to that of
inspiration, along the normal of the abdominal wall; see Breathing for where that comes from.
The shaft stands in the wall at 30 degrees from its normal, for along the shaft the motion of a
trocar does not matter to the RCM. Two breaths, with a circle of 15 mm radius meanwhile, which
goes along with the trocar.
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
