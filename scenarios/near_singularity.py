"""A tilt that almost stretches the arm, and back: through the neighbourhood of a singularity.

The place depends on the arm. From its home the arm first moves across the shaft and downwards,
with the direction of the shaft kept, in the direction in which its least singular value falls
fastest. Where that value is 0.08, the trocar is put. The view then tilts in the direction in which
it falls further, down to 0.02, or as far as the joint limits allow. Homes have 0.13 to 0.32. Here,
in one direction, the pseudoinverse needs about ten times the joint speed that it needs at home.
The singularity is the straight elbow, which a redundant joint cannot avoid. A view a little
further on is out of reach.
"""

from __future__ import annotations

import functools

import numpy as np

from rcmqp import Arm, Insertion, Instrument, Scenario, load_arm, make_controller, simulate
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths import ViewMoves
from rcmqp.tasks.objectives import LeastSingularValue

AT_START = 0.08
NEAREST = 0.02
"""Least singular value of the effector's Jacobian at the start and in the middle [m, rad]."""

MARGIN = 0.1
"""From joint limits, at the start [rad]."""

STEP = 2e-3
"""Of the way to the start [m]."""

LARGEST = 0.6
"""Tilt within which NEAREST is looked for [rad]."""


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """There and back, in 3 s each, with half a second at the far end."""
    angles, tilt = outstretched(arm, flange)
    there = (tilt[0], tilt[1], 0.0, 0.0)
    path = ViewMoves(views=(there, (0.0, 0.0, 0.0, 0.0)), move=3.0, dwell=0.5)
    return Scenario.on_shaft("near_singularity", arm, path, flange=flange, angles_start=angles)


@functools.cache
def outstretched(arm: str, flange: str | None) -> tuple[tuple[float, ...], tuple[float, float]]:
    """Joint angles [rad] to start from, and the tilt (alpha, beta) [rad] to be asked for."""
    loaded = load_arm(arm, flange)
    insertion = Insertion.on_shaft(loaded, Instrument())
    angles, slope = _stretch(insertion.arm, loaded.home)
    tilt = -LARGEST * slope[[1, 0]] / np.linalg.norm(slope)  # alpha turns about y, beta about x
    path = ViewMoves(views=((float(tilt[0]), float(tilt[1]), 0.0, 0.0),), move=5.0, dwell=0.0)
    trial = Scenario.on_shaft("trial", arm, path, flange=flange, angles_start=angles, period=0.02)
    controller = make_controller(
        "dual_quaternion", trial.insertion(), trial.period, gain=20.0, K_c=0.0, feed_forward=True
    )
    run = simulate(trial, controller)
    least, margin = run.singular_value, np.minimum(run.angles - run.lower, run.upper - run.angles)
    near = (least <= NEAREST) | (margin.min(axis=-1) < MARGIN / 2.0)
    k = int(np.argmax(near)) if near.any() else int(np.argmin(least))
    view = path.command(k * trial.period, 0.0)
    return tuple(map(float, angles)), (round(view.alpha, 4), round(view.beta, 4))


def _stretch(arm: Arm, angles: Array) -> tuple[Array, Array]:
    """Joint angles (nv,) at AT_START, and d sigma / d omega_x, omega_y (2,) there."""
    measure, q = LeastSingularValue(), arm.configuration(angles)
    for _ in range(500):
        state = arm.state(q)
        least, gradient = measure.evaluate(state)
        by_twist = gradient @ np.linalg.pinv(state.J_local)
        way = -by_twist[:3] * [1.0, 1.0, -np.sign(by_twist[2])]  # z is into the patient
        step = STEP * way / np.linalg.norm(way)
        further = arm.integrate(q, np.linalg.pinv(state.J_local)[:, :3] @ step, 1.0)
        if least <= AT_START or arm.limit_margin(arm.angles(further)).min() < MARGIN:
            break
        q = further
    return arm.angles(q), by_twist[3:5]


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
