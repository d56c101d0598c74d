"""A run's file, looked at in the memory of one part of it, however long it is."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.channels import NOT_IN_DIGEST, PART
from rcmqp.runs.head import Column, Head, check_digest, opened
from rcmqp.runs.run import Run, stored_channel, within

if TYPE_CHECKING:
    import h5py


class Recording(Protocol):
    """A run that metrics can be computed of: a Run, or a RunFile."""

    @property
    def head(self) -> Head:
        """The part of the run that does not change from cycle to cycle."""

    @property
    def title(self) -> str:
        """Scenario, arm and controller in one line."""

    @property
    def digest(self) -> str:
        """SHA-256 of the run; see Run."""

    def parts(self) -> Iterator[Run]:
        """The run, one part after the other."""

    def column(self, name: str) -> Column:
        """A channel with a row for each cycle."""


class RunFile:
    """A run in a file that Run.load() would read, open for reading.

        with RunFile(path) as run:
            found = compute_metrics(run)

    Attributes:
        digest: see Run; the numbers in the file have been checked against it.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Take the file at ``path``; nothing is read yet."""
        self._path, self._open = path, contextlib.ExitStack()

    def __enter__(self) -> Self:
        """Open the file and check every number in it.

        Raises:
            RunFileError: as Run.load() does.
        """
        with contextlib.ExitStack() as stack:
            self._file: h5py.File = stack.enter_context(opened(self._path))
            self._run = Run.read(self._file, slice(0, 0))
            arrays = {
                name: self.column(name)
                for name in self._run.arrays()
                if name in self._file or name == "path_time"
            }
            arrays |= {name: self.column(f"diagnostics/{name}") for name in self._run.diagnostics}
            del arrays[NOT_IN_DIGEST]
            self.digest = self.head.digest(arrays, block=PART)
            check_digest(self._file, self.digest)
            self._open = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._open.close()

    @property
    def head(self) -> Head:
        """See Recording."""
        return self._run.head

    @property
    def title(self) -> str:
        """See Recording."""
        return self._run.title

    def parts(self, size: int = PART) -> Iterator[Run]:
        """The run, ``size`` rows at a time; the last part may be shorter."""
        for first in range(0, self.column("time").shape[0], size):
            rows = slice(first, first + size)
            yield self._run.with_rows(
                {name: self.column(name)[rows] for name in self._run.rows()},
                {name: self.column(f"diagnostics/{name}")[rows] for name in self._run.diagnostics},
                within(self._run.stops, rows),
            )

    def column(self, name: str) -> Column:
        """See Recording."""
        return stored_channel(self._file, name)


def where_largest(run: Recording, excess_of: Callable[[Run], Array]) -> tuple[int, int, str]:
    """Indices of joint and cycle with the largest excess (n, nv), and their names as text."""
    worst, joint, cycle, where, before = -math.inf, 0, 0, "", 0
    for part in run.parts():
        excess = excess_of(part)
        row, column = np.unravel_index(int(np.argmax(excess)), excess.shape)
        if excess[row, column] > worst:
            worst, joint, cycle = excess[row, column], int(column), before + int(row)
            where = f"{part.joints[column]} at {part.time[row]:.3f} s"
        before += len(part.time)
    return joint, cycle, where
