"""A recorded file is the saved run, whatever the blocks; and whole, or not there."""

from __future__ import annotations

import itertools
import tracemalloc
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rcmqp import Run, load_scenario, make_controller, simulate
from rcmqp.controllers import Command, Controller
from rcmqp.errors import OptionError, RunFileError
from rcmqp.references.view import Reference
from rcmqp.runs.head import SIGNATURE
from rcmqp.runs.recorder import Recorder
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import versions
from rcmqp.runs.writer import RunWriter
from rcmqp.world.arm import ArmState

EARLIER = SIGNATURE + b"earlier"
Row = tuple[Mapping[str, float], dict[str, Any]]


def rows_of(scenario: Scenario, controller: Controller, run: Run) -> list[Row]:
    """What the cycles of a run left, its poses with their signs as they come."""
    insertion, found = controller.insertion, list[Row]()
    for k, reference in enumerate(scenario.references(insertion)):
        state = insertion.state(run.q[k])
        named = ("q", "q_measured", "angles", "v", "v_actual", "v_measured", "solve_time")
        row = {name: getattr(run, name)[k] for name in named}
        numbers = {name: float(values[k]) for name, values in run.diagnostics.items()}
        found.append((numbers, {**row, "x": state.x, "x_d": reference.x_d, "J": state.J_local}))
    return found


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """Poses change their sign on the way, and the trocar moves."""
    return load_scenario("breathing_trocar", "panda", duration=0.05, seed=11)


@pytest.fixture(scope="module")
def controller(scenario: Scenario) -> Controller:
    return make_controller("dual_quaternion", scenario.insertion(), scenario.period)


@pytest.fixture(scope="module")
def run(scenario: Scenario, controller: Controller) -> Run:
    return simulate(scenario, controller)


@pytest.fixture(scope="module")
def rows(scenario: Scenario, controller: Controller, run: Run) -> list[Row]:
    return rows_of(scenario, controller, run)


@pytest.fixture
def recorder(
    tmp_path: Path, scenario: Scenario, controller: Controller
) -> Callable[..., Recorder]:
    def make(block: int = 16) -> Recorder:
        return Recorder(tmp_path / "run.h5", scenario, controller, versions(), block=block)

    return make


def record(recorder: Recorder, rows: Iterable[Row]) -> None:
    with recorder as recording:
        for numbers, row in rows:
            recording.append(numbers, **row)


@pytest.mark.parametrize("block", [1, 16, 17, 51, 4096])
def test_a_recorded_file_is_loaded_as_the_run_itself(
    block: int, recorder: Callable[..., Recorder], rows: list[Row], run: Run, tmp_path: Path
) -> None:
    record(recorder(block), rows)
    loaded = Run.load(tmp_path / "run.h5")
    assert loaded == run
    assert loaded.digest == run.digest
    assert dict(loaded.about_diagnostics) == {
        name: run.about_diagnostics[name] for name in run.diagnostics
    }
    assert list(tmp_path.iterdir()) == [tmp_path / "run.h5"]


def test_poses_go_on_across_blocks_on_the_side_they_were(
    recorder: Callable[..., Recorder], rows: list[Row], run: Run, tmp_path: Path
) -> None:
    """Every second pose comes with the other sign, at the edges of blocks too."""
    turned = [
        (numbers, row | {"x": (-1.0) ** k * row["x"], "x_d": (-1.0) ** (k // 2) * row["x_d"]})
        for k, (numbers, row) in enumerate(rows)
    ]
    record(recorder(5), turned)
    found = Run.load(tmp_path / "run.h5")
    assert np.array_equal(found.x, run.x)
    assert np.array_equal(found.x_d, run.x_d)


def test_a_recorded_file_has_the_same_names_and_units_as_a_saved_one(
    recorder: Callable[..., Recorder], rows: list[Row], run: Run, tmp_path: Path
) -> None:
    record(recorder(), rows)
    run.save(tmp_path / "saved.h5")
    with h5py.File(tmp_path / "run.h5") as found, h5py.File(tmp_path / "saved.h5") as wanted:
        assert dict(found.attrs) == dict(wanted.attrs)
        names: list[str] = []
        wanted.visit(names.append)
        for name in names:
            assert dict(found[name].attrs) == dict(wanted[name].attrs), name
            if isinstance(wanted[name], h5py.Dataset):
                assert found[name].dtype == wanted[name].dtype
                assert found[name].fletcher32 == wanted[name].fletcher32


class Nervous(Controller):
    """Ever faster, until it is frightened."""

    name = "nervous"

    def _step(self, state: ArmState, reference: Reference) -> Command:
        if state.v[0] > 0.02:
            return self.safe_stop(state, "fast" if state.v[0] < 0.023 else "much too fast")
        return Command(state.v + 0.007 * (1.0 + np.cos(1e4 * state.q[0])))


@pytest.mark.parametrize("block", [4, 64])
def test_safe_stops_are_recorded_as_in_the_run_itself(
    block: int, scenario: Scenario, tmp_path: Path
) -> None:
    controller = Nervous(scenario.insertion(), scenario.period)
    run = simulate(scenario, controller)
    assert min(map(len, run.stops.values())) > 2
    reasons = {k: reason for reason, cycles in run.stops.items() for k in cycles}
    assert len(run.stops) == 2
    with Recorder(tmp_path / "run.h5", scenario, controller, versions(), block=block) as recorder:
        for k, (numbers, row) in enumerate(rows_of(scenario, controller, run)):
            recorder.append(numbers, reasons.get(k, ""), **row)
    loaded = Run.load(tmp_path / "run.h5")
    assert loaded.stops == run.stops
    assert loaded == run
    assert loaded.about_diagnostics == run.about_diagnostics


def test_a_number_that_is_not_always_there_is_nan_elsewhere(
    recorder: Callable[..., Recorder], rows: list[Row], tmp_path: Path
) -> None:
    record(
        recorder(),
        (
            ({"now_and_then": float(k)} if k in (20, 40) else {}, row)
            for k, (_, row) in enumerate(rows)
        ),
    )
    (found,) = Run.load(tmp_path / "run.h5").diagnostics.values()
    assert (found[20], found[40]) == (20.0, 40.0)
    assert np.isnan(np.delete(found, [20, 40])).all()


@pytest.mark.parametrize("failure", [ValueError("no"), KeyboardInterrupt()], ids=str)
def test_a_run_that_fails_leaves_the_folder_as_it_was(
    failure: BaseException, recorder: Callable[..., Recorder], rows: list[Row], tmp_path: Path
) -> None:
    def until_failure() -> Iterator[Row]:
        yield from rows[:30]
        raise failure

    (tmp_path / "run.h5").write_bytes(EARLIER)
    with pytest.raises(type(failure)):
        record(recorder(), until_failure())
    assert [path.name for path in tmp_path.iterdir()] == ["run.h5"]
    assert (tmp_path / "run.h5").read_bytes() == EARLIER


def test_a_run_that_ends_early_is_recorded_as_far_as_it_goes(
    recorder: Callable[..., Recorder], rows: list[Row], run: Run, tmp_path: Path
) -> None:
    record(recorder(), rows[:-9])
    found = Run.load(tmp_path / "run.h5")
    for name, values in run.rows().items():
        assert np.array_equal(found.rows()[name], values[:-9]), name
    for name, values in run.diagnostics.items():
        assert np.array_equal(found.diagnostics[name], values[:-9]), name


def test_cycles_and_parts_are_recorded_in_the_order_they_come(
    recorder: Callable[..., Recorder], rows: list[Row], run: Run, tmp_path: Path
) -> None:
    parts = list(run.parts(10))
    with recorder() as recording:
        recording.write(parts[0])
        recording.write(parts[1])
        for numbers, row in rows[20:30]:  # poses of the other sign, which is none of theirs
            recording.append(numbers, **row | {"x": -row["x"], "x_d": -row["x_d"]})
        recording.write(parts[3])
        for numbers, row in rows[40:]:
            recording.append(numbers, **row)
        with pytest.raises(OptionError, match="51 cycles, not more"):
            recording.write(parts[0])
    assert Run.load(tmp_path / "run.h5") == run


def test_a_run_without_a_cycle_or_with_too_many_is_refused(
    recorder: Callable[..., Recorder], rows: list[Row], tmp_path: Path
) -> None:
    with pytest.raises(RunFileError, match="no cycle was recorded"):
        record(recorder(), [])
    with pytest.raises(OptionError, match="51 cycles, not more"):
        record(recorder(), [*rows, rows[-1]])
    assert list(tmp_path.iterdir()) == []


def test_a_row_without_a_channel_or_with_a_strange_one_is_refused(
    recorder: Callable[..., Recorder], rows: list[Row]
) -> None:
    numbers, row = rows[0]
    with recorder() as recording:
        for wrong in ({key: row[key] for key in row if key != "v"}, row | {"w": 0.0}):
            with pytest.raises(OptionError, match=r"\['[vw]'\] missing or unknown"):
                recording.append(numbers, **wrong)
        for numbers, row in rows:
            recording.append(numbers, **row)


def test_a_full_disk_is_an_error_and_leaves_nothing(
    recorder: Callable[..., Recorder],
    rows: list[Row],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(RunWriter, "_put", full)
    with pytest.raises(RunFileError, match="no space left"):
        record(recorder(), rows)
    assert list(tmp_path.iterdir()) == []


def test_memory_does_not_grow_with_the_run(
    controller: Controller, rows: list[Row], tmp_path: Path
) -> None:
    """A run four times as long takes no more; in memory it would take megabytes more."""
    peaks = []
    for duration in (1.0, 4.0):
        scenario = load_scenario("breathing_trocar", "panda", duration=duration)
        tracemalloc.start()
        recorder = Recorder(tmp_path / "run.h5", scenario, controller, {}, block=512)
        record(recorder, itertools.repeat(rows[0], scenario.cycles))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0] < 4e6
