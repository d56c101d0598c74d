"""Four views that follow each other at once, reached along the paper's path planner."""

from __future__ import annotations

import math

from rcmqp import Scenario
from rcmqp.references.paths import ViewSteps


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """Views 8 degrees and up to 3 cm apart; the planner takes 1.5 s from one to the next."""
    turn = math.radians(8.0)
    path = ViewSteps(
        views=(
            (0.0, 0.0, 0.0, 0.0),
            (turn, turn, 0.0, 0.0),
            (-turn, turn, 0.0, 0.03),
            (0.0, 0.0, turn, 0.0),
        ),
        dwell=2.5,
    )
    return Scenario.on_shaft("view_steps", arm, path, flange=flange, planner_time=1.5)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
