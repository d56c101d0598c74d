"""Smoothness of a speed: what is known of simple movements."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp.runs.behaviour import log_dimensionless_jerk, sparc


def test_smoother_movements_have_larger_measures() -> None:
    t, T = np.arange(0.0, 2.0, 1e-3), 1e-3
    s = t / 2.0
    bell = 30.0 * s**2 * (1.0 - s) ** 2
    shaken = bell * (1.0 + 0.2 * np.sin(2.0 * np.pi * 6.0 * t))
    assert sparc(shaken, T) < sparc(bell, T) < -1.0
    assert log_dimensionless_jerk(shaken, T) < log_dimensionless_jerk(bell, T)
    assert_allclose(sparc(3.0 * bell, T), sparc(bell, T))  # of its shape, not its size
    assert_allclose(log_dimensionless_jerk(3.0 * bell, T), log_dimensionless_jerk(bell, T))


def test_the_jerk_of_a_parabola_is_known() -> None:
    """v = s (1 - s), s in [0, 1]: v'' = -2, peak 1/4, so T^3 / peak^2 * 4 = 64."""
    s = np.linspace(0.0, 1.0, 2001)
    assert_allclose(log_dimensionless_jerk(s * (1.0 - s), s[1]), -math.log(64.0), rtol=1e-3)


def test_no_movement_is_smooth() -> None:
    assert sparc(np.zeros(50), 0.01) == log_dimensionless_jerk(np.zeros(50), 0.01) == 0.0


@pytest.mark.parametrize("speed", [[], [1.0], [1.0, 2.0], [1.0, np.nan, 2.0, 1.0]])
def test_smoothness_of_too_little_is_missing(speed: list[float]) -> None:
    for measure in (sparc, log_dimensionless_jerk):
        assert math.isnan(measure(np.array(speed), 0.01))
        assert not math.isnan(measure(np.array([1.0, 2.0, 1.0]), 0.01))
