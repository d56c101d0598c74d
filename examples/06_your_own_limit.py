"""Your own limit: go into the patient no faster than 2 cm/s.

A limit gives rows C v <= d on the joint velocities. Limits are hard and come before every task:
the tip is late, the shaft stays on the trocar. The controller's report says which limit holds
which level back.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

import rcmqp
from rcmqp.controllers import HierarchicalQP, default_limits
from rcmqp.limits import Constraint, Limit
from rcmqp.references.paths import ViewMoves


@dataclass(frozen=True, eq=False)
class GentleInsertion(Limit):
    """Go into the patient no faster than ``speed`` [m/s]."""

    speed: float

    def evaluate(self, state, reference):
        """One row: the shaft's velocity along itself."""
        return Constraint.rows(state.J_local[2:3], [self.speed], ["insertion speed"])


def main(picture: str = "06_your_own_limit.png", duration: float = 3.0) -> None:
    """Ask for 4 cm in one second, with and without the limit, and draw the speed."""
    path = ViewMoves(views=((0.0, 0.0, 0.0, 0.04),), move=1.0)
    scenario = rcmqp.load_scenario("view_steps", "panda", path=path, duration=duration)
    insertion, T = scenario.insertion(), scenario.period
    usual = default_limits(insertion, T)
    figure = Figure(figsize=(7.0, 3.5), layout="constrained")
    axes = figure.subplots()
    for name, limits in {"free": usual, "gentle": [*usual, GentleInsertion(speed=0.02)]}.items():
        run = rcmqp.simulate(scenario, HierarchicalQP(insertion, T, limits=limits))
        speed = 1e3 * np.diff(run.depth) / T
        axes.plot(run.time[1:], speed, label=name)
        print(f"{name:6} {speed.max():.1f} mm/s, RCM error {1e3 * run.rcm_error.max():.1e} mm")
    axes.set(xlabel="time [s]", ylabel="insertion speed [mm/s]")
    axes.legend()
    figure.savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
