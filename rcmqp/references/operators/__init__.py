"""Models of people at the haptic device, and what they are asked to do.

A steered path is a frozen dataclass of plain numbers like any path, but it answers what the
camera shows: its start() gives what lives for one run. A new one is such a pair, added to
STEERED or by a plug-in.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from rcmqp.maths.dualquaternion import Array
from rcmqp.references.operators.hand import Encoder, Omega7
from rcmqp.references.operators.learning import Learning
from rcmqp.references.operators.population import (
    GROUPS,
    PARAMETERS,
    Operator,
    Parameter,
    Spread,
    draw_operator,
    operator_of_study,
)
from rcmqp.references.operators.steering import Steering, recognition_times
from rcmqp.references.operators.trial import CameraTrial, camera_trial, seen_by
from rcmqp.references.view import ViewCommand
from rcmqp.world.insertion import Insertion
from rcmqp.world.plugins import Registry


class Asking(Protocol):
    """A source of views during one run."""

    def command(self, t: float, x: Array) -> ViewCommand | None:
        """The view asked for at ``t`` [s]; None ends the run.

        Args:
            t: one period after the last call; 0 at the first.
            x: (8,) effector pose that was measured last, which the camera shows.
        """


@runtime_checkable
class Steered(Protocol):
    """Views that depend on what the camera shows."""

    @property
    def duration(self) -> float:
        """The longest time that it can take [s]."""

    def start(self, insertion: Insertion, period: float, seed: int) -> Asking:
        """Make the source of views of one run; equal arguments give the same views to the bit."""


_OWN: dict[str, type[Steered]] = {"camera_trial": CameraTrial}

STEERED: Registry[Steered] = Registry("rcmqp.steered", _OWN)

__all__ = [
    "GROUPS",
    "PARAMETERS",
    "STEERED",
    "Asking",
    "CameraTrial",
    "Encoder",
    "Learning",
    "Omega7",
    "Operator",
    "Parameter",
    "Spread",
    "Steered",
    "Steering",
    "camera_trial",
    "draw_operator",
    "operator_of_study",
    "recognition_times",
    "seen_by",
]
