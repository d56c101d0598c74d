"""Scenarios along a recording: its way for the tip, or for the trocar."""

from __future__ import annotations

import dataclasses

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.references.paths.tip_trace import TipTrace
from rcmqp.references.recorded import Recorded
from rcmqp.runs.scenario import Scenario
from rcmqp.world.motions import Sampled

CREEP, GENTLE = 1e-3, 1.0
"""Speed [m/s] and acceleration [m/s^2] of a first sample that need no remark."""


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


def recording_remarks(scenario: Scenario) -> list[str]:
    """What a user of recordings should know: that one starts at speed, or ends before the run."""
    found, motion = list[str](), scenario.motion
    ways = {"path": getattr(scenario.path, "way", None), "motion": motion}
    for name, way in ways.items():
        if isinstance(way, Sampled) and (speed := _speed_at_start(way)):
            found.append(
                f"the recorded {name} starts at {1e3 * speed:.3g} mm/s, from rest within one "
                "sample: give it samples before, in which it gathers speed"
            )
    if isinstance(motion, Sampled) and motion.times[-1] < scenario.duration - scenario.period:
        found.append(
            f"the recorded motion ends at {motion.times[-1]:g} s, the run at "
            f"{scenario.duration:g} s: from then on the trocar stays where it is"
        )
    return found


def _speed_at_start(way: Sampled) -> float:
    """Speed from the first sample to the second [m/s]; 0 of a way that starts gently."""
    step = way.times[1] - way.times[0]
    first, second = map(np.array, way.positions[:2])
    speed = float(np.linalg.norm(second - first)) / step
    return speed if speed > CREEP and 2.0 * speed / step > GENTLE else 0.0


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
