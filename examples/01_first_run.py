"""A first run: the tip of an endoscope draws a helix through a trocar.

A scenario says which arm, which trocar and which path. A controller turns the path into joint
velocities. A run keeps everything that happened, and the metrics sum it up.
"""

from __future__ import annotations

import sys

import rcmqp
from rcmqp.show.plots import trajectory_figure


def main(picture: str = "01_first_run.png", duration: float = 20.0) -> None:
    """Simulate the helix for ``duration`` [s] and draw the arm and the tip's path."""
    scenario = rcmqp.load_scenario("conical_helix", arm="lwa3", duration=duration)
    controller = rcmqp.make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    run = rcmqp.simulate(scenario, controller)

    metrics = rcmqp.compute_metrics(run)
    print(f"tip error {metrics.tip_rms_mm:.1e} mm rms, RCM error {metrics.rcm_max_mm:.1e} mm max")

    trajectory_figure([run]).savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
