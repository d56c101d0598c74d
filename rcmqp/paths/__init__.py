"""Paths: what the surgeon asks of the camera, as view commands over time.

A path is a frozen dataclass of plain numbers, so that a scenario can be written as JSON; a new
one is a class with ``duration`` and ``command()``, added to PATHS.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from rcmqp.paths.circle import Circle
from rcmqp.paths.conical_helix import ConicalHelix
from rcmqp.paths.hand_trace import HandTrace
from rcmqp.paths.lissajous import Lissajous
from rcmqp.paths.view_moves import ViewMoves
from rcmqp.paths.view_steps import ViewSteps
from rcmqp.reference import ViewCommand


@runtime_checkable
class Path(Protocol):
    """View commands over time."""

    @property
    def duration(self) -> float:
        """How long the path takes [s]; afterwards it stays where it ended."""

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view asked for at ``t`` [s], its tip ``tip_depth`` [m] inside at the start."""


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
    "HandTrace",
    "Lissajous",
    "Path",
    "ViewMoves",
    "ViewSteps",
]
