"""How smooth a movement is, from its speed: two measures that the field reports."""

from __future__ import annotations

import math

import numpy as np

from rcmqp.maths.dualquaternion import Array


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
