"""Finding a starting configuration: the shaft through a wished trocar, at ease."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from rcmqp.errors import NoStartFound
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm
from rcmqp.world.instrument import Instrument, Trocar

STEP = 0.3
"""Longest step of the search [rad]."""

CONVERGED = 1e-12
"""Where the search stops: residual [m, rad]."""


def find_start(
    arm: Arm,
    instrument: Instrument,
    trocar: Trocar,
    *,
    depth: float = 0.1,
    margin: float = 0.1,
    singular_value: float = 0.02,
    attempts: int = 60,
    seed: int = 0,
) -> Array:
    """Joint angles (nv,) [rad] that put the shaft through the trocar, along its axis.

    Inverse kinematics by damped least squares on five rows, the pivot's position and the
    direction of the axis, so that the roll about the shaft is free; from the arm's home and
    from random configurations. Of all solutions the one with the largest product of least
    singular value and margin to the joint limits is taken.

    Args:
        arm: its flange carries the instrument.
        instrument: the endoscope.
        trocar: wished pivot and axis.
        depth: how far the tip is to be beyond the pivot [m].
        margin: least distance of every joint from its limits [rad].
        singular_value: least singular value of the effector's Jacobian [m, rad].
        attempts: how many random configurations to search from.
        seed: of those.

    Raises:
        NoStartFound: there is none; the message says what the nearest one lacks.
    """
    effector = arm.with_effector(pin.SE3(np.eye(3), np.array([0.0, 0.0, instrument.tip - depth])))
    rng = np.random.default_rng(seed)
    lower, upper = arm.lower + margin, arm.upper - margin
    best, best_score, nearest = None, 0.0, (math.inf, math.inf)
    for angles in [arm.home, *(arm.random_angles(rng) for _ in range(attempts))]:
        angles, gap = _solve(effector, trocar, np.clip(angles, lower, upper), lower, upper)
        nearest = min(nearest, gap)
        if max(gap) > 1e-9:
            continue
        J = effector.state(arm.configuration(angles)).J_local
        least = float(np.linalg.svd(J, compute_uv=False)[-1])
        score = least * min(float(arm.limit_margin(angles).min()), math.pi / 4)
        if least >= singular_value and score > best_score:
            best, best_score = angles, score
    if best is None:
        raise NoStartFound(_reason(arm, trocar, nearest, margin, singular_value))
    return best


def _solve(
    arm: Arm, trocar: Trocar, angles: Array, lower: Array, upper: Array
) -> tuple[Array, tuple[float, float]]:
    """Angles (nv,) reached from ``angles``, and what is left: distance [m] and angle [rad]."""
    pivot, axis = np.array(trocar.pivot), np.array(trocar.axis)
    gap = (math.inf, math.inf)
    for _ in range(100):
        state = arm.state(arm.configuration(angles))
        R = state.oMe.rotation
        seen = R.T @ axis
        across = math.hypot(seen[0], seen[1])
        tilt = math.atan2(across, seen[2])
        ratio = tilt / across if across > 0.0 else 1.0
        offset = R.T @ (pivot - state.oMe.translation)
        error = np.array([*offset, -seen[1] * ratio, seen[0] * ratio])
        gap = float(np.linalg.norm(offset)), tilt
        if max(gap) < CONVERGED:
            break
        J = state.J_local[:5]
        damping = 1e-3 * float(error @ error) + 1e-12
        step = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(5), error)
        step *= min(1.0, STEP / max(float(np.abs(step).max()), 1e-300))
        angles = np.clip(angles + step, lower, upper)
    return angles, gap


def _reason(
    arm: Arm, trocar: Trocar, nearest: tuple[float, float], margin: float, singular_value: float
) -> str:
    where = f"trocar at {trocar.pivot} m, axis {trocar.axis}"
    if max(nearest) > 1e-9:
        return (
            f"{arm.name} cannot put the shaft through the {where}: the nearest it comes is "
            f"{1e3 * nearest[0]:.1f} mm and {math.degrees(nearest[1]):.1f} deg off, with joints "
            f"{margin} rad inside their limits (its flange reaches {arm.reach:.2f} m); move the "
            "trocar or the arm's base, or turn the axis"
        )
    return (
        f"{arm.name} reaches the {where} only near a singularity: every solution's least singular "
        f"value is below {singular_value}; move the trocar or lower singular_value"
    )
