"""Places that the tip is to reach, one after the other."""

from __future__ import annotations

from typing import Self

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths import Search
from rcmqp.world.insertion import Insertion


class Goals:
    """Which places were reached, and when.

    Attributes:
        places: (m, 3) in the world [m].
        reached: when each was, as far as they were [s].
    """

    def __init__(self, places: Array, tolerance: float) -> None:
        """None is reached yet; within ``tolerance`` [m] one will be."""
        self.places, self.reached = places, list[float]()
        self._tolerance = tolerance

    @classmethod
    def of(cls, task: Search, insertion: Insertion) -> Self:
        """Those of a task, for a trocar that stands still."""
        ways = np.array([insertion.from_start(place) for place in task.places])
        return cls(ways + np.array(insertion.trocar.pivot), task.tolerance)

    @property
    def done(self) -> bool:
        """Whether there were any, and all are reached."""
        return 0 < len(self.places) == len(self.reached)

    @property
    def left(self) -> bool:
        """Whether there is one that is not reached."""
        return len(self.reached) < len(self.places)

    def see(self, t: float, tip: Array) -> None:
        """The tip (3,) is in the world [m] at ``t`` [s]; one place at most is reached then."""
        k = len(self.reached)
        if k < len(self.places) and np.linalg.norm(tip - self.places[k]) <= self._tolerance:
            self.reached.append(t)
