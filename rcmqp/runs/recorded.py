"""Scenarios along a recording: its way for the tip, or for the trocar."""

from __future__ import annotations

import dataclasses

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.references.paths.traces import TipTrace
from rcmqp.references.recorded import Recorded
from rcmqp.runs.scenario import Scenario
from rcmqp.world.motions import Sampled


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
