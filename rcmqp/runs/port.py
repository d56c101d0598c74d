"""A scenario moved to a port of one's own."""

from __future__ import annotations

import dataclasses
import warnings
from typing import Any

from rcmqp.errors import ArmWarning
from rcmqp.maths import dualquaternion as dq
from rcmqp.runs.scenario import Scenario
from rcmqp.world.instrument import vector3
from rcmqp.world.motions import Breathing, Sinusoid
from rcmqp.world.port import Port

UPWARDS = 0.17
"""Vertical part of an axis from which on it points upwards: 10 degrees above the horizon."""


def at_port(scenario: Scenario, port: Port) -> Scenario:
    """The scenario at this port; what it has in the patient goes along with the shaft.

    Obstacles, and the direction in which the trocar moves, keep their places as seen from the
    shaft at the start. A recorded motion of the trocar, which is in the world's axes, stays.

    Raises:
        InsertionError: the instrument does not get into the port.
    """
    before = scenario.insertion()
    after = port.insertion(before)
    if after.trocar.axis[2] > UPWARDS:
        warnings.warn(
            f"the trocar's axis {tuple(round(x, 3) for x in after.trocar.axis)} points upwards: "
            "it is the direction into the patient; for a shaft that looks down, turn it round",
            ArmWarning,
            stacklevel=1,
        )
    if port.keeps_pivot:
        return dataclasses.replace(scenario, trocar=after.trocar)
    turn = dq.mul(after.x_rcm, dq.conj(before.x_rcm))
    changes: dict[str, Any] = {}
    if isinstance(scenario.motion, Breathing | Sinusoid):
        direction = vector3("direction", dq.rotate(dq.P(turn), scenario.motion.direction))
        changes["motion"] = dataclasses.replace(scenario.motion, direction=direction)
    moved = []
    for obstacle in scenario.obstacles:
        centre = dq.translation(turn) + dq.rotate(dq.P(turn), obstacle.centre)
        moved.append(dataclasses.replace(obstacle, centre=vector3("centre", centre)))
    return dataclasses.replace(
        scenario,
        angles_start=tuple(after.angles_start),
        trocar=after.trocar,
        shaft_tolerance=after.tolerance,
        obstacles=tuple(moved),
        **changes,
    )
