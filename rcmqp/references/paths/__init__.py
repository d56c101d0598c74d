"""Paths: what the surgeon asks of the camera, as view commands over time.

A path is a frozen dataclass of plain numbers, so that a scenario can be written as JSON; a new
one is a class with ``duration`` and ``command()``, added to PATHS or by a plug-in.
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
from rcmqp.references.paths.search import Search
from rcmqp.references.paths.tip_trace import TipTrace
from rcmqp.references.paths.view_moves import ViewMoves
from rcmqp.references.paths.view_steps import ViewSteps
from rcmqp.references.view import ViewCommand
from rcmqp.world.instrument import Vector3
from rcmqp.world.obstacles import Sphere
from rcmqp.world.plugins import Registry


@runtime_checkable
class Path(Protocol):
    """View commands over time."""

    @property
    def duration(self) -> float:
        """How long the path takes [s]; afterwards it stays where it ended."""

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view asked for at ``t`` [s], its tip ``tip_depth`` [m] inside at the start."""


@runtime_checkable
class Shows(Protocol):
    """What a path has besides, if there is something to be seen on its way; a viewer draws it.

    Points are seen from the trocar in the axes of x_d(0), and move with the trocar [m].
    """

    def targets(self, tip_depth: float) -> tuple[Vector3, ...]:
        """Where the tip is to be, one after the other; it starts ``tip_depth`` [m] inside."""

    @property
    def spheres(self) -> tuple[Sphere, ...]:
        """What the camera is to look at, in its order."""


def views_of(path: Path, times: Array, tip_depth: float) -> Array:
    """The views (n, 8) at ``times`` (n,) [s], a ViewCommand's numbers each; see Path.command()."""
    if isinstance(path, Drawn):
        return path.views_at(times, tip_depth)
    commands = [path.command(t, tip_depth) for t in times.tolist()]
    return np.array([_NUMBERS(command) for command in commands], dtype=float).reshape(-1, 8)


_NUMBERS = operator.attrgetter(*(item.name for item in dataclasses.fields(ViewCommand)))

_OWN: dict[str, type[Path]] = {
    "circle": Circle,
    "conical_helix": ConicalHelix,
    "hand_trace": HandTrace,
    "lissajous": Lissajous,
    "search": Search,
    "tip_trace": TipTrace,
    "view_moves": ViewMoves,
    "view_steps": ViewSteps,
}

PATHS: Registry[Path] = Registry("rcmqp.paths", _OWN)

__all__ = [
    "PATHS",
    "Circle",
    "ConicalHelix",
    "Foreign",
    "HandTrace",
    "Lissajous",
    "Path",
    "Search",
    "Shows",
    "TipTrace",
    "ViewMoves",
    "ViewSteps",
    "views_of",
]
