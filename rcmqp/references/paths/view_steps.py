"""Views that follow each other at once: what the path planner is for."""

from __future__ import annotations

from dataclasses import dataclass, field

from rcmqp.maths.options import options, positive, rule
from rcmqp.references.paths.view_moves import View, plain_views, tips
from rcmqp.references.view import ViewCommand
from rcmqp.world.instrument import Vector3
from rcmqp.world.obstacles import Sphere


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
        """None."""
        return ()
