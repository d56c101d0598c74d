"""Views one after the other: with smooth moves between them, at once, or to be found by a hand."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.options import at_least, options, or_none, part, positive, refused, rule
from rcmqp.maths.smooth import step
from rcmqp.references.view import ViewCommand, view_pose
from rcmqp.world.camera import camera_pose
from rcmqp.world.instrument import Vector3, vector3
from rcmqp.world.obstacles import Sphere

View: TypeAlias = tuple[float, float, float, float]


def plain_views(name: str, values: Iterable[Iterable[float]]) -> tuple[View, ...]:
    """Views as plain tuples.

    Raises:
        OptionError: there is none, or one is not four finite numbers.
    """
    try:
        plain = tuple(tuple(map(float, view)) for view in values)
    except (TypeError, ValueError, OverflowError):
        plain = ()
    if not plain or any(len(view) != 4 or not all(map(math.isfinite, view)) for view in plain):
        raise refused(name, values, "at least one view (alpha, beta, gamma, t_z), finite numbers")
    return plain  # type: ignore[return-value]  # four each


@options
@dataclass(frozen=True, slots=True)
class ViewMoves:
    """Views one after the other, with a move from rest to rest before each.

    The first move begins at the view of the start. A move takes all four numbers from one view
    to the next by one fraction, 10u^3 - 15u^4 + 6u^5.

    Attributes:
        views: (alpha, beta, gamma, t_z) of each view [rad], [m].
        move: how long a move takes [s].
        dwell: how long each view is held [s].
    """

    views: tuple[View, ...] = field(metadata=rule(plain_views))
    move: float = field(default=2.0, metadata=positive("s"))
    dwell: float = field(default=0.5, metadata=at_least(0.0, "s"))

    @property
    def duration(self) -> float:
        """How long all moves take [s]."""
        return len(self.views) * (self.move + self.dwell)

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view at ``t`` [s]; ``tip_depth`` does not matter."""
        t = min(max(t, 0.0), self.duration)
        index = min(int(t / (self.move + self.dwell)), len(self.views) - 1)
        s, ds_du = step((t - index * (self.move + self.dwell)) / self.move)
        before = self.views[index - 1] if index else (0.0,) * 4
        pairs = list(zip(before, self.views[index], strict=True))
        values = (start + s * (end - start) for start, end in pairs)
        rates = (ds_du / self.move * (end - start) for start, end in pairs)
        return ViewCommand(*values, *rates)

    def targets(self, tip_depth: float) -> tuple[Vector3, ...]:
        """Tips of the views, each once; see Shows."""
        return tips(self.views, tip_depth)

    @property
    def spheres(self) -> tuple[Sphere, ...]:
        """No spheres."""
        return ()


def tips(
    views: tuple[tuple[float, float, float, float], ...], tip_depth: float
) -> tuple[Vector3, ...]:
    """Where the tip is in each view, from the trocar in the axes of x_d(0) [m], each once."""
    poses = np.array([view_pose(dq.IDENTITY, ViewCommand(*view)).x_d for view in views])
    points = dq.translation(camera_pose(poses, tip_depth)).round(9).tolist()
    return tuple(dict.fromkeys((x, y, z) for x, y, z in points))


@options
@dataclass(frozen=True, slots=True)
class ViewSteps:
    """Views held one after the other, with a jump between them.

    Attributes:
        views: (alpha, beta, gamma, t_z) of each view [rad], [m].
        dwell: how long each one is held [s].
    """

    views: tuple[View, ...] = field(metadata=rule(plain_views))
    dwell: float = field(default=2.0, metadata=positive("s"))

    @property
    def duration(self) -> float:
        """How long all views take [s]."""
        return len(self.views) * self.dwell

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view held at ``t`` [s]; ``tip_depth`` does not matter."""
        index = int(t / self.dwell + 1e-9)  # a sampling instant at a jump belongs to the next view
        return ViewCommand(*self.views[min(max(index, 0), len(self.views) - 1)])

    def targets(self, tip_depth: float) -> tuple[Vector3, ...]:
        """Tips of the views, each once; see Shows."""
        return tips(self.views, tip_depth)

    @property
    def spheres(self) -> tuple[Sphere, ...]:
        """No spheres."""
        return ()


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
    places = tuple(vector3(name, value) for value in _some(name, values, MOST_PLACES))
    if shallow := [place for place in places if not place[2] > 0.0]:
        raise refused(name, shallow[0], "inside the patient, with z above 0")
    return places


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
