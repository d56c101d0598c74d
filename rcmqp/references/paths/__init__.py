"""Paths: what the surgeon asks of the camera, as view commands over time.

A path is a frozen dataclass of plain numbers, so that a scenario can be written as JSON; a new
one is a class with ``duration`` and ``command()``, added to PATHS or by a plug-in.
"""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths.drawn import Circle, ConicalHelix, Drawn, Lissajous
from rcmqp.references.paths.traces import HandTrace, TipTrace
from rcmqp.references.paths.views import Search, ViewMoves, ViewSteps
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
        """The view asked for at ``t`` [s]; at the start the tip is ``tip_depth`` [m] inside."""


@runtime_checkable
class Shows(Protocol):
    """A path with targets or spheres, which a viewer draws.

    Points are seen from the trocar in the axes of x_d(0), and move with the trocar [m].
    """

    def targets(self, tip_depth: float) -> tuple[Vector3, ...]:
        """Where the tip is to be, one after the other; it starts ``tip_depth`` [m] inside."""

    @property
    def spheres(self) -> tuple[Sphere, ...]:
        """The spheres that the camera is to look at, in order."""


@dataclass(frozen=True, slots=True)
class Foreign:
    """A path out of a file whose class this process does not have.

    A run along it can be looked at; it cannot be run again before its class is in PATHS, by this
    program or by a plug-in.

    Attributes:
        kind: its name in PATHS, where the run was made.
        numbers: its fields.
    """

    kind: str
    numbers: Mapping[str, Any]

    @property
    def duration(self) -> float:
        """How long the path takes [s], as far as is known."""
        return float(self.numbers.get("duration", 0.0))

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """Nothing can be asked.

        Raises:
            OptionError: always.
        """
        raise OptionError(
            f"this process does not know the path {self.kind!r}, so it cannot be run; add its "
            "class to rcmqp.references.paths.PATHS, or install the plug-in that has it, as where "
            "the scenario was made"
        )


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
