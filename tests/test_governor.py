"""A path that waits: its clock, what the controller is told, scenarios, files."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import Run, RunFile, Scenario, compute_metrics, load_scenario, make_controller, simulate
from rcmqp.errors import InsertionError, OptionError, RunFileError
from rcmqp.references.governor import Governed, Governor, PathClock
from rcmqp.references.paths import Circle, ViewMoves, ViewSteps
from rcmqp.references.view import Reference
from rcmqp.runs.recorder import Recorder
from rcmqp.runs.simulate import record, versions
from rcmqp.world.motions import Sinusoid

T = 1e-3


def governed(scenario: Scenario, **numbers: float) -> Scenario:
    return dataclasses.replace(scenario, governor=Governor(**numbers))


def run_of(scenario: Scenario, controller: str = "hierarchical_qp") -> Run:
    return simulate(scenario, make_controller(controller, scenario.insertion(), scenario.period))


def told(scenario: Scenario) -> tuple[Run, list[Reference], list[tuple[float, float]]]:
    """A run without noise; what its controller was told; the path's time and its rate then."""
    run, clock = run_of(scenario), scenario.clock()
    assert clock is not None
    insertion = scenario.insertion()
    ask = scenario.references(insertion, clock).send
    references, times = [ask(None)], [(clock.time, clock.rate)]
    for q in run.q[:-1]:
        references.append(ask(insertion.state(q)))
        times.append((clock.time, clock.rate))
    return run, references, times


@pytest.fixture(scope="module")
def too_fast() -> Scenario:
    """A helix that the UR5's joints cannot follow, in a trocar that moves."""
    motion = Sinusoid(amplitude=3e-3, frequency=1.0, ramp=0.3)
    return load_scenario("fast_helix", "ur5", motion=motion, acceleration=math.inf)


@pytest.fixture(scope="module")
def slowed(too_fast: Scenario) -> tuple[Run, list[Reference], list[tuple[float, float]]]:
    return told(governed(too_fast))


# The clock ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("distance", "rate"),
    [
        (0.0, 1.0),
        (1e-3, 1.0),
        (1.5e-3, 0.75),
        (2e-3, 0.5),
        (3e-3, 0.0),
        (9.0, 0.0),
        (math.inf, 0.0),
        (math.nan, 0.0),
    ],
)
def test_the_rate_falls_from_one_to_zero_between_two_distances(
    distance: float, rate: float
) -> None:
    assert Governor().rate(distance) == pytest.approx(rate, abs=1e-12)


def test_the_clock_goes_on_smoothly_never_back_and_never_before_real_time() -> None:
    """Whatever the tip does and however irregular the cycles are."""
    rng, governor = np.random.default_rng(7), Governor(slowing=0.04, recovery=0.3)
    clock, t = PathClock(governor), 0.0
    clock.advance(t)
    rates = [clock.rate]
    for _ in range(5000):
        if rng.random() < 0.05:
            clock.see(float(rng.choice([0.0, 1e-3, 2e-3, 1.0, math.nan, math.inf])))
        rate, time, step = clock.rate, clock.time, float(rng.exponential(2e-3))
        t += step
        clock.advance(t)
        assert 0.0 <= clock.rate <= 1.0
        assert time <= clock.time <= t
        assert -step / 0.04 - 1e-12 <= clock.rate - rate <= step / 0.3 + 1e-12
        assert_allclose(clock.time - time, 0.5 * step * (rate + clock.rate), rtol=0, atol=1e-13)
        rates.append(clock.rate)
    assert (min(rates), max(rates)) == (0.0, 1.0)


def test_a_clock_that_was_never_slowed_is_real_time_to_the_bit() -> None:
    clock = PathClock(Governor())
    for k in range(3000):
        clock.advance(k * T)
        clock.see(1e-3)
        assert clock.time == k * T


def test_an_earlier_time_changes_nothing_and_a_reset_begins_anew() -> None:
    clock = PathClock(Governor())
    for t in (0.0, 0.1):
        clock.advance(t)
        clock.see(1.0)
    before = (clock.time, clock.rate)
    clock.advance(0.05)
    assert (clock.time, clock.rate) == before
    clock.advance(0.2)
    assert clock.rate == 0.0
    clock.reset()
    clock.advance(0.01)
    assert (clock.time, clock.rate) == (0.01, 1.0)


# What the controller is told ---------------------------------------------------------------


@pytest.mark.parametrize("controller", ["dual_quaternion", "hierarchical_qp"])
@pytest.mark.parametrize("name", ["conical_helix", "breathing_trocar", "view_steps"])
def test_where_nothing_is_in_the_way_a_run_is_the_same_to_the_bit(
    name: str, controller: str
) -> None:
    """view_steps has its planner, which is what the tip is compared with."""
    scenario = load_scenario(name, duration=3.0)
    plain, other = run_of(scenario, controller), run_of(governed(scenario), controller)
    for channel, values in plain.rows().items():
        if channel != "solve_time":
            assert np.array_equal(other.rows()[channel], values), channel


def test_a_path_slows_down_where_the_arm_cannot_follow_and_the_tip_stays_near_it(
    too_fast: Scenario, slowed: tuple[Run, list[Reference], list[tuple[float, float]]]
) -> None:
    run, _, times = slowed
    plain, found = compute_metrics(run_of(too_fast)), compute_metrics(run)
    assert found.contour_max_mm < 0.5 * plain.contour_max_mm
    assert found.contour_rms_mm < 0.3 * plain.contour_rms_mm
    assert found.tip_max_mm < 0.5 * plain.tip_max_mm
    assert found.lag_max_s > 0.1
    time, rate = np.array(times).T
    assert np.array_equal(run.path_time, time)
    assert 0.0 < rate.min() < 0.7
    assert (rate[0], time[0]) == (1.0, 0.0)
    assert np.all(np.diff(time) >= 0.0)
    assert np.all(time <= run.time)


def test_what_is_told_of_the_velocity_is_the_derivative_of_what_is_told_of_the_pose(
    slowed: tuple[Run, list[Reference], list[tuple[float, float]]],
) -> None:
    """The poses' change in a cycle is the mean of both ends' derivatives times the period."""
    _, references, times = slowed
    rates = np.array(times)[:, 1]
    assert np.ptp(rates) > 0.3
    for before, now in itertools.pairwise(references):
        change = 0.5 * T * (before.x_d_dot + now.x_d_dot)
        assert_allclose(now.x_d - before.x_d, change, rtol=0, atol=1e-6)


def test_a_trocar_that_moves_is_not_slowed(
    too_fast: Scenario, slowed: tuple[Run, list[Reference], list[tuple[float, float]]]
) -> None:
    run, references, _ = slowed
    assert run.time[-1] - run.path_time[-1] > 0.1
    assert np.array_equal(run.pivot, too_fast.pivots())
    for k, reference in enumerate(references):
        assert_allclose(reference.pivot, run.pivot[k], rtol=0, atol=1e-15)
        assert np.array_equal(reference.pivot_dot, too_fast.motion.velocity(k * T))


def test_a_slowed_path_comes_to_rest_at_its_own_end(too_fast: Scenario) -> None:
    longer = dataclasses.replace(governed(too_fast), duration=2.0)
    run, references, times = told(longer)
    end = longer.path.duration
    assert times[round(end / T)][0] < end - 0.1 < end < times[-1][0]
    still = dataclasses.replace(longer, governor=None)
    *_, last = still.references(still.insertion())
    assert_allclose(references[-1].x_d, last.x_d, rtol=0, atol=1e-14)
    assert_allclose(references[-1].x_d_dot, last.x_d_dot, rtol=0, atol=1e-14)
    assert run.tip_error[-1] < 1e-5


def test_a_path_waits_for_a_tip_that_does_not_come() -> None:
    scenario = governed(load_scenario("circle", "panda", duration=3.0), free=2e-3, stop=5e-3)
    insertion = scenario.insertion()
    rest = insertion.state(insertion.q_start)
    ask = scenario.references(insertion).send
    references = [ask(None)] + [ask(rest) for _ in range(scenario.cycles - 1)]
    way = [float(np.linalg.norm(insertion.tip(x.x_d) - insertion.tip(rest.x))) for x in references]
    assert 4.9e-3 < way[-1] <= max(way) < 5.1e-3
    assert_allclose(references[-1].x_d_dot, 0.0, rtol=0, atol=1e-4)


def test_a_view_that_jumps_is_held_until_it_is_reached() -> None:
    """Its time counts from then on, but for the slow recovery."""
    path = ViewSteps(views=((0.0,) * 4, (0.3, 0.0, 0.0, 0.0), (0.3, 0.3, 0.0, 0.0)), dwell=0.1)
    scenario = load_scenario("view_steps", "ur5", path=path, planner_time=None, duration=3.0)
    run = run_of(governed(scenario, recovery=0.1))
    plain = run_of(scenario)
    jumps = [
        np.flatnonzero(np.linalg.norm(np.diff(each.tip_d, axis=0), axis=1) > 1e-3)
        for each in (plain, run)
    ]
    assert_allclose(T * (jumps[0] + 1), [0.1, 0.2], rtol=0, atol=1.5 * T)
    assert T * (jumps[1][1] + 1) > 0.3
    assert run.tip_error[jumps[1][1]] < 1e-3 < plain.tip_error[jumps[0][1]]


@pytest.mark.parametrize("planner_time", [None, 0.05])
def test_who_sends_nothing_is_told_what_is_told_without_a_governor(
    planner_time: float | None,
) -> None:
    scenario = load_scenario("fast_helix", "ur5", duration=0.3, planner_time=planner_time)
    with_one = governed(scenario)
    for plain, other in zip(
        scenario.references(scenario.insertion()),
        with_one.references(with_one.insertion()),
        strict=True,
    ):
        for field in dataclasses.fields(Reference):
            assert np.array_equal(getattr(plain, field.name), getattr(other, field.name))


def test_references_do_not_depend_on_how_many_are_made_at_once(
    too_fast: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = dataclasses.replace(governed(too_fast), duration=0.3, pivot_velocity="estimated")
    whole = run_of(scenario)
    assert whole.path_time[-1] < 0.299
    monkeypatch.setattr("rcmqp.runs.asked.BLOCK", 7)
    assert run_of(scenario).digest == whole.digest


def test_a_view_deeper_than_the_shaft_is_refused() -> None:
    path = ViewMoves(views=((0.0, 0.0, 0.0, 0.3),))
    scenario = load_scenario("view_steps", path=path, planner_time=None)
    with pytest.raises(InsertionError, match=r"the instrument is only 330\.0 mm long"):
        list(governed(scenario).references(scenario.insertion()))


# In loops ----------------------------------------------------------------------------------


def test_a_loop_of_ones_own_is_that_of_a_scenario() -> None:
    scenario = governed(load_scenario("fast_helix", "ur5", duration=0.5))
    run, insertion = run_of(scenario), scenario.insertion()
    controller = make_controller("hierarchical_qp", insertion, T)
    loop = Governed(scenario.path, insertion)  # type: ignore[arg-type]
    for _ in range(2):
        q, v, a = insertion.q_start, np.zeros(6), np.zeros(6)
        for k in range(scenario.cycles):
            reference = loop(k * T).reference
            state = insertion.state(q, v, a)
            loop.see(state)
            before, v = v, controller.step(state, reference).v
            q, a = insertion.arm.integrate(q, v, T), (v - before) / T
            assert np.array_equal(v, run.v[k])
            assert loop.clock.time == run.path_time[k]
        assert loop.clock.time < 0.49
        loop.reset()
        controller.reset()


def test_before_anything_is_told_there_is_nothing_to_compare() -> None:
    insertion = load_scenario("circle").insertion()
    loop = Governed(Circle(), insertion)
    loop.see(insertion.state(insertion.arm.configuration(insertion.angles_start + 0.3)))
    assert loop(0.1).at == 0.1
    assert (loop.clock.time, loop.clock.rate) == (0.1, 1.0)


# Data --------------------------------------------------------------------------------------


def test_a_governor_survives_json_and_none_leaves_no_trace() -> None:
    plain = load_scenario("conical_helix")
    assert "governor" not in plain.to_json()
    scenario = governed(plain, free=1e-4, stop=2e-3, slowing=0.1, recovery=1)
    again = Scenario.from_json(scenario.to_json())
    assert again == scenario != plain
    assert hash(again) == hash(scenario)
    assert again.governor == Governor(1e-4, 2e-3, 0.1, 1.0)
    data = json.loads(plain.to_json()) | {"governor": None}
    assert Scenario.from_json(json.dumps(data)) == plain


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"free": -1e-3}, "free = -0.001 m"),
        ({"free": 3e-3}, "below stop"),
        ({"free": math.nan}, "free = nan"),
        ({"stop": math.inf}, "stop = inf"),
        ({"slowing": 0.0}, "slowing = 0.0 s"),
        ({"recovery": math.nan}, "recovery = nan s"),
    ],
)
def test_a_governor_that_makes_no_sense_is_refused(numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Governor(**numbers)


def test_a_hand_is_not_slowed() -> None:
    scenario = load_scenario("camera_task")
    with pytest.raises(OptionError, match="cannot slow a CameraTrial"):
        governed(scenario)
    with pytest.raises(OptionError, match="leave the governor out"):
        Governed(scenario.path, scenario.insertion())  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="must be of type Governor"):
        dataclasses.replace(load_scenario("circle"), governor=True)  # type: ignore[arg-type]


# Files -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def brief() -> tuple[Scenario, Run]:
    scenario = governed(load_scenario("fast_helix", "ur5", duration=0.4))
    run = run_of(scenario)
    assert run.time[-1] - run.path_time[-1] > 0.01
    return scenario, run


def test_the_paths_time_is_in_the_file_however_it_is_written(
    brief: tuple[Scenario, Run], tmp_path: Path
) -> None:
    scenario, run = brief
    controller = make_controller("hierarchical_qp", scenario.insertion(), T)
    run.save(tmp_path / "saved.h5")
    record(scenario, controller, tmp_path / "recorded.h5")
    with Recorder(tmp_path / "own.h5", scenario, controller, versions(), block=64) as recorder:
        for k in range(len(run.time)):
            state = controller.insertion.state(run.q[k])
            named = ("q", "q_measured", "angles", "v", "v_actual", "v_measured", "x_d")
            recorder.append(
                {name: float(values[k]) for name, values in run.diagnostics.items()},
                solve_time=0.0,
                path_time=run.path_time[k],
                x=state.x,
                J=state.J_local,
                **{name: getattr(run, name)[k] for name in named},
            )
    for name in ("saved", "recorded", "own"):
        assert np.array_equal(Run.load(tmp_path / f"{name}.h5").path_time, run.path_time)
        with RunFile(tmp_path / f"{name}.h5") as file:
            assert file.digest == run.digest
            found = np.concatenate([part.path_time for part in file.parts(100)])
            assert np.array_equal(found, run.path_time)
            assert dataclasses.replace(compute_metrics(file), **TIMES) == dataclasses.replace(
                compute_metrics(run), **TIMES
            )


TIMES = {"solve_time_median_us": 0.0, "solve_time_p99_us": 0.0}


def test_a_file_of_before_there_were_governors_is_in_time(tmp_path: Path) -> None:
    scenario = load_scenario("fast_helix", "ur5", duration=0.1)
    run, path = run_of(scenario), tmp_path / "run.h5"
    run.save(path)
    assert np.array_equal(run.path_time, run.time)
    arrays = {**run.arrays(), **run.diagnostics}
    del arrays["path_time"], arrays["solve_time"]
    assert run.head.digest(arrays, block=64) == run.digest
    with h5py.File(path, "r+") as file:
        del file["path_time"]
    assert Run.load(path) == run
    with RunFile(path) as file:
        assert np.array_equal(next(file.parts()).path_time, run.time)
        assert compute_metrics(file) == compute_metrics(run)


def test_a_governed_run_without_its_paths_time_is_damaged(
    brief: tuple[Scenario, Run], tmp_path: Path
) -> None:
    _, run = brief
    run.save(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5", "r+") as file:
        del file["path_time"]
    with pytest.raises(RunFileError, match="damaged"):
        Run.load(tmp_path / "run.h5")
