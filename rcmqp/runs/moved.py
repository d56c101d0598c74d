"""A scenario at another port, with another instrument, or along a recording."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.operators import seen_by
from rcmqp.references.paths.traces import TipTrace
from rcmqp.runs.scenario import Scenario
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Instrument, vector3
from rcmqp.world.motions import Breathing, Sampled, Sinusoid
from rcmqp.world.port import Port
from rcmqp.world.recorded import Recorded

MOST_BESIDE = 15.0
"""How far a pose's z axis may be from the line through the trocar [deg].

A recording has been made at a trocar and a depth of its own.
"""

CREEP, GENTLE = 1e-3, 1.0
"""Speed [m/s] and acceleration [m/s^2] of a first sample that need no remark."""


def at_port(scenario: Scenario, port: Port) -> Scenario:
    """Move the scenario to this port; what is in the patient moves with the shaft.

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
    the patient goes along as in at_port(). The spheres of a camera task are put where the camera
    looks.

    Raises:
        InsertionError: the shaft is too short.
    """
    before = scenario.insertion()
    scenario = dataclasses.replace(scenario, path=seen_by(scenario.path, instrument.camera))
    same = ("mount", "tip", "wrist")
    if all(getattr(instrument, name) == getattr(before.instrument, name) for name in same):
        return dataclasses.replace(scenario, instrument=instrument)
    angles = before.angles_start[: before.bare.nv]
    there = Insertion.on_shaft(before.bare, instrument, angles, depth=before.tip_depth)
    trocar = dataclasses.replace(scenario.trocar, pivot=there.trocar.pivot, axis=there.trocar.axis)
    after = Insertion(before.bare, instrument, trocar, angles)
    return dataclasses.replace(_moved(scenario, before, after), instrument=instrument)


def _moved(scenario: Scenario, before: Insertion, after: Insertion) -> Scenario:
    """The scenario at another insertion; obstacles and motion keep their place on the shaft."""
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
    """The scenario with its tip on a recorded path, to the recording's end.

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
    """Remarks on recordings: one that starts at speed, or that ends before the run."""
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
    """Speed from the first sample to the second [m/s]; 0 if the motion starts gently."""
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
