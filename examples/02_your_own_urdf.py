"""Your own robot: any URDF of a fixed-base serial arm.

The file ``my_robot.urdf`` beside this script has six joints and no limits of acceleration or
jerk. The script gives the maker's limits by hand. Without them rcmqp assumes careful values, marks
them in every table, and does not drive a real arm with them. The trocar is put where the shaft is,
10 cm before the tip. Without a ``home``, rcmqp searches a starting pose away from limits and
singularities.
"""

from __future__ import annotations

import sys
from pathlib import Path

import rcmqp
from rcmqp.references.paths import ConicalHelix
from rcmqp.show.plots import trajectory_figure

URDF = Path(__file__).with_name("my_robot.urdf")


def main(picture: str = "02_your_own_urdf.png", duration: float = 20.0) -> None:
    """Draw the helix with the arm of the URDF, for ``duration`` [s]."""
    home = [0.0, -0.3, 1.9, 0.0, 1.5, 0.0]
    arm = rcmqp.load_arm(URDF, flange="tool0", home=home, acceleration=8.0, jerk=400.0)
    print(f"{arm.title}: {arm.nv} joints, reach {arm.reach:.2f} m, assumed: {set(arm.assumed)}")

    instrument = rcmqp.Instrument(length=0.30, radius=0.005)
    insertion = rcmqp.Insertion.on_shaft(arm, instrument, depth=0.10)
    scenario = rcmqp.Scenario.of("my_helix", insertion, ConicalHelix(), duration=duration)
    controller = rcmqp.make_controller("hierarchical_qp", insertion, scenario.period)
    run = rcmqp.simulate(scenario, controller)

    metrics = rcmqp.compute_metrics(run)
    print(f"RCM {metrics.rcm_max_mm:.1e} mm max, speed / limit {metrics.speed_ratio_max:.2f}")
    trajectory_figure([run]).savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
