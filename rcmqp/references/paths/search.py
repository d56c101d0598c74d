"""Views that somebody is to find with the camera, by a live hand."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rcmqp.maths.options import options, or_none, part, positive, refused, rule
from rcmqp.references.view import ViewCommand
from rcmqp.world.instrument import Vector3, vector3
from rcmqp.world.obstacles import Sphere

MOST_PLACES = 20
"""Views to be found, at most."""

MOST_SPHERES = 4
"""As many as there are colours that everybody can distinguish."""

LONGEST_TEXT = 2000
"""Letters of the instructions."""


def _some(name: str, values: Any, most: int) -> tuple[Any, ...]:
    if not isinstance(values, list | tuple):
        raise refused(name, values, "a list")
    if not 1 <= len(values) <= most:
        raise refused(f"number of {name}", len(values), f"1 to {most}")
    return tuple(values)


def _places(name: str, values: Any) -> tuple[Vector3, ...]:
    found = tuple(vector3(name, value) for value in _some(name, values, MOST_PLACES))
    if shallow := [place for place in found if not place[2] > 0.0]:
        raise refused(name, shallow[0], "inside the patient, with z above 0")
    return found


def _spheres(name: str, values: Any) -> tuple[Sphere, ...]:
    take = part(Sphere)["rule"]
    return tuple(take(name, value) for value in _some(name, values, MOST_SPHERES))


def _text(name: str, value: Any) -> str:
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise refused(name, value, f"a text of at most {LONGEST_TEXT} letters")
    return value


@options
@dataclass(frozen=True, slots=True)
class Search:
    """Spheres to look at, and where the camera is to be, one place after the other.

    Points are seen from the trocar in the axes of x_d(0): x to the right and y down in the first
    image, z into the patient [m]. Run without a hand, the camera stays where it is.

    Attributes:
        places: (m, 3) of the camera, in the order asked for; the image there has no roll.
        spheres: what the camera sees.
        obstacle: what the shaft is not to touch; None for nothing.
        tolerance: distance from a place at which it counts as reached [m].
        instructions: what the person reads before the task.
        duration: after which the task ends, done or not [s].
    """

    places: tuple[Vector3, ...] = field(metadata=rule(_places))
    spheres: tuple[Sphere, ...] = field(metadata=rule(_spheres))
    obstacle: Sphere | None = field(default=None, metadata=or_none(part(Sphere)))
    tolerance: float = field(default=1e-3, metadata=positive("m"))
    instructions: str = field(default="", metadata=rule(_text))
    duration: float = field(default=600.0, metadata=positive("s"))

    def targets(self, tip_depth: float) -> tuple[Vector3, ...]:
        """The places; see rcmqp.references.paths.Shows."""
        return self.places

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view of the start."""
        return ViewCommand()
