"""Two controllers on one helix: the paper's law beside the RCM as a task.

The paper's law has no feed-forward, so the tip lags behind by speed over gain. ``hierarchical_qp``
knows the reference's velocity. Its RCM rows are of second order in the period, so its RCM error is
some hundred times smaller.
"""

from __future__ import annotations

import sys

import rcmqp
from rcmqp.show.plots import error_figure


def main(picture: str = "03_two_controllers.png", duration: float = 20.0) -> None:
    """Run both for ``duration`` [s] and draw their errors on logarithmic axes."""
    scenario = rcmqp.load_scenario("conical_helix", arm="lwa3", duration=duration)
    runs = []
    for name in ("dual_quaternion", "hierarchical_qp"):
        controller = rcmqp.make_controller(name, scenario.insertion(), scenario.period)
        runs.append(rcmqp.simulate(scenario, controller))
        found = rcmqp.compute_metrics(runs[-1])
        print(f"{name:16} tip {found.tip_rms_mm:.4f} mm rms, RCM {found.rcm_max_mm:.1e} mm max")

    error_figure(runs, logarithmic=True).savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
