"""An obstacle and the trocar's cone: what the instrument must avoid, and where it must stay.

The way to the view leads through a ball of 1 cm. The trocar allows a tilt of 12 degrees, which is
less than the view asks for. The paper's law knows neither. ``hierarchical_qp`` stops at the first
of the two.
"""

from __future__ import annotations

import dataclasses
import math
import sys

import numpy as np
from matplotlib.figure import Figure

import rcmqp
from rcmqp.runs.metrics import obstacle_distance

CONE = math.radians(12.0)


def main(picture: str = "09_obstacle_and_cone.png", duration: float = 5.0) -> None:
    """Draw the distance to the ball and the tilt of the shaft over ``duration`` [s]."""
    scenario = rcmqp.load_scenario("obstacle", arm="panda", duration=duration)
    narrow = dataclasses.replace(scenario.trocar, cone_half_angle=CONE)
    scenario = dataclasses.replace(scenario, trocar=narrow)
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    distance, tilt = figure.subplots(2, 1, sharex=True)
    for name in ("dual_quaternion", "hierarchical_qp"):
        law = rcmqp.make_controller(name, scenario.insertion(), scenario.period)
        run = rcmqp.simulate(scenario, law)
        distance.plot(run.time, 1e3 * obstacle_distance(run), label=name)
        tilt.plot(run.time, np.degrees(run.tilt))
        least = 1e3 * obstacle_distance(run).min()
        print(f"{name}: {least:.1f} mm from the ball, {math.degrees(run.tilt.max()):.1f} deg")
    distance.axhline(0.0, color="black", linewidth=0.8)
    tilt.axhline(math.degrees(CONE), color="black", linewidth=0.8)
    distance.set(ylabel="distance to the ball [mm]")
    tilt.set(ylabel="tilt of the shaft [deg]", xlabel="time [s]")
    distance.legend()
    figure.savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
