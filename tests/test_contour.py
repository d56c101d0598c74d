"""Distance from the path and lag, against all points of the path one by one."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import Run, compute_metrics, load_scenario, make_controller, simulate
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs import metrics as contours
from rcmqp.runs.metrics import Contour

T = 1e-3
FINE = 40
"""Points on each line of the curve that the oracle looks at."""


@pytest.fixture(scope="module")
def short() -> Run:
    scenario = load_scenario("conical_helix", duration=0.01, period=T)
    return simulate(scenario, make_controller("dual_quaternion", scenario.insertion(), T))


def with_tips(run: Run, tip: Array, tip_d: Array, pivot: Array | None = None) -> Run:
    """A run of n instants whose tip and desired tip (n, 3) are given."""
    pivot = np.zeros_like(tip) if pivot is None else pivot
    time = T * np.arange(len(tip), dtype=float)
    return dataclasses.replace(run, time=time, tip=tip, tip_d=tip_d, pivot=pivot, path_time=time)


def measured(run: Run, size: int = 4096) -> dict[str, Array]:
    contour = Contour(run)
    found = [contour.measure(part) for part in run.parts(size)]
    return {name: np.concatenate([each[name] for each in found]) for name in found[0]}


def curves(rng: np.random.Generator) -> Iterator[tuple[str, Array]]:
    u = np.linspace(0.0, 1.0, 300)[:, None]
    turn = 2.0 * np.pi * u
    zero = np.zeros_like(u)
    yield "helix", 0.02 * np.hstack([np.cos(3 * turn), np.sin(3 * turn), u])
    yield "figure of eight", 0.02 * np.hstack([np.sin(turn), np.sin(2 * turn), zero])
    yield "out and back", 0.02 * np.hstack([np.sin(np.pi * u), zero, zero])
    yield "jumps", np.repeat(rng.normal(scale=0.02, size=(6, 3)), 50, axis=0)
    yield "rest, shaken by rounding", 0.02 + rng.normal(scale=1e-17, size=(300, 3))
    yield "wild", rng.normal(scale=0.02, size=(300, 3))
    yield "one point", np.full((1, 3), 0.01)


CURVES = dict(curves(np.random.default_rng(7)))


@pytest.mark.parametrize("off", [0.0, 1e-4, 0.02])
@pytest.mark.parametrize("name", CURVES)
def test_the_distance_is_that_of_the_nearest_of_all_points_of_the_curve(
    name: str, off: float, short: Run
) -> None:
    curve, rng = CURVES[name], np.random.default_rng(11)
    tip = np.roll(curve, 20, axis=0) + rng.normal(scale=off, size=curve.shape)
    found = measured(with_tips(short, tip, curve))["contour"]
    share = np.linspace(0.0, 1.0, FINE + 1)[:, None, None]
    before, after = curve[:-1], curve[1:]
    points = np.concatenate([((1 - share) * before + share * after).reshape(-1, 3), curve])
    dense = np.array([np.linalg.norm(points - p, axis=1).min() for p in tip])
    gap = np.linalg.norm(after - before, axis=1).max(initial=0.0) / FINE
    assert np.all(found <= dense + 1e-11)
    assert np.all(dense <= found + 0.5 * gap + 1e-11)


@pytest.mark.parametrize("size", [1, 7, 64])
@pytest.mark.parametrize("name", CURVES)
def test_neither_distance_nor_lag_depends_on_the_parts(
    name: str, size: int, short: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the bit; nor on how many rows of the curve are read at once."""
    curve, rng = CURVES[name], np.random.default_rng(11)
    tip = np.roll(curve, 20, axis=0) + rng.normal(scale=1e-3, size=curve.shape)
    run = with_tips(short, tip, curve)
    whole = measured(run)
    monkeypatch.setattr(contours, "PART", size)
    found = measured(run, size)
    assert np.array_equal(found["contour"], whole["contour"])
    assert np.array_equal(found["lag"], whole["lag"])


def test_a_trocar_that_moves_takes_the_curve_along(short: Run) -> None:
    curve, rng = CURVES["helix"], np.random.default_rng(7)
    tip = curve + rng.normal(scale=1e-3, size=curve.shape)
    swing = 0.03 * np.sin(np.linspace(0.0, 20.0, len(curve)))[:, None] * np.array([1.0, 2.0, 0.0])
    still = measured(with_tips(short, tip, curve))
    moving = measured(with_tips(short, tip + swing, curve + swing, pivot=swing))
    assert_allclose(moving["contour"], still["contour"], rtol=0, atol=1e-15)
    assert np.array_equal(moving["lag"], still["lag"])


@pytest.mark.parametrize("name", ["helix", "figure of eight", "out and back"])
def test_a_tip_that_repeats_the_path_later_is_late_by_that_and_not_beside_it(
    name: str, short: Run
) -> None:
    """Over crossings, too; where the path goes back on its own line, the later pass counts."""
    curve = np.concatenate([CURVES[name], np.repeat(CURVES[name][-1:], 40, axis=0)])
    tip = np.concatenate([np.repeat(curve[:1], 25, axis=0), curve[:-25]])
    found = measured(with_tips(short, tip, curve))
    assert found["contour"].max() < 1e-15
    late = found["lag"][26:299]
    if name == "out and back":
        assert late.max() < 26.5 * T
        late = np.delete(late, range(130, 170))  # about the turn
    assert_allclose(late, 25 * T, rtol=0, atol=1.5 * T)
    assert not found["lag"][-15:].any()


def test_a_path_that_waits_counts_as_late(short: Run) -> None:
    curve = CURVES["helix"]
    run = with_tips(short, curve, curve)
    run = dataclasses.replace(run, path_time=0.75 * run.time)
    assert_allclose(measured(run)["lag"], 0.25 * run.time, rtol=0, atol=1e-15)


def test_the_metrics_are_rms_and_largest_of_them() -> None:
    scenario = load_scenario("conical_helix", duration=5.0, period=T)
    run = simulate(scenario, make_controller("dual_quaternion", scenario.insertion(), T))
    found, metrics = measured(run), compute_metrics(run)
    assert 1e3 * found["contour"].max() == metrics.contour_max_mm
    assert_allclose(metrics.contour_rms_mm, 1e3 * np.sqrt(np.mean(found["contour"] ** 2)))
    assert metrics.lag_max_s == found["lag"].max()
    assert abs(metrics.lag_max_s - 1.0 / 60.0) < 1.5 * T  # the law's own, 1 / K
    assert 0.0 < metrics.contour_rms_mm < 0.1 * metrics.tip_rms_mm


def test_a_tip_that_is_missing_has_no_distance_and_a_gap_in_the_curve_is_passed(
    short: Run,
) -> None:
    curve = CURVES["helix"].copy()
    tip = curve + 1e-3
    whole = measured(with_tips(short, tip, curve))
    gone, gap = tip.copy(), curve.copy()
    gone[7, 1] = gap[100, 2] = gap[0, 0] = np.nan
    found = measured(with_tips(short, gone, curve))
    assert np.isnan(found["contour"][7])
    assert np.isnan(found["lag"][7])
    for name, values in found.items():
        assert np.array_equal(np.delete(values, 7), np.delete(whole[name], 7)), name
    held = curve.copy()
    held[100], held[0] = held[99], held[1]
    found, expected = (measured(with_tips(short, tip, each)) for each in (gap, held))
    for name, values in found.items():
        assert np.array_equal(values, expected[name]), name
    nothing = measured(with_tips(short, tip, np.full_like(curve, np.nan)))
    assert np.isnan(nothing["contour"]).all()


def test_what_a_kernel_is_given_must_fit(short: Run) -> None:
    from rcmqp import _kernel

    points, along = np.zeros((4, 3)), np.zeros(4)
    for wrong in (
        (points, points[:3].copy(), along, 0, 0),
        (points, points, along, 1, 0),
        (points, points, along, 0, 1),
        (points, points, along, -1, 0),
    ):
        with pytest.raises(ValueError, match=r"numbers|must be from"):
            _kernel.contour(*wrong)
