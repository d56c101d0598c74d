"""How things start and stop: smoothly from rest to rest, and as fast as a limit allows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array


def step(u: float) -> tuple[float, float]:
    """10u^3 - 15u^4 + 6u^5 and its derivative: 0 up to u = 0, 1 from u = 1 on.

    First and second derivative are zero at both ends.
    """
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * (u * (1.0 - u)) ** 2


def check_ramp(duration: float, ramp: float) -> None:
    """Check the times of a motion from rest to rest: two ramps, and a constant speed between them.

    Raises:
        OptionError: they leave no time between start and stop.
    """
    if not 0.0 < 2 * ramp <= duration < math.inf:
        raise OptionError(
            f"ramp = {ramp} s, duration = {duration} s: the ramp must be positive "
            "and at most half of the duration"
        )


def braking_speed(distance: ArrayLike, deceleration: ArrayLike, period: float) -> Array:
    """Largest speed towards a limit from which a joint sampled with T can still brake.

    Gone for this cycle at v, and then slowed down by a T a cycle, the joint goes

        S(v) = v T + sum_{j >= 1} max(0, v - j a T) T = T ((m + 1) v - a T m (m + 1) / 2),

    with m = floor(v / (a T)) braking cycles. S grows, and S(m a T) = a T^2 m (m + 1) / 2, so
    S(v) = d is solved by

        v = d / ((m + 1) T) + m a T / 2,   m = floor((sqrt(1 + 8 d / (a T^2)) - 1) / 2),

    continuous and piecewise linear in d. Without a limit on the deceleration m = 0, v = d / T;
    for small T it is sqrt(2 a d).

    Args:
        distance: (...) d to the limit [rad] or [m]; beyond the limit, negative, the answer is
            -v(|d|): the slowest way back that keeps the pace to stop on the limit.
        deceleration: (...) a [rad/s^2], inf for none.
        period: T [s].

    Returns:
        (...) v, inf for an infinite distance.
    """
    d = np.abs(np.asarray(distance, dtype=float))
    step = np.asarray(deceleration, dtype=float) * period
    with np.errstate(invalid="ignore"):  # inf / inf, both without limit
        m = np.floor((np.sqrt(1.0 + 8.0 * d / (step * period)) - 1.0) / 2.0)
    m = np.where(np.isfinite(m), m, 0.0)
    speed = d / ((m + 1.0) * period) + m * np.where(m > 0.0, step, 0.0) / 2.0
    return np.asarray(np.copysign(speed, distance))
