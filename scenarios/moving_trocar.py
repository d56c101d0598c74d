"""A trocar that swings across the shaft, 1 cm at 0.5 Hz or as asked for, under a still view.

The follow-up of the paper (Marinho, Bernardes and Bo, Journal of Medical Robotics Research 2016)
moves the trocar by 1 cm at 0.5 Hz, 2 cm at 0.5 Hz and 1 cm at 1 Hz. These are parameters of
scenario(), and also scenarios of their own: trocar_1cm_05hz, trocar_2cm_05hz, trocar_1cm_1hz. The
direction is our choice: across the shaft, to the right in the image. There all of the motion is
RCM error for a controller that does not follow. Peak speeds are 31 mm/s and twice 63 mm/s. The
amplitude grows for 2 s, then 6 s of the full motion follow.
"""

from __future__ import annotations

import dataclasses

from rcmqp import Scenario
from rcmqp.references.paths import ViewSteps
from rcmqp.world.motions import Sinusoid


def scenario(
    arm: str = "lwa3",
    *,
    flange: str | None = None,
    amplitude: float = 0.01,
    frequency: float = 0.5,
    name: str = "moving_trocar",
) -> Scenario:
    """One view, held from the arm's home, while the trocar moves and takes the view along."""
    path = ViewSteps(views=((0.0, 0.0, 0.0, 0.0),), dwell=8.0)
    still = Scenario.on_shaft(name, arm, path, flange=flange)
    across = still.insertion().from_start((1.0, 0.0, 0.0))
    motion = Sinusoid(amplitude=amplitude, frequency=frequency, direction=across, ramp=2.0)
    return dataclasses.replace(still, motion=motion)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
