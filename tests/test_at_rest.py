"""A view that is held still is held by joints that stand still."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rcmqp import load_scenario, simulate
from rcmqp.controllers import HierarchicalQP
from rcmqp.references.paths import ViewMoves
from rcmqp.tasks import ObjectiveTask, RcmTask, RollTask, TipTask

MOVE, HOLD = 4.0, 8.0
VIEWS = [
    ("lwa3", (-0.7, 0.5, 0.0, 0.1)),
    ("lwa3", (-0.58, 0.35, 0.15, -0.02)),
    ("ur5", (0.6, -0.71, -0.98, -0.05)),
    ("meka_a2", (0.0, 0.7, 0.0, 0.0)),
]
"""At or near singularities, or at joint limits."""

OUT_OF_REACH = (-0.1364, 0.7338, 1.3399, 0.0243)


def swing(arm: str, view: tuple[float, float, float, float], damping: float | None) -> float:
    """How far a joint's speed swings in the last second, as a share of its limit."""
    scenario = load_scenario(
        "view_steps",
        arm,
        path=ViewMoves(views=(view,), move=MOVE),
        duration=MOVE + HOLD,
        acceleration=None if arm == "lwa3" else math.inf,
        jerk=math.inf,
    )
    insertion, T = scenario.insertion(), scenario.period
    levels = [
        RcmTask(period=T),
        TipTask(damping=damping),
        RollTask(damping=damping),
        ObjectiveTask.made_for(insertion),
    ]
    run = simulate(scenario, HierarchicalQP(insertion, T, levels=levels))
    last = run.v[-round(1.0 / T) :] / insertion.arm.velocity
    assert run.rcm_error.max() < 1e-5
    return float(np.ptp(last, axis=0).max())


@pytest.mark.parametrize(("arm", "view"), VIEWS)
def test_a_held_view_comes_to_rest_where_strict_levels_swing_for_ever(
    arm: str, view: tuple[float, float, float, float]
) -> None:
    """Without assumed limits: below 1e-3 of the limit; strict levels 1.7 to 2.0, end to end."""
    assert swing(arm, view, None) < 1e-3
    assert swing(arm, view, 0.0) > 0.5


@pytest.mark.parametrize("period", [1e-3, 4e-3])
def test_roll_below_a_tip_out_of_reach_does_not_swing(period: float) -> None:
    """Joint 6 of the LWA3 is at its limit; the roll alone was asked to go on as it went."""
    path = ViewMoves(views=(OUT_OF_REACH,), move=MOVE)
    scenario = load_scenario("view_steps", "lwa3", path=path, duration=MOVE + HOLD, period=period)
    run = simulate(scenario, HierarchicalQP(scenario.insertion(), period, gain=130.0))
    last = run.v[-round(1.0 / period) :] / run.velocity_limit
    assert np.ptp(last, axis=0).max() < 1e-3
