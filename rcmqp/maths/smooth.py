"""How things start and stop: smoothly, from rest to rest."""

from __future__ import annotations

import math

from rcmqp.errors import OptionError


def step(u: float) -> tuple[float, float]:
    """10u^3 - 15u^4 + 6u^5 and its derivative: 0 up to u = 0, 1 from u = 1 on.

    First and second derivative are zero at both ends.
    """
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * (u * (1.0 - u)) ** 2


def check_ramp(duration: float, ramp: float) -> None:
    """Check the times of a path that starts and stops within ``ramp`` [s].

    Raises:
        OptionError: they leave no time between start and stop.
    """
    if not 0.0 < 2 * ramp <= duration < math.inf:
        raise OptionError(
            f"ramp = {ramp} s, duration = {duration} s: the ramp must be positive "
            "and at most half of the duration"
        )
