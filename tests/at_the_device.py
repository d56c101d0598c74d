"""A person at the haptic device, in tests."""

from __future__ import annotations

import functools

import numpy as np

from rcmqp import Insertion, load_scenario
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.hand import HandMapping
from rcmqp.references.operators import CameraTrial, Operator, Steering
from rcmqp.references.view import view_pose
from rcmqp.world.instrument import Vector3

T = 0.02
QUICK = Operator(recognition=0.0, margin=0.0)
"""An experienced operator who need not look, nor keep away from anything."""


@functools.cache
def insertion() -> Insertion:
    return load_scenario("camera_task", "panda").insertion()


def steering(trial: CameraTrial, seed: int = 0, period: float = T) -> Steering:
    return trial.start(insertion(), period, seed)


def done_at(trial: CameraTrial, seed: int, most: float = 200.0) -> list[float]:
    """When each objective is reached on a perfect arm [s]."""
    asking, x, times = steering(trial, seed), insertion().x_rcm, []
    for k in range(round(most / T)):
        before = asking.objective
        view = asking.command(k * T, x)
        if asking.objective > before:
            times.append(k * T)
        if view is None:
            break
        x = view_pose(insertion().x_rcm, view).x_d
    return times


def pose(p: Vector3) -> Array:
    """Effector pose (8,) with its tip at p (3,), from the trocar in the start's axes."""
    view = HandMapping().view(HandMapping().way(p, 0.10), (0.0, 0.0, 0.0), 0.10)
    return np.asarray(view_pose(insertion().x_rcm, view).x_d)
