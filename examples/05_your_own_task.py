"""Your own task: keep the image level.

A task is an error with its Jacobian and its drift. This one replaces the roll that the path asks
for: the camera turns about the shaft until the image's x axis lies in the horizontal plane. It is
the third level, so neither the trocar nor the tip notices.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

import rcmqp
from rcmqp.controllers import HierarchicalQP
from rcmqp.tasks import RcmTask, Residual, RollTask, Task, TipTask


@dataclass(frozen=True, eq=False)
class LevelCamera(Task):
    """Turn about the shaft until the image's x axis is level."""

    def evaluate(self, state, reference):
        """Height of the image's x axis (1,), zero where it is level."""
        up = state.oMe.rotation[2]  # the world's z in the effector's axes: up' = up x omega
        by_omega = np.array([[0.0, -up[2], up[1]]])
        return Residual(up[:1], by_omega @ state.J_local[3:], np.zeros(1))


def main(picture: str = "05_your_own_task.png", duration: float = 8.0) -> None:
    """Draw the image's roll over ``duration`` [s], with the usual third level and with this."""
    scenario = rcmqp.load_scenario("conical_helix", "meka_a2", duration=duration)
    insertion = scenario.insertion()
    figure = Figure(figsize=(7.0, 3.5), layout="constrained")
    axes = figure.subplots()
    for name, third in {"RollTask": RollTask(), "LevelCamera": LevelCamera(gain=3.0)}.items():
        levels = [RcmTask(period=scenario.period), TipTask(), third]
        run = rcmqp.simulate(scenario, HierarchicalQP(insertion, scenario.period, levels=levels))
        height = [insertion.state(q).oMe.rotation[2, 0] for q in run.q]
        axes.plot(run.time, np.degrees(np.arcsin(height)), label=name)
        print(f"{name}: RCM error {1e3 * run.rcm_error.max():.1e} mm at most")
    axes.set(xlabel="time [s]", ylabel="image off level [deg]")
    axes.legend()
    figure.savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
