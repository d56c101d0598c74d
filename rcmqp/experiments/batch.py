"""Many pieces of work in several processes, and their results as they come."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from joblib import Parallel, delayed

from rcmqp.errors import OptionError

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
        OptionError: ``jobs`` is no number of processes; before any piece is done.
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
    """Find out whether there can be that many processes.

    Raises:
        OptionError: ``jobs`` is no number of processes.
    """
    if not isinstance(jobs, int) or jobs == 0:
        raise OptionError(f"jobs = {jobs!r}, a whole number of processes, or -1 for every core")


def _numbered(
    work: Callable[..., Result], number: int, piece: tuple[Any, ...]
) -> tuple[int, Result]:
    return number, work(*piece)
