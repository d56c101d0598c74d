"""Limits in the way: a helix that is faster than the joints allow.

The paper's law may scale its joint velocity to the speed limits; acceleration and jerk then jump
to values that no robot accepts. ``hierarchical_qp`` keeps position, speed, acceleration and jerk:
the tip lags, the shaft stays on the trocar.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.figure import Figure

import rcmqp

LAWS = {"dual_quaternion": {"velocity_limit": "scale"}, "hierarchical_qp": {}}


def main(picture: str = "08_limits_in_the_way.png", duration: float = 7.3) -> None:
    """Draw the largest joint speed and jerk over their limits, and the RCM error."""
    scenario = rcmqp.load_scenario("fast_helix", arm="lwa3", duration=duration)
    figure = Figure(figsize=(7.0, 6.5), layout="constrained")
    speed, jerk, rcm = figure.subplots(3, 1, sharex=True)
    for name, options in LAWS.items():
        law = rcmqp.make_controller(name, scenario.insertion(), scenario.period, **options)
        run = rcmqp.simulate(scenario, law)
        jerks = np.diff(run.v, n=2, axis=0) / run.period**2
        speed.plot(run.time, np.abs(run.v / run.velocity_limit).max(axis=1), label=name)
        jerk.plot(run.time[2:], np.abs(jerks / run.jerk_limit).max(axis=1))
        rcm.plot(run.time, np.maximum(1e3 * run.rcm_error, 1e-9))
        found = rcmqp.compute_metrics(run)
        print(f"{name}: jerk / limit {found.jerk_ratio_max:.0f}, RCM {found.rcm_max_mm:.1e} mm")
    speed.set(ylabel="speed / limit")
    jerk.set(ylabel="jerk / limit", yscale="log", ylim=(1e-3, 1e3))
    rcm.set(ylabel="RCM error [mm]", yscale="log", xlabel="time [s]")
    speed.legend(loc="lower center")
    figure.savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
