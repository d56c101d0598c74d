"""Motions of the trocar: from rest, and their velocities the derivatives of their positions."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose, derivative
from scipy.interpolate import CubicHermiteSpline

from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.instrument import Vector3
from rcmqp.world.motions import MOTIONS, Breathing, Motion, Sampled, Sinusoid, Still


def recording(times: Array) -> Sampled:
    rng = np.random.default_rng(7)
    positions: list[Vector3] = [tuple(p) for p in rng.normal(scale=0.01, size=(len(times), 3))]
    return Sampled(tuple(times), tuple(positions))


TIMES = np.array([0.0, 0.7, 1.1, 2.4, 2.5, 3.6])
SAMPLES: dict[str, Motion] = {  # one of each motion that is registered
    "breathing": Breathing(amplitude=0.008, rate=0.4, direction=(1.0, 2.0, -2.0)),
    "sampled": recording(TIMES),
    "sinusoid": Sinusoid(amplitude=0.02, frequency=0.7, direction=(0.0, 3.0, 4.0), ramp=1.3),
    "still": Still(),
}
every_motion = pytest.mark.parametrize("name", sorted(MOTIONS))


# Every motion ------------------------------------------------------------------------------


@every_motion
def test_every_motion_is_tested_here_and_keeps_to_the_protocol(name: str) -> None:
    motion = SAMPLES[name]
    assert type(motion) is MOTIONS[name]
    assert isinstance(motion, Motion)
    assert hash(motion) == hash(dataclasses.replace(motion))  # type: ignore[type-var]


@every_motion
def test_velocity_is_the_derivative_of_position(name: str) -> None:
    rng = np.random.default_rng(7)
    motion = SAMPLES[name]
    for t in rng.uniform(0.01, 5.0, 100):
        if name == "sampled" and np.abs(TIMES - t).min() < 2e-3:
            continue  # the second derivative jumps at the samples

        def position(s: float, t: float = t) -> Array:
            return motion.position(t + s)

        assert_allclose(motion.velocity(t), derivative(position), rtol=0, atol=1e-10)


@every_motion
def test_a_motion_starts_from_rest_where_the_trocar_is(name: str) -> None:
    motion = SAMPLES[name]
    for t in (0.0, -1.0):
        assert_allclose(motion.position(t), np.zeros(3), rtol=0, atol=0)
        assert_allclose(motion.velocity(t), np.zeros(3), rtol=0, atol=0)
    assert np.linalg.norm(motion.velocity(1e-4)) < 1e-4  # no jump of the velocity


@every_motion
def test_what_a_motion_gives_is_the_callers_own(name: str) -> None:
    motion = SAMPLES[name]
    for function in (motion.position, motion.velocity):
        first = function(1.234)
        assert first.shape == (3,)
        kept = first.copy()
        first[:] = np.nan
        assert np.array_equal(function(1.234), kept)


# One by one --------------------------------------------------------------------------------


def test_a_sinusoid_is_a_sine_of_its_amplitude_once_it_has_grown() -> None:
    motion = Sinusoid(amplitude=0.02, frequency=0.5, direction=(0.0, 3.0, -4.0), ramp=2.0)
    for t in np.linspace(2.0, 6.0, 41):
        expected = 0.02 * math.sin(math.pi * t) * np.array([0.0, 0.6, -0.8])
        assert_allclose(motion.position(t), expected, rtol=0, atol=1e-16)
    speeds = [np.linalg.norm(motion.velocity(t)) for t in np.linspace(2.0, 4.0, 2001)]
    assert max(speeds) == pytest.approx(2 * math.pi * 0.5 * 0.02, rel=1e-6)


def test_a_sinusoid_grows_to_half_of_its_amplitude_in_half_of_its_ramp() -> None:
    motion = Sinusoid(amplitude=0.02, frequency=0.25, ramp=2.0)
    assert_allclose(motion.position(1.0), [0.0, 0.0, 0.01], rtol=0, atol=1e-16)


def test_a_breath_goes_out_and_back_by_the_amplitude_and_rests_longest_at_its_end() -> None:
    motion = Breathing(amplitude=0.01, rate=0.25, direction=(0.0, 0.0, 2.0), n=3)
    heights = [motion.position(t)[2] for t in np.linspace(0.0, 4.0, 4001)]
    assert max(heights) == heights[2000] == pytest.approx(0.01, abs=1e-16)
    assert min(heights) == 0.0
    assert heights[-1] == pytest.approx(0.0, abs=1e-17)
    assert np.mean(np.array(heights) < 0.001) > 2 * np.mean(np.array(heights) > 0.009)
    for t in (0.3, 1.1, 3.3):  # Lujan's own form, with phi = pi / 2
        lujan = 0.01 * math.cos(math.pi * t / 4.0 - math.pi / 2) ** 6
        assert_allclose(motion.position(t), [0.0, 0.0, lujan], rtol=0, atol=1e-16)
        assert_allclose(motion.position(t + 4.0), motion.position(t), rtol=0, atol=1e-16)


def test_a_recording_passes_through_its_samples_on_a_cubic_hermite_spline() -> None:
    motion = recording(TIMES)
    assert isinstance(motion, Sampled)
    p = np.array(motion.positions) - motion.positions[0]
    slopes = np.zeros_like(p)
    for i in range(1, len(TIMES) - 1):  # of the parabola through three samples
        parabola = np.polyfit(TIMES[i - 1 : i + 2] - TIMES[i], p[i - 1 : i + 2], 2)
        slopes[i] = parabola[1]
    spline = CubicHermiteSpline(TIMES, p, slopes)
    for t in (*TIMES, *np.linspace(0.0, 3.6, 50)):
        assert_allclose(motion.position(t), spline(t), rtol=0, atol=1e-15)
        assert_allclose(motion.velocity(t), spline(t, 1), rtol=0, atol=1e-14)


def test_a_recording_stays_where_it_ends_and_starts_where_it_begins() -> None:
    motion = Sampled((0.5, 1.0, 2.0), ((1.0, 2.0, 3.0), (1.1, 2.0, 3.0), (1.0, 2.5, 3.0)))
    for t in (0.0, 0.5):
        assert not motion.position(t).any()
        assert not motion.velocity(t).any()
    for t in (2.0, 9.0):
        assert_allclose(motion.position(t), [0.0, 0.5, 0.0], rtol=0, atol=1e-15)
        assert not motion.velocity(t).any()


def test_a_recording_takes_lists_and_arrays() -> None:
    array = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    motion = Sampled([0, 1], array)  # type: ignore[arg-type]
    assert motion == Sampled((0.0, 1.0), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))


# Refusals ----------------------------------------------------------------------------------

ZERO: Vector3 = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        ("sinusoid", {"amplitude": -0.01}, "amplitude = -0.01 m"),
        ("sinusoid", {"amplitude": math.nan}, "amplitude = nan m"),
        ("sinusoid", {"frequency": 0.0}, "frequency = 0.0 Hz, it must be positive"),
        ("sinusoid", {"frequency": math.inf}, "frequency = inf Hz"),
        ("sinusoid", {"ramp": 0.0}, "ramp = 0.0 s, it must be positive"),
        ("sinusoid", {"ramp": math.nan}, "ramp = nan s"),
        ("sinusoid", {"direction": ZERO}, "direction = .* not all zero"),
        ("sinusoid", {"direction": (math.nan, 0.0, 0.0)}, "direction = .* three finite"),
        ("breathing", {"amplitude": math.inf}, "amplitude = inf m"),
        ("breathing", {"amplitude": -1.0}, "amplitude = -1.0 m"),
        ("breathing", {"rate": 0.0}, "rate = 0.0 Hz"),
        ("breathing", {"rate": math.nan}, "rate = nan Hz"),
        ("breathing", {"n": 0}, "n = 0, it must be a whole number"),
        ("breathing", {"n": 1.5}, "n = 1.5, it must be a whole number"),
        ("breathing", {"n": math.nan}, "n = nan, it must be a whole number"),
        ("breathing", {"direction": (1.0, 0.0)}, "direction = .* three finite"),
        ("sampled", {"times": (0.0,), "positions": (ZERO,)}, "1 times; a motion needs two"),
        ("sampled", {"times": (0.0, 1.0), "positions": (ZERO,)}, "2 times and 1 positions"),
        (
            "sampled",
            {"times": (0.0, 2.0, 1.0), "positions": (ZERO, ZERO, ZERO)},
            r"times\[2\] = 1.0 s after 2.0 s; sort the samples",
        ),
        ("sampled", {"times": (0.0, 1.0, 1.0), "positions": (ZERO, ZERO, ZERO)}, "taken twice"),
        ("sampled", {"times": (0.0, math.nan), "positions": (ZERO, ZERO)}, r"times\[1\] = nan"),
        ("sampled", {"times": (0.0, math.inf), "positions": (ZERO, ZERO)}, "times must be finite"),
        (
            "sampled",
            {"times": (-1.0, 1.0), "positions": (ZERO, ZERO)},
            "count from the run.s start",
        ),
        (
            "sampled",
            {"times": (0.0, 1.0), "positions": (ZERO, (0.0, math.nan, 0.0))},
            r"positions\[1\] = .* three finite",
        ),
    ],
)
def test_motions_that_make_no_sense_are_refused(
    kind: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(OptionError, match=message):
        MOTIONS[kind](**options)
