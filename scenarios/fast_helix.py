"""Experiment A's helix, faster than the joints allow.

The speed depends on the arm. The pseudoinverse first follows the helix slowly, and the joint
speeds are noted. Then the time is cut so that for three quarters of it some joint would have to be
faster than it can. A controller that keeps the limits on speed, or also those on acceleration,
falls behind and is at one of them most of the time. At the end, a quarter of the time of the helix
is left to catch up.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from rcmqp import Scenario, make_controller, simulate
from rcmqp.references.paths import ConicalHelix

SHARE = 0.75
"""Of the helix's time, what asks for more than a joint's speed limit."""


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """The helix from the arm's home, 10 to 14 cm inside."""
    usual = ConicalHelix()
    scale = shortening(arm, flange)
    path = dataclasses.replace(
        usual, duration=round(scale * usual.duration, 2), ramp=round(scale * usual.ramp, 3)
    )
    return Scenario.on_shaft(
        "fast_helix", arm, path, flange=flange, duration=round(1.25 * path.duration, 2)
    )


@functools.cache
def shortening(arm: str, flange: str | None) -> float:
    """How much of its time the helix may take for SHARE of it to be too fast."""
    slow = Scenario.on_shaft("slow_helix", arm, ConicalHelix(), flange=flange, period=0.1)
    controller = make_controller(
        "dual_quaternion", slow.insertion(), slow.period, gain=5.0, K_c=0.0, feed_forward=True
    )
    run = simulate(slow, controller)
    speed_ratio = np.abs(run.v / run.velocity_limit).max(axis=-1)
    return float(np.quantile(speed_ratio, 1.0 - SHARE))


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
