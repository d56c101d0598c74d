"""Paths: what the surgeon asks of the camera, as view commands over time.

A path is a frozen dataclass of plain numbers, so that a scenario can be written as JSON; a new
one is a class with ``duration`` and ``command()``, added to PATHS.
"""

from __future__ import annotations

import dataclasses
import operator
from typing import Protocol, runtime_checkable

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths.circle import Circle
from rcmqp.references.paths.conical_helix import ConicalHelix
from rcmqp.references.paths.drawn import Drawn
from rcmqp.references.paths.foreign import Foreign
from rcmqp.references.paths.hand_trace import HandTrace
from rcmqp.references.paths.lissajous import Lissajous
from rcmqp.references.paths.view_moves import ViewMoves
from rcmqp.references.paths.view_steps import ViewSteps
from rcmqp.references.view import ViewCommand


@runtime_checkable
class Path(Protocol):
    """View commands over time."""

    @property
    def duration(self) -> float:
        """How long the path takes [s]; afterwards it stays where it ended."""

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view asked for at ``t`` [s], its tip ``tip_depth`` [m] inside at the start."""


def views_of(path: Path, times: Array, tip_depth: float) -> Array:
    """The views (n, 8) at ``times`` (n,) [s], a ViewCommand's numbers each; see Path.command()."""
    if isinstance(path, Drawn):
        return path.views_at(times, tip_depth)
    commands = [path.command(t, tip_depth) for t in times.tolist()]
    return np.array([_NUMBERS(command) for command in commands], dtype=float).reshape(-1, 8)


_NUMBERS = operator.attrgetter(*(item.name for item in dataclasses.fields(ViewCommand)))

PATHS: dict[str, type[Path]] = {
    "circle": Circle,
    "conical_helix": ConicalHelix,
    "hand_trace": HandTrace,
    "lissajous": Lissajous,
    "view_moves": ViewMoves,
    "view_steps": ViewSteps,
}

__all__ = [
    "PATHS",
    "Circle",
    "ConicalHelix",
    "Foreign",
    "HandTrace",
    "Lissajous",
    "Path",
    "ViewMoves",
    "ViewSteps",
    "views_of",
]
