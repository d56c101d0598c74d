"""Your own path: the view follows a rose with five petals.

A path is a frozen dataclass with a duration and a view command for every instant: left-right,
up-down and roll in radians, in-out in metres. With their rates, a controller can follow without
lag. A scenario can use a path that is in PATHS, and its runs can be recorded and shown.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

from rcmqp import Scenario, ViewCommand, compute_metrics, make_controller, simulate
from rcmqp.references.paths import PATHS
from rcmqp.show.plots import trajectory_figure


@dataclass(frozen=True)
class Rose:
    """Five petals of ``size`` [rad] in ``duration`` [s]; it starts and ends in the middle."""

    size: float = 0.15
    duration: float = 12.0

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view at ``t`` [s]; the turn starts and ends at rest."""
        share = min(max(t / self.duration, 0.0), 1.0)
        turn = math.pi * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        rate = math.pi * 30.0 * share**2 * (1.0 - share) ** 2 / self.duration
        r, r_turn = self.size * math.sin(5.0 * turn), 5.0 * self.size * math.cos(5.0 * turn)
        cos, sin = math.cos(turn), math.sin(turn)
        return ViewCommand(
            alpha=r * cos,
            beta=r * sin,
            alpha_dot=rate * (r_turn * cos - r * sin),
            beta_dot=rate * (r_turn * sin + r * cos),
        )


PATHS["rose"] = Rose


def main(picture: str = "07_your_own_path.png", duration: float = 12.0) -> None:
    """Follow the rose on a UR5 for ``duration`` [s]."""
    scenario = Scenario.on_shaft("rose", "ur5", Rose(), duration=duration)
    controller = make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    run = simulate(scenario, controller)
    print(f"tip error {compute_metrics(run).tip_rms_mm:.4f} mm rms")
    trajectory_figure([run]).savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
