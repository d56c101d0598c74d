"""A scenario at another port, with another instrument, or along a recording."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.references.paths.traces import TipTrace
from rcmqp.references.recorded import Recorded
from rcmqp.runs.scenario import Scenario
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Instrument, vector3
from rcmqp.world.motions import Breathing, Sampled, Sinusoid
from rcmqp.world.port import Port


def at_port(scenario: Scenario, port: Port) -> Scenario:
    """The scenario at this port; what it has in the patient goes along with the shaft.

    Obstacles, and the direction in which the trocar moves, keep their places as seen from the
    shaft at the start. A recorded motion of the trocar, which is in the world's axes, stays.

    Raises:
        InsertionError: the instrument does not get into the port.
    """
    before = scenario.insertion()
    after = port.insertion(before)
    if port.keeps_pivot:
        return dataclasses.replace(scenario, trocar=after.trocar)
    return _moved(scenario, before, after)


def with_instrument(scenario: Scenario, instrument: Instrument) -> Scenario:
    """The scenario with another instrument; the arm stays where it is.

    The trocar is put on the new shaft, its tip as deep inside as before; what the scenario has in
    the patient goes along as in at_port().

    Raises:
        InsertionError: the shaft is too short.
    """
    before = scenario.insertion()
    same = ("mount", "tip", "wrist")
    if all(getattr(instrument, name) == getattr(before.instrument, name) for name in same):
        return dataclasses.replace(scenario, instrument=instrument)
    angles = before.angles_start[: before.bare.nv]
    there = Insertion.on_shaft(before.bare, instrument, angles, depth=before.tip_depth)
    trocar = dataclasses.replace(scenario.trocar, pivot=there.trocar.pivot, axis=there.trocar.axis)
    after = Insertion(before.bare, instrument, trocar, angles)
    return dataclasses.replace(_moved(scenario, before, after), instrument=instrument)


def _moved(scenario: Scenario, before: Insertion, after: Insertion) -> Scenario:
    """The scenario at another insertion, with what it has in the patient."""
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


def along(scenario: Scenario, recording: Recorded) -> Scenario:
    """The scenario with its tip on the way of a recording, to the recording's end.

    Raises:
        RcmqpError: the arm cannot be loaded.
    """
    positions = np.array(recording.positions)
    if recording.world:
        positions = dq.rotate(dq.quaternion_conj(dq.P(scenario.insertion().x_rcm)), positions)
    path = TipTrace(recording.times, tuple(map(tuple, positions.tolist())))
    return dataclasses.replace(scenario, path=path, duration=path.duration)


def moved(scenario: Scenario, recording: Recorded) -> Scenario:
    """The scenario with its trocar moving as a recording says.

    Raises:
        OptionError: the recording is not in the world's axes.
    """
    if not recording.world:
        raise OptionError(
            "a trocar's motion is in the world's axes: name its columns world x, world y, world z"
        )
    return dataclasses.replace(scenario, motion=Sampled(recording.times, recording.positions))
