"""Jerk of the commanded joint velocity, over its limit, part after part of a run."""

from __future__ import annotations

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.run import Run


class JerkRatio:
    """Takes the parts of a run one after the other; their sizes do not matter, to the bit."""

    def __init__(self) -> None:
        """Before the run, at rest."""
        self._last: Array | None = None

    def of(self, part: Run) -> Array:
        """|v_k - 2 v_{k-1} + v_{k-2}| / (T^2 jerk limit) of the worst joint in each cycle (n,).

        v is zero before the run.
        """
        before = np.zeros((2, part.v.shape[1])) if self._last is None else self._last
        v = np.concatenate([before, part.v])
        self._last = v[-2:]
        jerk = np.abs(v[2:] - 2.0 * v[1:-1] + v[:-2]) / part.period**2
        return np.asarray((jerk / part.jerk_limit).max(axis=-1))
