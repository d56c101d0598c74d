"""Studies: the same whatever happens to them, and tables that are true."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import joblib
import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import compute_metrics, simulate
from rcmqp.cli import main
from rcmqp.controllers import HierarchicalQP
from rcmqp.errors import OptionError, RunFileError, UnknownName
from rcmqp.study.comparisons import comparison_table, side_by_side
from rcmqp.study.outcome import Outcome, outcome_of
from rcmqp.study.perform import RUNS, Performed, perform, trial_file
from rcmqp.study.plan import Law, Study
from rcmqp.study.record import Record
from rcmqp.study.report import write_figures, write_tables
from rcmqp.study.statistics import holm, paired, summary
from rcmqp.study.tables import outcomes_csv, table
from rcmqp.tasks import ObjectiveTask, RcmTask, Together

SHORT = """
import dataclasses
from rcmqp import load_scenario

def scenario(arm="panda", *, flange=None):
    return dataclasses.replace(load_scenario("camera_task", arm), duration={duration})
"""
SLOW = Law(period=0.02)


@pytest.fixture
def short(tmp_path: Path) -> str:
    """The camera task, ended after 0.4 s."""
    file = tmp_path / "short.py"
    file.write_text(SHORT.format(duration=0.4), encoding="utf-8")
    return str(file)


def study(scenario: str, operators: int = 4, **changes: object) -> Study:
    return Study(scenario, operators, laws=(SLOW,), **changes)  # type: ignore[arg-type]


def text_of(performed: Performed) -> str:
    return table(performed) + outcomes_csv(performed.outcomes)


# Whatever happens --------------------------------------------------------------------------


def test_the_outcomes_do_not_depend_on_the_number_of_jobs(short: str, tmp_path: Path) -> None:
    chosen = study(short)
    reported: list[tuple[int, int]] = []
    one = perform(chosen, tmp_path / "one", progress=lambda _, n, of: reported.append((n, of)))
    two = perform(chosen, tmp_path / "two", jobs=2)
    assert text_of(one) == text_of(two)
    assert sum(n for n, _ in reported) == 4
    assert {of for _, of in reported} == {4}
    assert len({outcome.digest for outcome in one.outcomes}) == 4


def test_a_larger_study_has_the_same_people_in_it(short: str, tmp_path: Path) -> None:
    few = perform(study(short, 2), tmp_path / "one")
    more = perform(study(short, 3), tmp_path / "one")
    assert [o.digest for o in more.outcomes][:2] == [o.digest for o in few.outcomes]


def test_a_killed_study_goes_on_where_it_was(tmp_path: Path) -> None:
    """SIGKILL in the middle; what was done is not done again; the table is the same."""
    file = tmp_path / "short.py"
    file.write_text(SHORT.format(duration=3.0), encoding="utf-8")
    call = "import sys; from rcmqp.study.perform import perform; from rcmqp.study.plan import *; "
    call += f"perform(Study({str(file)!r}, 8, laws=(Law(period=0.02),)), sys.argv[1])"
    folder = tmp_path / "killed"
    process = subprocess.Popen([sys.executable, "-c", call, str(folder)])
    try:
        while len(list((folder / RUNS).glob("[!.]*.h5"))) < 2:
            assert process.poll() is None, "it ended before it could be killed"
            time.sleep(0.002)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    done = {path: path.stat().st_mtime_ns for path in (folder / RUNS).glob("[!.]*.h5")}
    assert 2 <= len(done) < 8
    (folder / RUNS / f".left.h5.{process.pid}.part").write_bytes(b"half a file")
    again = perform(study(str(file), 8), folder)
    assert {path: path.stat().st_mtime_ns for path in done} == done
    assert text_of(again) == text_of(perform(study(str(file), 8), tmp_path / "whole"))
    assert any("removed 1 unfinished file" in note for note in again.notes)
    assert not list((folder / RUNS).glob("*.part"))


def test_trials_that_another_version_ran_are_told_of(short: str, tmp_path: Path) -> None:
    chosen = study(short, 2)
    assert not perform(chosen, tmp_path).notes
    file = trial_file(tmp_path, chosen.trials()[0])
    record = Record.load(file)
    dataclasses.replace(record, versions={**record.versions, "numpy": "1.0"}).save(file)
    (note,) = perform(chosen, tmp_path).notes
    assert "1 of 2 trials were run by other versions, the first by numpy 1.0 (now " in note


@pytest.mark.parametrize("damage", ["cut", "changed", "empty"])
def test_a_damaged_file_is_found_said_and_made_again(
    short: str, tmp_path: Path, damage: str
) -> None:
    chosen = study(short, 2)
    before = text_of(perform(chosen, tmp_path / "out"))
    file = trial_file(tmp_path / "out", chosen.trials()[1])
    content = file.read_bytes()
    damaged = {
        "cut": content[: len(content) // 2],
        "changed": content.replace(b'"operator": 1', b'"operator": 7'),
        "empty": b"",
    }
    assert damaged[damage] != content
    file.write_bytes(damaged[damage])
    again = perform(chosen, tmp_path / "out")
    assert text_of(again) == before
    (note,) = again.notes
    assert str(file) in note
    assert "damaged" in note
    assert "made again" in note


def test_a_full_disk_is_said_and_leaves_whole_files_only(short: str, tmp_path: Path) -> None:
    """The system's limit on a file's size stands in for the disk's end."""
    chosen, folder = study(short, 3), tmp_path / "out"
    perform(dataclasses.replace(chosen, operators=1), folder)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, hard))
    try:
        with pytest.raises(RunFileError, match=r"could not be written.*1 of 3 trials are kept"):
            perform(chosen, folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert len(list((folder / RUNS).iterdir())) == 1
    assert text_of(perform(chosen, folder)) == text_of(perform(chosen, tmp_path / "whole"))


def test_a_folder_of_another_study_is_refused(short: str, tmp_path: Path) -> None:
    perform(study(short, 1), tmp_path / "out")
    with pytest.raises(RunFileError, match="of another study"):
        perform(study(short, 1, seed=1), tmp_path / "out")


@pytest.mark.usefixtures("dask")
def test_a_study_runs_on_a_dask_cluster_with_the_same_outcomes(short: str, tmp_path: Path) -> None:
    on_dask = perform(study(short, 3), tmp_path / "dask", jobs=-1)
    with joblib.parallel_config("sequential"):
        assert text_of(on_dask) == text_of(perform(study(short, 3), tmp_path / "here"))


FAR = """
from rcmqp import Instrument, Scenario, load_arm
from rcmqp.insertion import Insertion
from rcmqp.operators import CameraTrial

def scenario(arm="panda", *, flange=None):
    inside = Insertion.on_shaft(load_arm(arm), Instrument(length=0.11), depth=0.10)
    return Scenario.of("far", inside, CameraTrial(duration=60.0))
"""


def test_a_trial_that_fails_is_an_outcome_with_its_reason(tmp_path: Path) -> None:
    """A shaft of 11 cm, and objectives 14 cm inside."""
    (tmp_path / "far.py").write_text(FAR, encoding="utf-8")
    chosen = study(str(tmp_path / "far.py"), 1, seed=46)
    performed = perform(chosen, tmp_path / "out")
    (outcome,) = performed.outcomes
    assert "the shaft is only 110.0 mm long" in outcome.failure
    assert math.isnan(outcome.rcm_rms_mm)
    assert not outcome.finished
    assert "1 trials failed; the first, operator 0: " in table(performed)
    assert not write_figures(performed)


def test_hierarchical_qp_holds_tip_and_roll_as_one_level_with_its_own_gains() -> None:
    law = Law("hierarchical-qp", options=(("gain", 50.0), ("K_c", 3.0)))
    (trial,) = Study(operators=1, laws=(law,)).trials()
    made = trial.controller(trial.made())
    assert isinstance(made, HierarchicalQP)
    assert made.options["levels"] == ["rcm", "tip + roll", "objective"]
    assert made.backend == "active_set"
    assert made.levels is not None
    rcm, camera, own = made.levels
    assert isinstance(rcm, RcmTask)
    assert isinstance(camera, Together)
    assert isinstance(own, ObjectiveTask)
    assert {rcm.gain, *(task.gain for task in camera.tasks)} == {50.0}
    assert own.K_c == 3.0
    chosen = Law("hierarchical_qp", options=(("backend", "daqp"), ("K_c", 0.0)))
    (trial,) = Study(operators=1, laws=(chosen,)).trials()
    made = trial.controller(trial.made())
    assert made.options["levels"] == ["rcm", "tip + roll"]
    assert made.options["backend"] == "daqp"


def test_what_cannot_be_made_is_found_before_the_work(short: str, tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match="did you mean gain"):
        perform(
            Study(short, 2, laws=(Law(period=0.02, options=(("gane", 1.0),)),)), tmp_path / "out"
        )
    with pytest.raises(OptionError, match="nobody steers in conical_helix"):
        perform(study("conical_helix"), tmp_path / "out")
    with pytest.raises(OptionError, match="none twice"):
        Study(laws=(SLOW, SLOW))
    with pytest.raises(OptionError, match="operators = 0"):
        Study(operators=0)
    with pytest.raises(OptionError, match="tremor cannot be shown"):
        Law(period=0.1)


# What is in the files ----------------------------------------------------------------------


def test_an_outcome_has_the_runs_own_numbers_and_the_traces_fit_them(short: str) -> None:
    (trial,) = study(short, 1).trials()
    scenario = trial.made()
    run = simulate(scenario, trial.controller(scenario))
    outcome, traces = outcome_of(trial, run)
    metrics = compute_metrics(run)
    for name in ("tip_rms_mm", "effector_max_mm", "rcm_max_mm", "speed_ratio_max"):
        assert getattr(outcome, name) == getattr(metrics, name)
    assert outcome.digest == run.digest
    assert not outcome.finished
    assert math.isnan(outcome.completion_s)
    assert_allclose(1e3 * traces["rcm_error"].max(), outcome.rcm_max_mm, rtol=1e-6)
    assert_allclose(1e3 * traces["obstacle"].min(), outcome.obstacle_shaft_mm, rtol=1e-6)
    shaft = outcome.obstacle_shaft_mm + 1e3 * scenario.instrument.radius
    assert shaft == pytest.approx(outcome.obstacle_tip_mm)  # the tip is the nearest
    assert_allclose(traces["tip"][0], [0.0, 0.0, 0.10], rtol=0, atol=1e-7)


def test_a_record_survives_its_file(short: str, tmp_path: Path) -> None:
    chosen = study(short, 1)
    perform(chosen, tmp_path)
    record = Record.load(trial_file(tmp_path, chosen.trials()[0]))
    record.save(tmp_path / "again.h5")
    assert Record.load(tmp_path / "again.h5").digest == record.digest
    assert record.scenario == chosen.trials()[0].made().to_json()
    assert json.loads(record.scenario)["path"]["operator"]["group"] == "novice"


# Statistics and tables ---------------------------------------------------------------------


def test_intervals_are_students() -> None:
    """The textbook's: t(0.975, 4) = 2.7764."""
    found = summary([1.0, 2.0, 3.0, 4.0, 5.0, math.nan])
    half = 2.776445 * math.sqrt(2.5 / 5.0)
    assert (found.count, found.mean, found.least, found.largest) == (5, 3.0, 1.0, 5.0)
    assert_allclose([found.deviation, found.low, found.high], [2.5**0.5, 3 - half, 3 + half], 1e-6)
    assert math.isnan(summary([1.0]).low)
    assert summary([]).count == 0


def test_paired_tests_are_scipys_and_see_what_an_unpaired_one_would_not() -> None:
    from scipy import stats

    rng = np.random.default_rng(7)
    first = rng.normal(0.0, 10.0, 12)
    second = first + 1.0 + rng.normal(0.0, 0.3, 12)
    found = paired(first, second)
    assert found.p_t == pytest.approx(stats.ttest_rel(second, first).pvalue)
    assert found.p_signed_rank == pytest.approx(stats.wilcoxon(second, first).pvalue)
    assert found.p_t < 1e-4 < stats.ttest_ind(first, second).pvalue
    assert found.difference.mean == pytest.approx(np.mean(second - first))
    assert paired(first, first).p_t == paired(first, first).p_signed_rank == 1.0
    assert paired([0.0, 1.0], [1.0, 2.0]).p_t == 0.0
    assert math.isnan(paired([1.0], [2.0]).p_t)


def test_holms_correction_is_holms() -> None:
    assert_allclose(holm([0.01, 0.04, 0.03, math.nan]), [0.03, 0.06, 0.06, math.nan])
    assert holm([0.9, 0.8]) == [1.0, 1.0]


def outcomes(law: str, shift: float, arm: str = "lwa3") -> list[Outcome]:
    return [
        Outcome(
            i,
            ("novice", "experienced")[i % 2],
            arm,
            law,
            8e-3,
            finished=True,
            completion_s=60.0 + i,
            reached_s=(1.0, 2.0, 3.0, 60.0 + i),
            looking_s=30.0,
            tip_rms_mm=0.3 + 0.01 * i**2 + shift,
            tip_max_mm=1.0 + i,
            effector_rms_mm=0.1,
            effector_max_mm=0.5,
            rcm_rms_mm=0.004,
            rcm_max_mm=0.02,
            obstacle_tip_mm=12.0,
            obstacle_shaft_mm=7.0 - 8.0 * (i == 3),
            collided=i == 3,
            tip_speed_rms_mm_s=20.0,
            speed_ratio_max=0.9,
            limit_margin_min_rad=0.1,
        )
        for i in range(4)
    ]


def rows_of(text: str) -> dict[str, list[str]]:
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    return {cells[0]: cells[1:] for cells in lines if len(cells) == 5}


def test_the_table_holds_the_outcomes_beside_the_papers(tmp_path: Path) -> None:
    mine = outcomes("dual_quaternion, 8 ms", 0.0)
    rows = rows_of(table(Performed(Study(), tmp_path, mine)))
    time = rows["completion time [s]"]
    assert time[0] == "68.03 ± 30.58; 84 and 52"
    assert time[1].startswith("61.5 ± 1.3 [59.4, 63.6]")
    assert time[2].startswith("61.0 ± 1.4 ")
    assert time[3].startswith("62.0 ± 1.4 ")
    assert rows["tip error, largest [mm]"] == ["4.82 (*)", "4.00", "3.00", "4.00"]
    collisions = rows["collisions: the shaft touched the obstacle"]
    assert collisions == ["0", "1 of 4", "0 of 2", "1 of 2"]
    for label, paper in (  # its Table I
        ("RCM error, rms [mm]", "0.00710 ± 0.00706"),
        ("tip error, rms [mm]: the camera", "0.3398 ± 0.0163 (*)"),
        ("least distance, camera to obstacle [mm]", "12.52 ± 5.03 (**)"),
    ):
        assert rows[label][0] == paper


def cells_of(text: str, start: str) -> list[list[str]]:
    """The cells of every line of a Markdown table that begins so."""
    lines = (line for line in text.splitlines() if line.startswith(start))
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_controllers_are_compared_operator_by_operator(tmp_path: Path) -> None:
    first, second = outcomes("a, 8 ms", 0.0), outcomes("b, 1 ms", -0.25)
    text = table(Performed(Study(), tmp_path, [*first, *reversed(second)]))
    (cells,) = cells_of(text, "| a, 8 ms | b, 1 ms | Schunk LWA3 | tip")
    assert cells[4:6] == ["4", "-0.25"]
    assert "With 4 people p, rank is 0.12 at the least" in text
    assert "0.62 corrected for 5 comparisons: too few people" in text


def test_a_comparison_says_on_which_arm_or_with_which_controller(tmp_path: Path) -> None:
    """Two arms, two controllers: the difference of the arms is another with each controller."""
    all_four = [
        *outcomes("a", 0.0),
        *outcomes("b", 1.0),
        *outcomes("a", 0.5, "panda"),
        *outcomes("b", 3.5, "panda"),
    ]
    text = comparison_table(all_four)
    lwa3, panda = "Schunk LWA3", "Franka Emika Panda"
    for ends, change in (
        (f"| a | b | {lwa3}", "1"),
        (f"| a | b | {panda}", "3"),
        (f"| {lwa3} | {panda} | a", "0.5"),
        (f"| {lwa3} | {panda} | b", "2.5"),
    ):
        (cells,) = cells_of(text, f"{ends} | tip_rms_mm |")
        assert cells[5] == change
    assert side_by_side(all_four).splitlines()[0].count(f"{panda}, b") == 1


def test_side_by_side_holds_what_speaks_against_the_second_controller_too() -> None:
    first = outcomes("a", 0.0)
    nearer = dataclasses.replace(first[3], obstacle_shaft_mm=-1.25, tip_max_mm=9.0)
    text = side_by_side(
        [*first, *outcomes("b", 0.25)[:3], dataclasses.replace(nearer, controller="b")]
    )
    for start, expected in (
        ("| the same, worst trial", ["-1", "-1.2", "", ""]),
        ("| tip error, largest", ["4", "9", "", ""]),
        ("| least distance, shaft", ["5", "4.9", "-0.062 [-0.26, 0.14]", "1"]),
        ("| finished; touched", ["4; 1", "4; 1", "", ""]),
    ):
        (cells,) = cells_of(text, start)
        assert cells[1:] == expected
    assert not side_by_side(first)


def test_the_readmes_comparison_has_the_rows_that_a_study_writes() -> None:
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    pasted = readme[readme.index("rcmqp study camera_task -c dual_quaternion -c") :]
    rows = side_by_side([*outcomes("a", 0.0), *outcomes("b", 0.1)])
    labels = [cells[0] for cells in cells_of(rows, "|")]
    assert [cells[0] for cells in cells_of(pasted, "|")[: len(labels)]] == labels


def test_a_limit_reached_to_rounding_is_kept(tmp_path: Path) -> None:
    at = [
        dataclasses.replace(o, speed_ratio_max=1.0 + 2e-16, limit_margin_min_rad=-2e-16)
        for o in outcomes("a", 0.0)
    ]
    over = [
        dataclasses.replace(o, speed_ratio_max=1.0 + 1e-6, limit_margin_min_rad=-1e-6) for o in at
    ]
    for group, count in ((at, "0 of 4"), (over, "4 of 4")):
        rows = rows_of(table(Performed(Study(), tmp_path, group)))
        assert rows["above a joint's speed limit"][1] == count
        assert rows["beyond a joint's position limit"][1] == count


def test_every_trial_is_a_row_of_the_csv() -> None:
    rows = list(csv.DictReader(io.StringIO(outcomes_csv(outcomes("a", 0.0)))))
    assert [float(row["reached_4_s"]) for row in rows] == [60.0, 61.0, 62.0, 63.0]
    assert rows[3]["collided"] == "True"


# The command line --------------------------------------------------------------------------


def test_the_command_leaves_trials_tables_operators_and_figures(
    short: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    call = ["study", short, "--operators", "2", "--period", "0.02", "--gain", "30", "--gain", "60"]
    with pytest.raises(SystemExit) as ended:
        main([*call, "--out", str(folder)])
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    assert "gain = 30.0" in printed
    assert "Paired comparisons" in printed
    names = {path.name for path in folder.iterdir()}
    figures = ("fig4_views", "fig6_errors", "fig7_trajectory", "groups")
    assert names == {"runs", "table.md", "trials.csv", "operators.csv"} | {
        f"{figure}.{end}" for figure in figures for end in ("png", "pdf")
    }
    people = list(csv.DictReader(io.StringIO((folder / "operators.csv").read_text("utf-8"))))
    assert [row["operator"] for row in people] == ["unit", "low", "high", "source", "0", "1"]
    with pytest.raises(SystemExit):
        main([*call, "--out", str(folder), "--json"])
    assert len(json.loads(capsys.readouterr().out)) == 4


def test_experiment_b_is_reproduced_and_others_are_unknown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One operator, to the end: a novice with a quick eye."""
    call = ["reproduce", "-e", "b", "--operators", "1", "--seed", "46", "--out", str(tmp_path)]
    with pytest.raises(SystemExit):
        main([*call, "--json"])
    (trial,) = json.loads(capsys.readouterr().out)
    assert trial["finished"]
    assert trial["arm"] == "lwa3"
    assert trial["controller"] == "dual_quaternion, 8 ms"
    assert 0.1 < trial["tip_rms_mm"] < 0.6
    assert trial["rcm_max_mm"] < 0.37
    with pytest.raises(SystemExit) as ended:
        main(["reproduce", "-e", "c"])
    assert ended.value.code == 1
    assert "known: a, b" in capsys.readouterr().err


def test_tables_are_written_with_who_took_part(short: str, tmp_path: Path) -> None:
    performed = perform(study(short, 2), tmp_path)
    text, files = write_tables(performed)
    assert text in (tmp_path / "table.md").read_text(encoding="utf-8")
    assert all(file.stat().st_size for file in files)
    assert os.listdir(tmp_path / RUNS)
