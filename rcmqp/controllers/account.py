"""What became of a step, in a few lines that a person reads."""

from __future__ import annotations

import math

import numpy as np

from rcmqp.limits.joints import JointLimits, braking_speed
from rcmqp.qp import HierarchySolution, LevelResult
from rcmqp.tasks import TASKS
from rcmqp.world.arm import Arm, ArmState

MOST_NAMES = 3
"""Limits that a level's line names, the heaviest first."""

TOUCHING = 1e-9
"""How far a bound may be from the limit that it comes from, relative to it; and by how much a row
may be exceeded, in its unit."""

NOISE = 1e-9
"""Share of the heaviest multiplier below which another is rounding."""

_SHOWN = {"m": (1e3, "mm/s"), "rad": (1e3, "mrad/s")}


def explained(solution: HierarchySolution, arm: Arm, state: ArmState, period: float) -> str:
    """A line for each level and for each hard row that is exceeded.

        rcm: reached
        tip: 3.2 mm/s short, held back by panda_joint4 (upper speed limit)
        trocar cone: exceeded by 0.02 m/s or rad/s

    Args:
        solution: of a hierarchy whose unknowns are the arm's joints.
        arm: whose limits the joints are at.
        state: that the step was made for.
        period: [s].
    """
    lines = [_level(level, solution, arm, state, period) for level in solution.levels]
    for i, joint in enumerate(arm.joints):
        if solution.crossed[i]:
            lines.append(f"{joint}: its lower bound is above its upper one, held between them")
    rows = solution.names[len(solution.v) :]
    for name, excess in zip(rows, solution.violation, strict=True):
        if excess > TOUCHING:
            lines.append(f"{name}: exceeded by {_number(excess)} m/s or rad/s")
    return "\n".join(lines)


def _level(
    level: LevelResult, solution: HierarchySolution, arm: Arm, state: ArmState, period: float
) -> str:
    doubt = "" if level.route.exact else f" ({level.route.value}, KKT residual {level.kkt:.1g})"
    if level.reached:
        return f"{level.name}: reached{doubt}"
    factor, unit = _SHOWN.get(_unit(level.name), (1.0, "per second"))
    short = f"{_number(factor * float(np.linalg.norm(level.residual)))} {unit}"
    weights = solution.blocking(level)
    heaviest = max(map(abs, weights.values()), default=0.0)
    held = []
    for name, weight in weights.items():
        i = solution.names.index(name)
        touched = solution.at_upper[i] if weight > 0.0 else solution.at_lower[i : i + 1].any()
        if touched and abs(weight) > NOISE * heaviest:
            which = f" ({_which(solution, i, arm, state, period)})" if i < arm.nv else ""
            held.append(name + which)
    why = "the rest is taken by the levels above"
    if held:
        why = f"held back by {', '.join(held[:MOST_NAMES])}"
    return f"{level.name}: {short} short, {why}{doubt}"


def _number(x: float) -> str:
    return f"{x:.3g}" if x < 1e3 else f"{x:.0f}"


def _unit(name: str) -> str:
    """Unit of the error of a registered task; empty for others."""
    return TASKS[name].unit if name in TASKS else ""


def _which(solution: HierarchySolution, i: int, arm: Arm, state: ArmState, period: float) -> str:
    """Which of its limits joint i is at."""
    side = "upper" if solution.at_upper[i] else "lower"
    v, change = solution.v[i], (solution.v[i] - state.v[i]) / period
    towards = 1.0 if solution.at_upper[i] else -1.0
    room, easing = arm.velocity[i] - towards * state.v[i], JointLimits.easing * arm.jerk[i]
    kinds = {
        "speed": (abs(v), arm.velocity[i]),
        "acceleration": (abs(change), arm.acceleration[i]),
        "jerk": (abs(change - state.a[i]), period * arm.jerk[i]),
        "speed ": (towards * change, float(braking_speed(room, easing, period))),  # ahead of it
    }
    for kind, (given, allowed) in kinds.items():
        if math.isclose(given, allowed, rel_tol=TOUCHING):
            return f"{side} {kind.strip()} limit"
    return f"{side} position limit"
