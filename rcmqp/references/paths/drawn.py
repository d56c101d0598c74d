"""Paths that the tool tip draws, from rest to rest: their views, a whole block at once."""

from __future__ import annotations

import abc
import math
from collections.abc import Iterable

import numpy as np

from rcmqp import _kernel
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.view import ViewCommand, view_of_tip


class Drawn(abc.ABC):
    """A path given by its tip(), which compiled code has as well: rcmqp/kernel/drawn.c.

    Attributes:
        duration: from rest to rest [s].
        ramp: how long the start and the stop take [s].
    """

    __slots__ = ()

    duration: float
    ramp: float

    @abc.abstractmethod
    def tip(self, t: float, tip_depth: float) -> tuple[Iterable[float], Iterable[float]]:
        """Tip (3,) [m] and its velocity (3,) [m/s] seen from the trocar, in x_d(0)'s axes."""

    @abc.abstractmethod
    def figure(self, tip_depth: float) -> tuple[int, tuple[float, float, float, float]]:
        """What compiled code needs: which figure, its sizes and turns.

        Raises:
            OptionError: the figure cannot be drawn from a tip ``tip_depth`` [m] inside.
        """

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view whose tip is on the path at ``t`` [s], without roll."""
        return ViewCommand(*self.views_at(np.array([t], dtype=float), tip_depth)[0].tolist())

    def views_at(self, times: Array, tip_depth: float) -> Array:
        """The views (n, 8) at ``times`` (n,) [s], a ViewCommand's numbers each; see command().

        Raises:
            InvalidCommand: the path leaves the trocar.
        """
        figure, numbers = self.figure(tip_depth)
        sizes = np.array(numbers, dtype=float)
        views = _kernel.views(figure, sizes, self.duration, self.ramp, times, tip_depth)
        if not abs(views[:, 0]).max(initial=0.0) < math.pi / 2.0:  # atan2(x, z) with z <= 0
            for t in times.tolist():
                view_of_tip(*self.tip(t, tip_depth), tip_depth)  # which says what is wrong
        return views
