"""A run that an earlier, perhaps interrupted, comparison has made already."""

from __future__ import annotations

import functools
import importlib.resources
import inspect
import os
import time
from pathlib import Path

from rcmqp.controllers import Controller
from rcmqp.errors import RunFileError
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import versions

LOADED = time.time()
"""When this process loaded rcmqp's code, and no later than the controllers made with it."""


def kept_run(file: Path, scenario: Scenario, controller: Controller) -> Run | None:
    """The run in a file, if simulating it again would give the same one; else None.

    It is the same if scenario, controller, options, URDF and versions are, and if no code of
    rcmqp, of the controller, the path, the plant or the motion has changed since; their base
    classes count too. Code that these classes call elsewhere does not count: after a change of it,
    give another folder. The time of the file is compared with that of the code, see date().

    Args:
        file: of the run; it may be missing or damaged.
        scenario: what is to be simulated.
        controller: likewise.
    """
    if not file.is_file():
        return None
    try:
        head = (run := Run.load(file)).head
    except RunFileError:
        return None
    made_with = controller.insertion.arm.sha256, versions()
    if not head.is_of(scenario, controller) or made_with != (head.urdf_sha256, head.versions):
        return None
    changed = max([_own_code(), *map(_code, classes_outside(controller, scenario))])
    return run if changed < file.stat().st_mtime else None


def date(file: Path) -> None:
    """Give a run's file the time when this process loaded rcmqp, in place of the run's end.

    Code that is edited after that, be it during the run, may not be what the run was made with.
    """
    os.utime(file, (LOADED, LOADED))


def classes_outside(controller: Controller, scenario: Scenario) -> list[type]:
    """Classes of controller, path, motion and plant, and their bases, that are not rcmqp's own."""
    return [
        kind
        for part in (controller, scenario.path, scenario.motion, scenario.plant)
        for kind in type(part).__mro__
        if kind.__module__.partition(".")[0] not in ("rcmqp", "abc", "builtins", "typing")
    ]


@functools.cache
def _own_code() -> float:
    """When a file of rcmqp's code, or of one of its arms, was last changed."""
    folder = Path(__file__).parents[1]
    robots = Path(str(importlib.resources.files("rcmqp.robots")))
    files = [*folder.rglob("*.py"), *folder.glob("*.so"), *folder.glob("*.pyd")]
    files += robots.glob("*/robot.toml")
    return max(file.stat().st_mtime for file in files)


def _code(kind: type) -> float:
    """When the file of a class was last changed; infinite of one that is in no file."""
    try:
        return Path(inspect.getfile(kind)).stat().st_mtime
    except (TypeError, OSError):
        return float("inf")
