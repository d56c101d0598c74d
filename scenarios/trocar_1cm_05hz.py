"""The first trocar motion of the paper's follow-up: 1 cm at 0.5 Hz; see moving_trocar."""

from __future__ import annotations

from rcmqp import Scenario
from rcmqp.runs.loading import scenario_module


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """One view, held from the arm's home, while the trocar moves and takes the view along."""
    moving: Scenario = scenario_module("moving_trocar").scenario(
        arm, flange=flange, amplitude=0.01, frequency=0.5, name="trocar_1cm_05hz"
    )
    return moving


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
