"""Errors are approached no faster than the joints can stop them."""

from __future__ import annotations

import numpy as np
import pytest

from rcmqp.maths.dualquaternion import Array
from rcmqp.tasks.base import Approach

T, GAIN, DAMPING = 1e-3, 60.0, 0.01
NO_ROWS = np.zeros((0, 1))


def approach(v: float, a: float, acceleration: float, jerk: float, share: float = 0.8) -> Approach:
    """Of one joint."""
    limits = np.array([acceleration]), np.array([jerk])
    return Approach(np.array([v]), np.array([a]), *limits, share, T, NO_ROWS)


def rate(of: Approach, error: float) -> float:
    rows = np.array([[0.3]])
    return float(of.rate(rows, np.array([error]), np.zeros(1), GAIN, DAMPING)[0])


@pytest.mark.parametrize("error", [1e-9, 1e-3, 0.1])
def test_without_limits_or_without_a_share_an_error_is_reduced_in_proportion(error: float) -> None:
    assert rate(approach(0.0, 0.0, np.inf, np.inf), error) == -GAIN * error
    assert rate(approach(0.0, 0.0, 2.0, 40.0, share=0.0), error) == -GAIN * error


def settled(error: float, acceleration: float, jerk: float, share: float) -> Array:
    """Errors of one joint that does what is asked as well as its limits allow."""
    v, a, found = 0.0, 0.0, []
    for _ in range(4000):
        asked = rate(approach(v, a, acceleration, jerk, share), error) / 0.3
        low, up = (max(-acceleration, a - jerk * T), min(acceleration, a + jerk * T))
        a = float(np.clip((asked - v) / T, low, up))
        v += T * a
        error += 0.3 * T * v
        found.append(error)
    return np.array(found)


@pytest.mark.parametrize("jerk", [np.inf, 2000.0, 40.0])
@pytest.mark.parametrize("start", [0.1, 0.01, 1e-3])
def test_an_error_ends_at_zero_without_overshoot_where_proportion_would_overshoot(
    start: float, jerk: float
) -> None:
    found = settled(start, 2.0, jerk, 0.8)
    assert found.min() > -0.01 * start
    assert abs(found[-1]) < 1e-6
    if start == 0.1:
        assert settled(start, 2.0, jerk, 0.0).min() < -0.2 * start
