"""Many pieces of work in several processes, and their results as they come."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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
    return iter(parallel(delayed(_numbered)(work, i, piece) for i, piece in enumerate(pieces)))


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
