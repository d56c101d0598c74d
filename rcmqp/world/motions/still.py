"""A trocar that does not move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcmqp.maths.dualquaternion import Array


@dataclass(frozen=True, slots=True)
class Still:
    """Always where it was."""

    def position(self, t: float) -> Array:
        """Zero (3,) [m]."""
        return np.zeros(3)

    def velocity(self, t: float) -> Array:
        """Zero (3,) [m/s]."""
        return np.zeros(3)
