"""How far the tip is beside its path, and how long behind it."""

from __future__ import annotations

import numpy as np

from rcmqp import _kernel
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.channels import PART
from rcmqp.runs.run import Run
from rcmqp.runs.run_file import Recording


class Contour:
    """The curve that the tip was asked to draw in a run, which the run's parts are compared with.

    The curve has straight lines between the sampling instants. It is seen from the trocar, in axes
    parallel to the world's, so that a trocar that moves takes it along. All of it is in memory, 40
    bytes a cycle.
    """

    def __init__(self, run: Recording) -> None:
        """Read the curve; an instant at which it is not finite stays where it was before."""
        desired, pivot = run.column("tip_d"), run.column("pivot")
        n = desired.shape[0]
        self._curve = np.empty((n, 3))
        for first in range(0, n, PART):
            rows = slice(first, first + PART)
            self._curve[rows] = desired[rows] - pivot[rows]
        finite = np.isfinite(self._curve).all(axis=1)
        if not finite.all():
            before = np.maximum.accumulate(np.where(finite, np.arange(n), int(finite.argmax())))
            self._curve = self._curve[before]
        self._along = np.zeros(n)
        for first in range(1, n, PART):
            steps = np.diff(self._curve[first - 1 : first + PART], axis=0)
            self._along[first : first + PART] = np.linalg.norm(steps, axis=1)
        np.cumsum(self._along, out=self._along)
        self._path_time = np.asarray(run.column("path_time")[0:n])
        self._done = self._reached = 0

    def measure(self, part: Run) -> dict[str, Array]:
        """Compare the run's next part with the curve.

        Returns:
            ``contour``: (n,) distance of the tip from the nearest point of the whole curve [m],
            to a picometre.
            ``lag``: (n,) how late the tip is [s]: the time less the path's time at the instant
            whose desired tip is nearest. Only instants up to now count, and none before the one
            found last; of several that are equally near, the last. Both are NaN where the tip is.
        """
        tip = part.tip - part.pivot
        contour, reached = _kernel.contour(
            tip, self._curve, self._along, self._done, self._reached
        )
        rows = reached.astype(int)
        self._done, self._reached = self._done + len(rows), int(rows[-1])
        lag = part.time - self._path_time[rows]
        return {"contour": contour, "lag": np.where(np.isnan(contour), np.nan, lag)}
