"""Scenarios along a recording: its way for the tip, or for the trocar."""

from __future__ import annotations

import dataclasses

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths.tip_trace import TipTrace
from rcmqp.references.recorded import Recorded
from rcmqp.runs.scenario import Scenario
from rcmqp.world.motions import Sampled

MOST_BESIDE = 15.0
"""How far a pose's z axis may be from the line through the trocar [deg].

A recording has been made at a trocar and a depth of its own.
"""

CREEP, GENTLE = 1e-3, 1.0
"""Speed [m/s] and acceleration [m/s^2] of a first sample that need no remark."""


def along(scenario: Scenario, recording: Recorded) -> Scenario:
    """The scenario with its tip on the way of a recording, to the recording's end.

    Of poses the roll about the shaft counts, from the first one on: the trocar and the tip say
    where the shaft points.

    Raises:
        OptionError: the poses do not point from the trocar to the tip.
        RcmqpError: the arm cannot be loaded.
    """
    insertion, positions = scenario.insertion(), np.array(recording.positions)
    if recording.world:
        positions = dq.rotate(dq.quaternion_conj(dq.P(insertion.x_rcm)), positions)
    rolls: tuple[float, ...] = ()
    if recording.quaternions:
        tips = positions - positions[0] + [0.0, 0.0, insertion.tip_depth]
        rolls = tuple(_rolls(np.array(recording.quaternions), tips).tolist())
    path = TipTrace(recording.times, tuple(map(tuple, positions.tolist())), rolls)
    return dataclasses.replace(scenario, path=path, duration=path.duration)


def _rolls(quaternions: Array, tips: Array) -> Array:
    """Rotations (n,) about the shaft, gamma of equation (5) [rad], without jumps.

    Args:
        quaternions: (n, 4) of the tip's poses, w first, in any axes that stay.
        tips: (n, 3) seen from the trocar in the axes of x_d(0) [m].
    """
    turned = dq.quaternion_mul(dq.quaternion_conj(quaternions[0]), quaternions)
    x, y, z = (dq.rotate(turned, axis) for axis in np.eye(3))
    along = tips / np.linalg.norm(tips, axis=1)[:, None]
    beside = np.degrees(np.arccos(np.clip((z * along).sum(axis=1), -1.0, 1.0)))
    if beside.max() > MOST_BESIDE:
        worst = int(np.argmax(beside))
        raise OptionError(
            f"the pose of sample {worst + 1} has its z axis {beside[worst]:.0f} deg beside the "
            f"line from the trocar to the tip, at most {MOST_BESIDE:g} are taken; z must be along "
            "the shaft, into the patient, and quaternions in the same axes as the positions. "
            "Without the columns of the quaternion, the positions alone count"
        )
    return np.unwrap(np.arctan2(x[:, 1], y[:, 1]))


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
