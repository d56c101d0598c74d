"""The task of a trial: that of experiment B, or one's own from a file."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from pathlib import Path

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.experiments.study.outcome import task_of
from rcmqp.files import check_readable
from rcmqp.references.operators import camera_trial
from rcmqp.references.paths import Search
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.untrusted import MOST_TEXT
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Vector3, vector3
from rcmqp.world.obstacles import Sphere

INSTRUCTIONS = (
    "Find the position from which the camera shows each of the small pictures, in their order, "
    "in the shortest time possible. Do not touch the big sphere with the instrument. A picture "
    "counts as found when the camera is within {tolerance:g} mm of its position."
)
"""What participants read, after the paper's section IV-B."""


def scenarios_task(scenario: Scenario) -> Search:
    """The task of experiment B for a person, who has as long as the scenario's operator.

    Raises:
        OptionError: nobody steers in the scenario.
    """
    task, given = task_of(scenario), camera_trial(scenario.path, scenario.name)
    instructions = INSTRUCTIONS.format(tolerance=1e3 * task.tolerance)
    return dataclasses.replace(task, instructions=instructions, duration=given.duration)


def read_task(file: Path) -> Search:
    """A task from a TOML file, whose keys are the fields of Search.

    For example::

        instructions = "Show the green sphere as in the picture."
        tolerance = 0.002
        places = [[0.02, 0.0, 0.13]]
        spheres = [{centre = [0.02, 0.0, 0.17], radius = 0.004}]
        obstacle = {centre = [0.0, 0.02, 0.15], radius = 0.006}

    Raises:
        OptionError: the file cannot be read, has an unknown key, or a value is not allowed.
    """
    check_readable(file, "a task's .toml", MOST_TEXT)
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise OptionError(f"the task {file} cannot be read: {error}") from error
    known = [item.name for item in dataclasses.fields(Search)]
    if unknown := sorted(data.keys() - set(known)):
        raise OptionError(f"the task {file} has {unknown[0]!r}; it may have {', '.join(known)}")
    if missing := [name for name in ("places", "spheres") if name not in data]:
        raise OptionError(f"the task {file} has no {missing[0]}; it needs places and spheres")
    try:
        return Search(**data)
    except (OptionError, TypeError) as error:
        raise OptionError(f"the task {file}: {error}") from error


def with_task(scenario: Scenario, task: Search) -> Scenario:
    """The scenario with a task to be done in it; the task's obstacle replaces the scenario's.

    Raises:
        OptionError: a place is out of the trocar's cone or range of depths.
    """
    insertion = scenario.insertion()
    obstacles: tuple[Sphere, ...] = ()
    for place in task.places:
        _check_place(place, insertion)
    if task.obstacle is not None:
        pivot, way = insertion.trocar.pivot, insertion.from_start(task.obstacle.centre)
        centre = vector3("centre", [a + b for a, b in zip(pivot, way, strict=True)])
        obstacles = (Sphere(centre, task.obstacle.radius),)
    return dataclasses.replace(
        scenario, path=task, obstacles=obstacles, duration=task.duration, planner_time=None
    )


def _check_place(place: Vector3, insertion: Insertion) -> None:
    trocar, depth = insertion.trocar, math.hypot(*place)
    low, high = trocar.depth_range
    axis = insertion.from_start(place)
    angle = math.acos(np.clip(np.dot(axis, trocar.axis) / depth, -1.0, 1.0))
    if not low <= depth <= high or angle > trocar.cone_half_angle:
        raise OptionError(
            f"the place {place} is {1e3 * depth:.0f} mm deep at {math.degrees(angle):.0f} deg; "
            f"the trocar allows {1e3 * low:.0f} to {1e3 * high:.0f} mm and "
            f"{math.degrees(trocar.cone_half_angle):.0f} deg"
        )
