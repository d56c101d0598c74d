"""Pieces of work in several processes, their results as they come, and runs made before."""

from __future__ import annotations

import functools
import importlib.resources
import inspect
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from joblib import Parallel, delayed

from rcmqp.controllers import Controller
from rcmqp.errors import OptionError, RunFileError
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import versions

Result = TypeVar("Result")

Progress = Callable[[str, int, int], None]
"""Called with a title, how many pieces were done since the last call, and how many in all."""


def batch(
    work: Callable[..., Result], pieces: Sequence[tuple[Any, ...]], *, jobs: int = 1
) -> Iterator[tuple[int, Result]]:
    """Do ``work(*piece)`` for every piece, and yield the piece's number and result as it comes.

    Work that is to go on after an interruption keeps its own result in a file, and looks for that
    first; what has been yielded is done.

    Args:
        work: a function of a module, because it goes to other processes.
        pieces: its arguments, which go there too.
        jobs: how many processes; joblib's n_jobs, so -1 is one for each core. A backend chosen
            with joblib.parallel_config(), such as Dask's, is used.

    Raises:
        OptionError: ``jobs`` is not a number of processes; raised before any piece is done.
    """
    check_jobs(jobs)
    parallel = Parallel(
        n_jobs=jobs, return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs"
    )
    with _interrupts_ignored():  # the processes start in here
        return iter(parallel(delayed(_numbered)(work, i, piece) for i, piece in enumerate(pieces)))


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignore Ctrl-C in here, and for good in the processes that start in here.

    A terminal sends SIGINT to all of them, and each would print a traceback. Outside, this process
    alone answers it, and ends the others.
    """
    before = signal.getsignal(signal.SIGINT)
    if before is None or threading.current_thread() is not threading.main_thread():
        yield  # not Python's handler, or a thread that may not change it
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def check_jobs(jobs: int) -> None:
    """Check a number of processes.

    Raises:
        OptionError: ``jobs`` is not a number of processes.
    """
    if not isinstance(jobs, int) or jobs == 0:
        raise OptionError(f"jobs = {jobs!r}, a whole number of processes, or -1 for every core")


def _numbered(
    work: Callable[..., Result], number: int, piece: tuple[Any, ...]
) -> tuple[int, Result]:
    return number, work(*piece)


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
