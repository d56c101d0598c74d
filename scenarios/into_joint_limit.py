"""A view that takes a joint beyond its position limit, and back.

The joint depends on the arm. The arm starts from its home, with one joint moved to 0.1 rad from
one of its limits. Joint and limit are those against which a tilt, a roll and a dive together can
press hardest, while the shaft stays within 50 degrees of its direction at home and the arm away
from singularities. If the arm went the shortest way, the view would take that joint 0.2 rad beyond
the limit. The view asks for at most 0.35 rad to the side and up, 0.5 rad of roll and 5 cm of
depth. An arm with a redundant joint may find another way.
"""

from __future__ import annotations

import math

import numpy as np

from rcmqp import Insertion, Instrument, Scenario, load_arm
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths import ViewMoves

MARGIN = 0.1
"""Of the joint from its limit, at the start [rad]."""

BEYOND = 0.2
"""How far beyond the limit the view asks the joint to go [rad]."""

LARGEST = np.array([0.35, 0.35, 0.5, 0.05])
"""What the view may ask for: alpha, beta, gamma [rad], t_z [m]."""


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """There and back, in 3 s each."""
    loaded = load_arm(arm, flange)
    home = Insertion.on_shaft(loaded, Instrument())
    least, axis = singular_value(home), np.array(home.trocar.axis)
    hardest, chosen = 0.0, (loaded.home, np.zeros(4))
    for joint in np.flatnonzero(np.isfinite(loaded.lower) & np.isfinite(loaded.upper)):
        for limit, outwards in ((loaded.lower[joint], -1.0), (loaded.upper[joint], 1.0)):
            angles = loaded.home.copy()
            angles[joint] = limit - outwards * MARGIN
            insertion = Insertion.on_shaft(loaded, Instrument(), angles)
            upright = axis @ insertion.trocar.axis >= math.cos(math.radians(50.0))
            if not upright or singular_value(insertion) < least / 2.0:
                continue
            J_local = insertion.state(insertion.q_start).J_local
            rates = outwards * np.linalg.pinv(J_local)[joint, [4, 3, 5, 2]]
            view = np.where(np.abs(rates) > 0.05, np.sign(rates), 0.0) * LARGEST
            if rates @ view > hardest:
                hardest = float(rates @ view)
                chosen = angles, view * min(1.0, (MARGIN + BEYOND) / hardest)
    angles, view = chosen
    there = (float(view[0]), float(view[1]), float(view[2]), float(view[3]))
    path = ViewMoves(views=(there, (0.0, 0.0, 0.0, 0.0)), move=3.0, dwell=0.5)
    return Scenario.on_shaft("into_joint_limit", arm, path, flange=flange, angles_start=angles)


def singular_value(insertion: Insertion) -> float:
    """Least singular value of the effector's Jacobian at the start [m, rad]."""
    J: Array = insertion.state(insertion.q_start).J_local
    return float(np.linalg.svd(J, compute_uv=False)[-1])


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
