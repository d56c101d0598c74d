"""Measures over time: on runs made by hand, and against an oracle that reads the file alone."""

from __future__ import annotations

import dataclasses
import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose
from metrics_oracle import metrics_of

from rcmqp import (
    Metrics,
    Run,
    RunFile,
    compute_metrics,
    load_scenario,
    make_controller,
    simulate,
)
from rcmqp.cli.results import _after_the_stop, _path_end, warnings
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.governor import Governor
from rcmqp.references.operators import CameraTrial
from rcmqp.references.paths import Foreign, ViewSteps
from rcmqp.runs.behaviour import LEAST_REST, Behaviour, growth, standstill, streaks
from rcmqp.runs.vocabulary import AFTER_THE_STOP

T = 0.05
LIMIT = np.array([0.5, 4.0])
ROWS = 41


@functools.cache
def still() -> Run:
    """A run of two seconds in which nothing is asked for and nothing moves."""
    scenario = load_scenario("view_steps", duration=T * (ROWS - 1), period=T)
    run = simulate(scenario, make_controller("dual_quaternion", scenario.insertion(), T, gain=1.0))
    zeros = np.zeros((ROWS, 2))
    pairs = dict.fromkeys(("angles", "v", "v_actual", "v_measured", "q", "q_measured"), zeros)
    two = dict.fromkeys(("lower", "upper", "acceleration_limit", "jerk_limit"), np.full(2, np.inf))
    pose = {"x": dq.from_translation(np.zeros((ROWS, 3))), "pivot": np.zeros((ROWS, 3))}
    rows = run.rows() | pairs | pose | {"x_d": pose["x"]}
    rows |= dict.fromkeys(("tip", "tip_d"), np.zeros((ROWS, 3)))
    run = dataclasses.replace(run, **two, velocity_limit=LIMIT)  # type: ignore[arg-type]
    return run.with_rows(rows, {}, {})


def asked(tip_d: Array, tip: Array | None = None, **rows: Array) -> Run:
    """The run with these rows; the desired pose goes along with the desired tip."""
    run, tip = still(), tip_d if tip is None else tip
    rows = {"x_d": dq.from_translation(tip_d), "tip_d": tip_d, "tip": tip} | rows
    rows["tip_error"] = np.linalg.norm(tip - tip_d, axis=1)
    return run.with_rows(run.rows() | {name: x.copy() for name, x in rows.items()}, {}, {})


def along(x: list[float]) -> Array:
    """Points (n, 3) on an oblique line [m], from millimetres."""
    return 1e-3 * np.outer(x, np.array([2.0, -1.0, 2.0]) / 3.0)


def stopping_at_20(tip: list[float]) -> Run:
    """A reference that stops at row 20, 10 mm on, and a tip that is there in these mm."""
    reference = [0.5 * k for k in range(20)] + [10.0] * (ROWS - 20)
    return asked(along(reference), along(reference[:20] + tip + [10.0] * (ROWS - 20 - len(tip))))


# Joints that turn round --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("v", "in_a_row", "reversals"),
    [
        ([[0.1, 0], [0.2, 0], [0.1, 0]], 0, 0),
        ([[0.1, 0], [-0.1, 0], [-0.2, 0]], 1, 1),
        ([[0.1, 0], [-0.1, 0], [0.1, 0], [-0.2, 0], [-0.2, 0], [0.1, 0]], 3, 4),
        ([[0.1, 0], [0.004, 0], [-0.1, 0]], 0, 0),  # slowly through zero
        ([[0.1, 0], [-0.0049, 0], [0.1, 0]], 0, 0),  # 0.98 % of its limit
        ([[0.1, 0], [-0.0051, 0], [0.1, 0]], 2, 2),
        ([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, 0.1], [0.2, -0.1]], 3, 4),
        ([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1]], 1, 2),  # one joint after the other
        ([[0.1, 0.1], [-0.1, -0.1]], 1, 1),  # both at once: one cycle
    ],
)
def test_reversals_are_counted_joint_by_joint(
    v: list[list[float]], in_a_row: int, reversals: int
) -> None:
    rows = np.zeros((ROWS, 2))
    rows[3 : 3 + len(v)] = v
    found = compute_metrics(asked(np.zeros((ROWS, 3)), v=rows))
    assert (found.reversals_in_a_row, found.reversals) == (in_a_row, reversals)


def test_a_streak_goes_on_from_what_was_before() -> None:
    turned = np.array([[True, True, False], [True, False, True], [True, True, True]])
    found = streaks(turned, np.array([5, 5, 5]))
    assert found.tolist() == [[6, 6, 0], [7, 0, 1], [8, 1, 2]]


def test_the_largest_step_is_over_the_joints_own_limit_and_counts_from_rest() -> None:
    v = np.zeros((ROWS, 2))
    v[0] = 0.1, 1.6  # 0.2 and 0.4 of the limit, from rest
    v[1:] = 0.3, 1.2  # 0.4 and 0.1
    assert_allclose(compute_metrics(asked(np.zeros((ROWS, 3)), v=v)).step_ratio_max, 0.4)
    v[7, 1] = -2.0  # 0.8, and back
    assert_allclose(compute_metrics(asked(np.zeros((ROWS, 3)), v=v)).step_ratio_max, 0.8)


# When it has stopped -----------------------------------------------------------------------


def test_the_reference_stops_where_it_last_changes() -> None:
    found = compute_metrics(stopping_at_20([]))
    assert found.reference_end_s == pytest.approx(20 * T, abs=1e-15)
    turning = still().x_d.copy()
    turning[:15] = dq.from_rotation(dq.rotation([0.0, 0.0, 1.0], 1e-9))
    run = asked(np.zeros((ROWS, 3)), x_d=turning)
    assert compute_metrics(run).reference_end_s == pytest.approx(15 * T, abs=1e-15)
    other_sign = turning * np.where(np.arange(ROWS) % 2, 1.0, -1.0)[:, None]
    assert compute_metrics(asked(np.zeros((ROWS, 3)), x_d=other_sign)) == compute_metrics(run)


def test_a_reference_that_moves_to_the_end_does_not_stop() -> None:
    least = round(LEAST_REST / T)
    for moving in (0, 1, least - 1, least):
        tip_d = along([*map(float, range(ROWS - moving)), *[ROWS - moving - 1.0] * moving])
        run = asked(tip_d)
        found = dataclasses.asdict(compute_metrics(run))
        assert [math.isnan(found[name]) for name in AFTER_THE_STOP] == [moving < least] * 4
        assert bool(_after_the_stop(compute_metrics(run))) == (moving == least)


def test_a_view_on_a_moving_trocar_stops_seen_from_the_trocar() -> None:
    """Then the tip may settle, but the joints have no rest, and the tip no last place."""
    pivot = along([float(k) for k in range(ROWS)])
    run = asked(pivot, pivot + along([2.0] * 5 + [0.5] * (ROWS - 5)), pivot=pivot)
    found = compute_metrics(run)
    assert found.reference_end_s == 0.0
    assert found.settling_time_s == pytest.approx(5 * T, abs=1e-15)
    assert math.isnan(found.swing_ratio_end)
    assert math.isnan(found.overshoot_max_mm)
    text = "\n".join(_after_the_stop(found))
    assert "0.000 s; tip error below 1 mm for good after 0.250 s" in text
    assert "swing" not in text


def test_a_trocar_that_stops_later_than_the_view_delays_the_rest() -> None:
    pivot = along([float(min(k, 25)) for k in range(ROWS)])
    stop = standstill(dq.from_translation(pivot), pivot)
    assert (stop.rows, stop.reference, stop.trocar, stop.both) == (ROWS, 0, 25, 25)
    assert standstill(dq.from_translation(0.0 * pivot), pivot).reference == 25


@pytest.mark.parametrize("missing", [3, 30])
def test_a_reference_that_is_missing_moves(missing: int) -> None:
    x_d = still().x_d.copy()
    x_d[missing] = np.nan
    assert standstill(x_d, still().pivot).reference == missing + 1


def test_the_stop_is_found_in_any_block(monkeypatch: pytest.MonkeyPatch) -> None:
    run = stopping_at_20([])
    pivot = along([float(min(k, 4)) for k in range(ROWS)])
    for block in (1, 7, 10, 100):
        monkeypatch.setattr("rcmqp.runs.behaviour.BLOCK", block)
        stop = standstill(run.x_d, pivot)
        assert (stop.reference, stop.trocar) == (20, 4)


# Rest --------------------------------------------------------------------------------------


def test_the_swing_is_that_of_the_last_second_after_the_stop() -> None:
    v = np.zeros((ROWS, 2))
    v[ROWS - 22] = 0.5, -4.0  # more than a second before the end
    v[ROWS - 21 :: 2, 0] = 0.05
    v[ROWS - 3, 1] = -0.6  # of 4.0, more than 0.05 of 0.5
    found = compute_metrics(asked(np.zeros((ROWS, 3)), v=v))
    assert_allclose(found.swing_ratio_end, 0.15)
    v[ROWS - 21, 0] = -0.05
    assert_allclose(compute_metrics(asked(np.zeros((ROWS, 3)), v=v)).swing_ratio_end, 0.2)
    tip_d = along([float(min(k, ROWS - 4)) for k in range(ROWS)])  # stops after these
    assert_allclose(compute_metrics(asked(tip_d, v=v)).swing_ratio_end, 0.15)


def test_a_constant_speed_is_no_swing() -> None:
    found = compute_metrics(asked(np.zeros((ROWS, 3)), v=np.full((ROWS, 2), 0.3)))
    assert found.swing_ratio_end == 0.0


@pytest.mark.parametrize(
    ("tip", "overshoot"),
    [
        ([], 0.0),
        ([4.0, 6.0, 8.0, 9.0, 9.5, 10.0], 0.0),  # it approaches
        ([4.0, 8.0, 10.0, 14.0, 19.0, 16.0, 12.0, 10.5], 9.0),  # 9 mm past the end and back
        ([4.0, 8.0, 19.0, 8.0], 9.0),  # never near the end on its way
        ([19.0, 12.0, 8.0, 8.5], 2.0),  # it was past the end when the reference stopped
        ([10.0, 10.0, 10.7, 10.0], 0.7),  # it was there, and goes
        ([10.0, 9.5, 10.0], 0.5),
        ([9.9, 9.95, 9.2, 10.0], 0.75),  # from 0.05 away to 0.8, on the side it came from
        ([4.0, 6.0, 3.0, 8.0, 10.0], 0.0),  # not there yet
        ([19.0, 25.0, 12.0, 10.0], 0.0),
    ],
)
def test_overshoot_is_how_far_past_its_end_or_away_again_the_tip_goes(
    tip: list[float], overshoot: float
) -> None:
    found = compute_metrics(stopping_at_20(tip)).overshoot_max_mm
    assert_allclose(found, overshoot, rtol=0, atol=1e-12)


def test_overshoot_to_the_side_counts_once_the_tip_has_been_there() -> None:
    end = np.tile([0.0, 0.0, 0.1], (ROWS, 1))
    tip = end.copy()
    tip[:10, 0] = -5e-3
    tip[20:25, 1] = 3e-3  # across the approach
    assert_allclose(compute_metrics(asked(end, tip)).overshoot_max_mm, 3.0)
    tip[10:, 2] += 2e-3  # never nearer than 2 mm: all of it is on the way
    assert compute_metrics(asked(end, tip)).overshoot_max_mm == pytest.approx(0.0, abs=1e-12)


def test_growth_is_from_the_least_distance_so_far() -> None:
    assert growth(np.array([5.0, 2.0, 4.0, 1.0, 2.5])) == (2.0, 1.0)
    assert growth(np.array([3.0, 2.0]), 0.5) == (2.5, 0.5)
    assert growth(np.array([])) == (0.0, math.inf)


@pytest.mark.parametrize(
    ("tip", "cycles"),
    [
        ([], 0),
        ([10.99, 10.99], 0),  # below 1 mm all along
        ([8.0, 8.5, 9.5], 2),
        ([8.0, 9.5, 12.0, 9.5], 3),  # not for good
        ([8.0] * (ROWS - 20), math.inf),
        ([10.0] * (ROWS - 21) + [8.0], math.inf),
        ([8.0] * (ROWS - 21) + [10.0], ROWS - 21),
    ],
)
def test_settling_is_the_time_until_the_tip_is_within_1_mm_for_good(
    tip: list[float], cycles: float
) -> None:
    run = stopping_at_20(tip)
    found = compute_metrics(run)
    assert found.settling_time_s == pytest.approx(cycles * T, abs=1e-15)
    word = "never for good" if math.isinf(cycles) else f"for good after {cycles * T:.3f} s"
    assert _after_the_stop(found)[0].endswith(f"tip error below 1 mm {word}")


# After the end of the path -----------------------------------------------------------------


def test_rest_after_the_path_is_not_averaged_in_and_is_said() -> None:
    usual = load_scenario("conical_helix", period=8e-3, duration=20.0)
    longer = load_scenario("conical_helix", period=8e-3, duration=60.0)
    run, long = (
        simulate(scenario, make_controller("dual_quaternion", scenario.insertion(), 8e-3))
        for scenario in (usual, longer)
    )
    found, rested = compute_metrics(run), compute_metrics(long)
    for field in dataclasses.fields(Metrics):
        if any(word in field.name for word in ("_rms_", "_p95_", "errors_until")):
            value = getattr(rested, field.name)
            assert_allclose(value, getattr(found, field.name), rtol=1e-13, err_msg=field.name)
    assert found.errors_until_s == 20.0
    assert rested.saturated_share <= found.saturated_share
    assert _path_end(found) == []
    (line,) = _path_end(rested)
    assert "at 20 s: rms and 95 % are until then, max is of all 60 s" in line


def test_the_largest_error_counts_to_the_end_of_the_run() -> None:
    error = np.zeros(ROWS)
    error[-1] = 3e-3
    run = still()
    path = ViewSteps(views=((0.0, 0.0, 0.0, 0.0),), dwell=1.0)
    scenario = dataclasses.replace(run.scenario, path=path)
    run = dataclasses.replace(run, scenario=scenario, tip_error=error)
    found = compute_metrics(run)
    assert (found.errors_until_s, found.tip_rms_mm, found.tip_p95_mm) == (1.0, 0.0, 0.0)
    assert found.tip_max_mm == 3.0
    settling = dataclasses.replace(run, x_d=stopping_at_20([]).x_d)  # it moves until 1 s
    assert compute_metrics(settling).errors_until_s == 1.0
    x_d = run.x_d.copy()
    x_d[:30] = dq.from_translation([0.0, 0.0, 0.01])  # a planner that is late
    assert compute_metrics(dataclasses.replace(run, x_d=x_d)).errors_until_s == 1.5
    moving = dataclasses.replace(run, pivot=along([float(k) for k in range(ROWS)]))
    assert compute_metrics(moving).errors_until_s == 2.0


def test_settling_after_the_last_view_is_part_of_the_path() -> None:
    scenario = load_scenario("view_steps", period=8e-3)
    run = simulate(scenario, make_controller("dual_quaternion", scenario.insertion(), 8e-3))
    found = compute_metrics(run)
    assert found.errors_until_s == run.time[-1] == scenario.path.duration
    assert 8.9 < found.reference_end_s < 9.1


def test_a_steered_run_is_of_one_piece() -> None:
    """Its path's duration is only the most that it may take."""
    scenario = dataclasses.replace(still().scenario, path=CameraTrial(duration=1.0))
    run = dataclasses.replace(stopping_at_20([]), scenario=scenario)
    assert compute_metrics(run).errors_until_s == run.time[-1]


def test_a_path_of_which_only_numbers_are_known_lasts_to_the_end_or_as_these_say() -> None:
    for numbers, end in (({}, T * (ROWS - 1)), ({"duration": 1.5}, 1.5)):
        scenario = dataclasses.replace(still().scenario, path=Foreign("mine", numbers))
        run = dataclasses.replace(still(), scenario=scenario)
        assert compute_metrics(run).errors_until_s == pytest.approx(end, abs=1e-15)


# Together ----------------------------------------------------------------------------------

RUNS: dict[str, tuple[str, str, str, dict[str, Any]]] = {
    "goes on": ("conical_helix", "ur5", "pose_error", {"duration": 23.0, "period": 8e-3}),
    "too fast": ("fast_helix", "lwa3", "hierarchical_qp", {"period": 4e-3}),
    "jumps": ("view_steps", "panda", "damped", {"period": 8e-3, "planner_time": None}),
    "off": ("trocar_off_shaft", "xarm7", "weighted_qp", {"period": 8e-3}),
    "trocar moves": ("trocar_2cm_05hz", "z1", "task_priority", {"period": 8e-3}),
    "obstacle": ("obstacle", "lwa3", "hierarchical_qp", {"period": 4e-3}),
    "past its end": ("view_steps", "lwa3", "weighted_qp", {"period": 8e-3, "planner_time": None}),
    "late": ("fast_helix", "lwa3", "hierarchical_qp", {"period": 4e-3, "governor": Governor()}),
    "rattles": ("fast_helix", "meka_a2", "vfi_qp", {"period": 2e-3}),
}

OPTIONS = {"rattles": {"joint_gain": 1.0}}
"""Of the controllers of some runs."""


@functools.cache
def example(name: str) -> Run:
    scenario_name, arm, controller, changes = RUNS[name]
    scenario = load_scenario(scenario_name, arm, **changes)
    insertion, options = scenario.insertion(), OPTIONS.get(name, {})
    return simulate(scenario, make_controller(controller, insertion, scenario.period, **options))


@pytest.mark.parametrize("name", list(RUNS))
def test_an_oracle_that_reads_the_file_alone_finds_the_same(name: str, tmp_path: Path) -> None:
    example(name).save(tmp_path / "run.h5")
    with RunFile(tmp_path / "run.h5") as file:
        found = dataclasses.asdict(compute_metrics(file))
    expected = metrics_of(tmp_path / "run.h5")
    assert found.keys() == expected.keys()
    for metric, value in expected.items():
        assert_allclose(found[metric], value, rtol=1e-8, atol=1e-8, err_msg=metric)


def test_the_examples_show_every_measure() -> None:
    found = {name: compute_metrics(example(name)) for name in RUNS}
    assert found["goes on"].errors_until_s == 20.0
    assert found["too fast"].overshoot_max_mm < 1.0 < found["too fast"].tip_max_mm
    assert 0.0 < found["jumps"].settling_time_s < 1.0
    assert found["rattles"].reversals_in_a_row > 2
    assert math.isnan(found["trocar moves"].overshoot_max_mm)
    assert any("turned round" in text for text in warnings(example("rattles"), found["rattles"]))


@pytest.mark.parametrize("size", [1, 3, 100, 10_000])
@pytest.mark.parametrize("name", ["too fast", "jumps", "rattles"])
def test_the_measures_do_not_depend_on_the_parts_to_the_bit(name: str, size: int) -> None:
    run = example(name)
    stop = standstill(run.x_d, run.pivot)

    def summed(size: int) -> dict[str, float]:
        behaviour = Behaviour(stop, run.period)
        for part in run.parts(size):
            behaviour.add(part.v, part.velocity_limit, part.tip, part.tip_d)
        return behaviour.summary()

    assert summed(size) == summed(4096)
    assert summed(size).items() <= dataclasses.asdict(compute_metrics(run)).items()
