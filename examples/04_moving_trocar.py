"""A trocar that moves: feed-forward decides.

The trocar swings by 1 cm at 0.5 Hz. A law that only knows the position of the trocar lags behind
and presses on the incision. A law that also knows its velocity keeps up.
"""

from __future__ import annotations

import sys

import rcmqp
from rcmqp.show.plots import error_figure


def main(picture: str = "04_moving_trocar.png", duration: float = 8.0) -> None:
    """Run the paper's law without and with feed-forward for ``duration`` [s]."""
    scenario = rcmqp.load_scenario("moving_trocar", arm="panda", duration=duration)
    runs = []
    for feed_forward in (False, True):
        controller = rcmqp.make_controller(
            "dual_quaternion", scenario.insertion(), scenario.period, feed_forward=feed_forward
        )
        runs.append(rcmqp.simulate(scenario, controller))
        error = rcmqp.compute_metrics(runs[-1]).rcm_max_mm
        print(f"feed-forward {'on' if feed_forward else 'off':3}  RCM error {error:.4f} mm max")

    labels = ["without feed-forward", "with feed-forward"]
    error_figure(runs, logarithmic=True, labels=labels).savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
