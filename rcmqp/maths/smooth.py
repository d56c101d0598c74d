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


def progress(t: float, duration: float, ramp: float) -> tuple[float, float]:
    """How far something has come at ``t`` [s], s in [0, 1], and s' [1/s].

    s' rises as step() during ``ramp`` [s], is constant in between, and falls likewise, so that
    s reaches 1 at ``duration`` [s].
    """
    if t > duration / 2:
        s, s_dot = progress(duration - min(t, duration), duration, ramp)
        return 1.0 - s, s_dot
    cruise = 1.0 / (duration - ramp)
    if t >= ramp:
        return cruise * (t - ramp / 2), cruise
    u = max(t, 0.0) / ramp
    return cruise * ramp * u**4 * (2.5 - 3.0 * u + u**2), cruise * step(u)[0]


def check_ramp(duration: float, ramp: float) -> None:
    """Check the times of progress().

    Raises:
        OptionError: they leave no time between start and stop.
    """
    if not 0.0 < 2 * ramp <= duration < math.inf:
        raise OptionError(
            f"ramp = {ramp} s, duration = {duration} s: the ramp must be positive "
            "and at most half of the duration"
        )
