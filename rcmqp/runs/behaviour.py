"""Measures of behaviour over time: reversals of joints, smoothness, and how it comes to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.head import Column


def sparc(speed: Array, period: float, *, cutoff: float = 10.0, threshold: float = 0.05) -> float:
    """Spectral arc length of a speed profile; smoother is nearer to zero (about -1.4 at best).

    The length of the normalised amplitude spectrum's curve up to the frequency where it falls
    below ``threshold``, at most ``cutoff``, negative (Balasubramanian, Melendez-Calderon, Roby-
    Brami and Burdet 2015).

    Args:
        speed: (n,) not negative.
        period: between samples [s].
        cutoff: [Hz].
        threshold: share of the largest amplitude.

    Returns:
        NaN below three samples, and where one is missing.
    """
    if _too_little(speed):
        return math.nan
    if not speed.any():
        return 0.0
    points = 2 ** (math.ceil(math.log2(len(speed))) + 4)
    amplitude = np.abs(np.fft.rfft(speed, points))
    frequency = np.fft.rfftfreq(points, period)
    amplitude = (amplitude / amplitude.max())[frequency <= cutoff]
    frequency = frequency[frequency <= cutoff]
    last = int(np.flatnonzero(amplitude >= threshold)[-1]) + 1
    amplitude, frequency = amplitude[:last], frequency[:last]
    if last < 2:
        return 0.0
    along = np.diff(frequency) / (frequency[-1] - frequency[0])
    return -float(np.sum(np.hypot(along, np.diff(amplitude))))


def log_dimensionless_jerk(speed: Array, period: float) -> float:
    """LDLJ of a speed profile (n,): -ln(T^3 / v_max^2  integral of v''^2 dt); larger is smoother.

    Hogan and Sternad 2009, on the speed as Balasubramanian et al. 2015 have it. The derivative
    amplifies what is noise or chatter, so it tells apart commands that SPARC does not. NaN below
    three samples, and where one is missing.
    """
    if _too_little(speed):
        return math.nan
    peak = float(speed.max())
    if peak == 0.0:
        return 0.0
    jerk = np.diff(speed, 2) / period**2
    duration = period * (len(speed) - 1)
    return -math.log(max(duration**3 / peak**2 * float(np.sum(jerk**2)) * period, 1e-300))


def _too_little(speed: Array) -> bool:
    return speed.size < 3 or not np.isfinite(speed).all()


TURNING = 0.01
"""Share of its speed limit that a joint must exceed before and after it turns round."""

SETTLED = 1e-3
"""Distance below which the tip counts as settled [m]."""

LAST = 1.0
"""How long before the end of a run its joints should be at rest [s]."""

LEAST_REST = 0.1
"""A reference that stops later than this before the end of a run does not count as stopped [s]."""

STILL = 1e-12
"""How far a pose that stands still may be from where it ends, by rounding [m], [rad]."""

BLOCK = 4096
"""Rows that standstill() reads at once."""


@dataclass(frozen=True, slots=True)
class Standstill:
    """The rows from which on a run is asked for nothing new.

    Attributes:
        rows: of the run, n.
        reference: first row from which on the desired pose, seen from the trocar in axes parallel
            to the world's, is where it is in the last row, to ``STILL``.
        trocar: first row from which on the trocar is where it is in the last row.
    """

    rows: int
    reference: int
    trocar: int

    @property
    def both(self) -> int:
        """First row from which on neither the reference nor the trocar moves."""
        return max(self.reference, self.trocar)


def standstill(x_d: Column, pivot: Column) -> Standstill:
    """Find when a run's reference and trocar stop, from the end backwards.

    Args:
        x_d: (n, 8) desired poses in the world.
        pivot: (n, 3) trocar in the world [m].
    """
    n = x_d.shape[0]
    x_end, pivot_end = x_d[n - 1 : n], pivot[n - 1 : n]
    reference, trocar = 0, 0
    for first in reversed(range(0, n, BLOCK)):
        rows = slice(first, min(first + BLOCK, n))
        shift = pivot[rows] - pivot_end
        way = dq.translation(x_d[rows]) - dq.translation(x_end) - shift
        turn = dq.angle_between(x_end, x_d[rows])
        reference = reference or first_after(first, np.maximum(_length(way), turn))
        trocar = trocar or first_after(first, _length(shift))
        if reference and trocar:
            break
    return Standstill(n, reference, trocar)


def reversals(v: Array, limit: Array) -> Array:
    """Whether each joint turns round from a row to the next, (n - 1, nv).

    It does where v_k v_(k-1) < 0 and both are above TURNING times the speed limit.

    Args:
        v: (n, nv) commanded joint velocities.
        limit: (nv,) speed limits.
    """
    fast = np.abs(v) > TURNING * limit
    return np.asarray((v[1:] * v[:-1] < 0.0) & fast[1:] & fast[:-1])


def streaks(turned: Array, before: Array) -> Array:
    """How often in a row each joint has turned round, counted at each row (m, nv).

    Args:
        turned: (m, nv) whether it turns round, see reversals().
        before: (nv,) how often in a row it has, before the first of these rows.
    """
    count = np.arange(1, len(turned) + 1)[:, None]
    last = np.maximum.accumulate(np.where(turned, 0, count), axis=0)
    return np.asarray(count - last + np.where(last == 0, before, 0))


def growth(distance: Array, least: float = math.inf) -> tuple[float, float]:
    """By how much a distance (m,) grows again after its minimum, and that minimum.

    Args:
        distance: not negative, [m].
        least: minimum of the distances that came before.

    Returns:
        max_k (d_k - min(least, min_(j <= k) d_j)), 0 for a distance that never grows; and
        min(least, min_k d_k).
    """
    if not distance.size:
        return 0.0, least
    low = np.minimum.accumulate(np.concatenate([[least], distance]))[1:]
    return float(np.max(distance - low)), float(low[-1])


class Behaviour:
    """Measures of a run over time, out of its parts.

    With k_r the row ``stop.reference``, k_s the row ``stop.both``, T the period:

    - ``reversals_in_a_row`` is the most rows in a row in which the same joint turns round, see
      reversals(); ``reversals`` are the rows in which any joint does.
    - ``step_ratio_max`` is the largest |v_k - v_(k-1)| / limit; before the run v is 0.
    - ``swing_ratio_end`` is the largest (max v - min v) / limit of a joint over the last second,
      or over the rows from k_s on if they are fewer.
    - ``overshoot_max_mm``: let e = tip - tip_d from k_s on, and u = -e(k_s) / |e(k_s)|, the
      direction in which the tip approaches its end. The measure is the larger of two: e . u, which
      is how far the tip goes past its end; and the growth() of |e| after it is first below
      ``SETTLED``, which is how far a tip that has arrived goes away again, in any direction. A
      tip that only approaches has 0.
    - ``settling_time_s`` is the time from k_r to the first row from which on |tip - tip_d| is
      below ``SETTLED``; inf if the last row is not. Tip and tip_d go along with the trocar here.
    - ``reference_end_s`` is the time of k_r.

    The last two are NaN if less than ``LEAST_REST`` is left from k_r to the last row; swing and
    overshoot are NaN if less than that is left from k_s.
    """

    def __init__(self, stop: Standstill, period: float) -> None:
        """Before the first part.

        Args:
            stop: see standstill().
            period: T [s].
        """
        self._stop, self._period, self._rows = stop, period, 0
        self._window = max(stop.both, stop.rows - 1 - round(LAST / period))
        self._v: Array = np.zeros(0)
        self._streak: Array = np.zeros(0, dtype=int)
        self._reversals, self._in_a_row, self._step = 0, 0, 0.0
        self._low: Array = np.array(math.inf)
        self._high: Array = np.array(-math.inf)
        self._towards: Array | None = None
        self._past, self._grown = 0.0, 0.0
        self._arrived, self._least = False, math.inf
        self._settled = 0

    def add(self, v: Array, limit: Array, tip: Array, tip_d: Array) -> None:
        """Take the next m rows, at least one.

        Args:
            v: (m, nv) commanded joint velocities.
            limit: (nv,) speed limits.
            tip: (m, 3) where the tip is [m].
            tip_d: (m, 3) where it should be [m].
        """
        first, self._rows = self._rows, self._rows + len(v)
        self._add_speeds(v, limit)
        last = v[max(0, self._window - first) :] / limit
        self._low = np.minimum(self._low, last.min(axis=0, initial=math.inf))
        self._high = np.maximum(self._high, last.max(axis=0, initial=-math.inf))
        error = tip - tip_d
        self._add_rest(error[max(0, self._stop.both - first) :])
        self._settled = first_after(first, _length(error), SETTLED) or self._settled

    def summary(self) -> dict[str, float]:
        """The measures by name, see the class."""
        stop, T = self._stop, self._period
        least = max(1, round(LEAST_REST / T))
        at_rest = stop.rows - 1 - stop.both >= least
        stopped = stop.rows - 1 - stop.reference >= least
        settled = T * max(0, self._settled - stop.reference)
        if self._settled == stop.rows:
            settled = math.inf
        return {
            "reversals_in_a_row": float(self._in_a_row),
            "reversals": float(self._reversals),
            "step_ratio_max": self._step,
            "swing_ratio_end": float(np.max(self._high - self._low)) if at_rest else math.nan,
            "overshoot_max_mm": 1e3 * max(self._past, self._grown) if at_rest else math.nan,
            "settling_time_s": settled if stopped else math.nan,
            "reference_end_s": T * stop.reference if stopped else math.nan,
        }

    def _add_speeds(self, v: Array, limit: Array) -> None:
        """Reversals and steps of the next rows."""
        if not self._v.size:
            self._v, self._streak = np.zeros_like(v[0]), np.zeros(v.shape[1], dtype=int)
        chain = np.concatenate([self._v[None], v])
        turned = reversals(chain, limit)
        counts = streaks(turned, self._streak)
        self._reversals += int(turned.any(axis=1).sum())
        self._in_a_row = max(self._in_a_row, int(counts.max()))
        step = np.max(np.abs(np.diff(chain, axis=0)) / limit)
        self._step = float(np.maximum(self._step, step))
        self._v, self._streak = v[-1], counts[-1]

    def _add_rest(self, error: Array) -> None:
        """Overshoot of the next rows (m, 3) from the standstill on."""
        if not len(error):
            return
        distance = _length(error)
        if self._towards is None:
            self._towards = -error[0] / distance[0] if distance[0] > 0.0 else np.zeros(3)
        self._past = max(self._past, float(np.max(np.sum(error * self._towards, axis=1))))
        if not self._arrived:
            arrived = np.flatnonzero(distance < SETTLED)
            if not arrived.size:
                return
            self._arrived, distance = True, distance[arrived[0] :]
        grown, self._least = growth(distance, self._least)
        self._grown = max(self._grown, grown)


def first_after(first: int, distance: Array, least: float = STILL) -> int:
    """Index of the row after the last one whose distance is not below ``least``; 0 without one.

    Args:
        first: index of the first row.
        distance: (m,) of these rows; NaN is not below.
        least: a distance.
    """
    far = np.flatnonzero(~(distance < least))
    return first + int(far[-1]) + 1 if far.size else 0


def _length(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))
