"""Views that follow each other at once: what the path planner is for."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from rcmqp.errors import OptionError
from rcmqp.reference import ViewCommand


@dataclass(frozen=True, slots=True)
class ViewSteps:
    """Views held one after the other, with a jump between them.

    Attributes:
        views: (alpha, beta, gamma, t_z) of each view [rad], [m].
        dwell: how long each one is held [s].
    """

    views: tuple[tuple[float, float, float, float], ...]
    dwell: float = 2.0

    def __post_init__(self) -> None:
        """Make the views plain tuples and check them."""
        views = tuple(tuple(map(float, view)) for view in self.views)
        if not views or any(len(view) != 4 for view in views):
            raise OptionError("views: at least one, each (alpha, beta, gamma, t_z)")
        if not all(map(math.isfinite, itertools.chain(*views))):
            raise OptionError(f"views = {views}, every number must be finite")
        if not 0.0 < self.dwell < math.inf:
            raise OptionError(f"dwell = {self.dwell} s, it must be positive")
        object.__setattr__(self, "views", views)

    @property
    def duration(self) -> float:
        """How long all views take [s]."""
        return len(self.views) * self.dwell

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view held at ``t`` [s]; ``tip_depth`` does not matter."""
        index = int(t / self.dwell + 1e-9)  # a sampling instant at a jump belongs to the next view
        return ViewCommand(*self.views[min(max(index, 0), len(self.views) - 1)])
