"""The tables of a study with people, from files that look like theirs."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import ttest_rel, wilcoxon

from rcmqp.cli import main
from rcmqp.controllers import CONTROLLERS
from rcmqp.controllers.settings import registered
from rcmqp.errors import OptionError
from rcmqp.experiments.study.plan import Law
from rcmqp.experiments.trial.design import Design, file_sha256, orders
from rcmqp.experiments.trial.people import Folder
from rcmqp.experiments.trial.questions import EXPERIENCE
from rcmqp.experiments.trial.report import holm, results_table, signed_rank
from rcmqp.experiments.trial.results import order_table, read_results
from rcmqp.experiments.trial.task import scenarios_task
from rcmqp.references.paths import Search, ViewMoves
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.metrics import compute_metrics
from rcmqp.runs.run import Run
from rcmqp.runs.simulate import simulate

SHORT = """
import dataclasses
from rcmqp import load_scenario
def scenario(arm="panda", **options):
    return dataclasses.replace(load_scenario("camera_task", arm, **options), duration=0.4)
"""
LAWS = (Law("dual_quaternion", 0.016), Law("hierarchical_qp", 0.016))
VIEW = (0.1, 0.05, 0.0, 0.02)
PEOPLE = 6


def took(person: int, law: int) -> float:
    """How long the move takes [s]: the second controller's is slower for all but one person."""
    return 1.0 + 0.1 * person + (0.2 + 0.02 * person if person else -0.1) * law


def a_run(design: Design, law: int, seconds: float) -> Run:
    scenario = design.made(LAWS[law])
    path = ViewMoves((VIEW,), move=seconds, dwell=0.1)
    moved = dataclasses.replace(scenario, path=path, duration=seconds + 0.1)
    run = simulate(moved, LAWS[law].controller(moved))
    return dataclasses.replace(run, scenario=dataclasses.replace(scenario, duration=seconds + 0.1))


def a_hand(folder: Path) -> Path:
    """A recording of 2 s, 20 mm from end to end."""
    hand = folder / "surgeon.csv"
    lines = [f"{0.02 * k},{10.0 * math.sin(0.05 * k)},0,0" for k in range(100)]
    hand.write_text("t [s],x [mm],y [mm],z [mm]\n" + "\n".join(lines), encoding="utf-8")
    return hand


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six people, three of them novices, two controllers; one has not ended the second task."""
    path = tmp_path_factory.mktemp("study")
    depth = load_scenario("camera_task", "panda").insertion().tip_depth
    (place,) = ViewMoves((VIEW,)).targets(depth)
    task = scenarios_task(load_scenario("camera_task", "panda"))
    design = Design("camera_task", "panda", LAWS, dataclasses.replace(task, places=(place,)))
    design.keep(path)
    kept = Folder(path)
    for i in range(PEOPLE + 1):
        games = 0 if i % 2 else 2
        person = kept.add(f"P{i:02d}", dict.fromkeys(EXPERIENCE, 0) | {"games": games}, design)
        for number, law in enumerate(orders(2)[person.row], 1):
            late = i == PEOPLE and number == 2
            answers = {"ease": 1 + law, "followed": 4 - i % 2, "comment": "<b>|x|" * (i == 0)}
            notes = {
                "number": number,
                "law": LAWS[law].to_json(),
                "attempts": 1,
                "faults": [],
                "finished": None if late else True,
                "answers": answers,
            }
            if i < 2:
                notes["device"] = ["mouse", "keys"] if i else ["haply"]
            kept.keep_notes(f"P{i:02d}", number, notes)
            if not late:
                a_run(design, law, took(i, law)).save(kept.run_file(f"P{i:02d}", number))
    return path


def test_the_numbers_of_people_are_those_of_their_runs(folder: Path) -> None:
    results = read_results(folder)
    assert len(results.ended) == 2 * PEOPLE + 1
    assert results.remarks == [f"P{PEOPLE:02d} has not ended task 2; it does not count"]
    for each in results.ended:
        run = Run.load(folder / "trials" / f"{each.outcome.operator}-{each.number}.h5")
        assert isinstance(run.scenario.path, Search)
        assert each.outcome.finished
        assert each.outcome.tip_max_mm == compute_metrics(run).tip_max_mm
        assert each.outcome.rcm_max_mm == pytest.approx(1e3 * run.rcm_error.max(), abs=1e-12)
        assert 0.5 < each.outcome.completion_s < run.time[-1]
    assert {o.group for o in results.outcomes} == {"novice", "experienced"}


def test_the_comparison_is_within_people_and_tested_on_people_alone(folder: Path) -> None:
    results = read_results(folder)
    text = results_table(results)
    times = {(o.operator, o.controller): o.completion_s for o in results.outcomes}
    pairs = np.array([[times[f"P{i:02d}", str(law)] for law in LAWS] for i in range(PEOPLE)])
    (row,) = [x for x in text.splitlines() if x.startswith("| dual") and "completion" in x]
    cells = [cell.strip() for cell in row.split("|")]
    test = ttest_rel(pairs[:, 1], pairs[:, 0])
    low, high = test.confidence_interval()
    mean = (pairs[:, 1] - pairs[:, 0]).mean()
    assert cells[4:6] == [str(PEOPLE), f"{mean:.3g} [{low:.3g}, {high:.3g}]"]
    assert float(cells[7]) == pytest.approx(wilcoxon(*pairs.T).pvalue, rel=0.01)
    assert float(cells[8]) >= float(cells[7])


def test_answers_are_compared_within_people_as_ranks(folder: Path) -> None:
    text = results_table(read_results(folder))
    (row,) = [
        x
        for x in text.splitlines()
        if x.startswith("| dual") and "hierarchical_qp, 16 ms | How easy" in x
    ]
    cells = [cell.strip() for cell in row.split("|")]
    assert cells[4:7] == [str(PEOPLE), "1", ""]
    assert float(cells[7]) == pytest.approx(wilcoxon([1.0] * PEOPLE).pvalue, rel=0.01)


def test_who_is_counted_and_in_which_orders_stands_in_the_table(folder: Path) -> None:
    text = results_table(read_results(folder))
    assert f"| answered the questions before | {PEOPLE + 1} | 3 | 4 |" in text
    assert f"| ended all tasks | {PEOPLE} | 3 | 3 |" in text
    assert "| practised before | 0 | 0 | 0 |" in text
    assert "| steered by haply | 1 | 0 | 1 |" in text
    assert "| steered by mouse, keys | 1 | 1 | 0 |" in text
    assert f"- P{PEOPLE:02d} has not ended task 2; it does not count" in text
    assert "| dual_quaternion, 16 ms, then hierarchical_qp, 16 ms | 3 | 1 | 2 |" in text
    assert "| hierarchical_qp, 16 ms, then dual_quaternion, 16 ms | 3 | 2 | 1 |" in text
    assert "**Unbalanced** (novice: 1 to 2 people an order; experienced: 1 to 2" in text


def test_orders_that_are_done_equally_often_are_balanced(folder: Path) -> None:
    results = read_results(folder)
    some = [p for p in results.people if p.identifier in ("P00", "P01", "P02", "P03")]
    assert "are balanced in each group" in order_table(dataclasses.replace(results, people=some))


def test_orders_are_counted_of_the_people_in_each_comparison(folder: Path) -> None:
    results = read_results(folder)
    laws = (*LAWS, Law("vfi_qp", 0.016))
    design = dataclasses.replace(results.design, laws=laws)
    people = [dataclasses.replace(results.people[k], row=k) for k in (0, 2)]
    half = dataclasses.replace(results, design=design, people=people)
    text = order_table(half)  # nobody ended all three, and two people are in one comparison
    said = "dual_quaternion, 16 ms and hierarchical_qp, 16 ms, experienced: 0 to 1 people an order"
    assert f"**Unbalanced** ({said})" in text
    alone = order_table(dataclasses.replace(results, people=[], ended=[]))
    assert "alanced" not in alone


def test_fewer_than_five_people_have_neither_effect_size_nor_interval(folder: Path) -> None:
    results = read_results(folder)
    few = [each for each in results.ended if str(each.outcome.operator) < "P04"]
    text = results_table(dataclasses.replace(results, ended=few))
    (row,) = [x for x in text.splitlines() if x.startswith("| dual") and "completion" in x]
    cells = [cell.strip() for cell in row.split("|")]
    assert cells[4] == "4"
    assert "[" not in cells[5]
    assert cells[6:9] == ["", "", ""]
    assert "Fewer than 5 people have both: no interval, effect size or p is given." in text
    assert "Fewer than" not in results_table(results)


def test_recorded_hands_are_replayed_with_each_controller_beside_people(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hand = a_hand(folder.parent)
    with pytest.raises(SystemExit, match="0"):
        main(["study", str(folder), "--hand", str(hand), "--json"])
    whose = Counter(each["whose"] for each in json.loads(capsys.readouterr().out))
    assert whose == {"people": 2 * PEOPLE + 1, "recorded": 2}
    with pytest.raises(SystemExit, match="0"):
        main(["study", str(folder), "--hand", str(hand)])
    assert "## Recorded hands" in capsys.readouterr().out
    with (folder / "recorded.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["controller"] for row in rows] == [str(law) for law in LAWS]
    for row, law in zip(rows, LAWS, strict=True):
        assert (row["operator"], row["group"], row["completion_s"]) == (
            "surgeon",
            "recorded",
            "nan",
        )
        run = Run.load(folder / "recorded" / f"surgeon_panda_{law.stem}.h5")
        assert run.scenario.obstacles == ()
        assert float(row["tip_rms_mm"]) == compute_metrics(run).tip_rms_mm
        way = np.ptp(run.tip_d, axis=0)  # 20 mm from end to end
        assert np.linalg.norm(way[:2]) == pytest.approx(0.02, rel=0.02)
    heads = "|  | people, 3 novice, 6 tasks | people, 4 experienced, 7 tasks | surgeon |"
    assert heads in (folder / "table.md").read_text(encoding="utf-8")
    with pytest.raises(OptionError, match="two have the same name"):
        read_results(folder, hands=[hand, hand])


def test_answers_stand_by_controller_and_a_comment_stays_text(folder: Path) -> None:
    text = results_table(read_results(folder))
    (row,) = [x for x in text.splitlines() if "How easy" in x and "difficult" in x and "dual" in x]
    assert f"1.00 ± 0.00 ({PEOPLE})" in row
    assert "very difficult 6, difficult 0" in row
    assert "<b>|x|" not in text
    assert r"\<b>\|x\|" in text


def test_the_command_writes_tables_and_the_figures_of_each_task(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["study", str(folder)])
    assert "## Comparisons of people" in capsys.readouterr().out
    with (folder / "answers.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * PEOPLE + 1
    assert rows[0]["ease"] in "12"
    devices = [(row["participant"], row["device"]) for row in rows[::2]]
    assert devices[:3] == [("P00", "haply"), ("P01", "mouse, keys"), ("P02", "")]
    figures = {each.name for each in (folder / "figures").iterdir()}
    assert {"fig4_views.png", "groups_1.png", "groups_2.png"} < figures
    assert "P03-2_fig7_trajectory.png" in figures
    assert len(figures) == 4 + 2 * (2 * PEOPLE + 1)


def test_options_of_a_simulated_study_are_refused_with_people(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for option in (["--gain", "3"], ["--out", "x"], ["--instrument", "large_needle_driver"]):
        with pytest.raises(SystemExit, match="1"):
            main(["study", str(folder), *option])
        assert "give no more than" in " ".join(capsys.readouterr().err.split())
    with pytest.raises(OptionError, match="places of this study's task"):
        read_results(folder, operators=1)


def test_simulated_operators_stand_beside_people_and_are_not_tested(tmp_path: Path) -> None:
    scenario, path = tmp_path / "short.py", tmp_path / "study"
    scenario.write_text(SHORT, encoding="utf-8")
    task = scenarios_task(load_scenario(str(scenario), "panda"))
    design = Design(str(scenario), "panda", LAWS[:1], task)
    path.mkdir()
    design.keep(path)
    kept = Folder(path)
    kept.add("P01", dict.fromkeys(EXPERIENCE, 0), design)
    notes = {"number": 1, "law": LAWS[0].to_json(), "attempts": 1, "faults": [], "finished": False}
    kept.keep_notes("P01", 1, notes | {"answers": None})
    a_run(design, 0, 0.5).save(kept.run_file("P01", 1))
    results = read_results(path, operators=2, scenario=str(scenario))
    assert results.simulated is not None
    assert [o.operator for o in results.simulated.outcomes] == [0, 1]
    text = results_table(results)
    assert "| dual_quaternion, 16 ms, people: 1 | dual_quaternion, 16 ms, model: 2 |" in text
    assert "## Simulated operators: Franka Emika Panda, dual_quaternion, 16 ms" in text
    assert "p values are given between real people only" in text
    assert "## Comparisons of people" not in text


def test_a_study_with_a_law_of_ones_own_is_summed_up_without_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="0"):
        main(["new", "law", "own_law"])
    path, law = tmp_path / "study", Law(registered("own_law.py"), 0.016)
    own = {law.name: ("own_law.py", file_sha256("own_law.py"))}
    task = scenarios_task(load_scenario("camera_task", "panda"))
    design = Design("camera_task", "panda", (law,), task, own_laws=own)
    path.mkdir()
    design.keep(path)
    kept = Folder(path)
    kept.add("P01", dict.fromkeys(EXPERIENCE, 0), design)
    notes = {"number": 1, "law": law.to_json(), "attempts": 1, "faults": [], "finished": False}
    kept.keep_notes("P01", 1, notes | {"answers": None})
    scenario = dataclasses.replace(design.made(law), duration=0.4)
    simulate(scenario, law.controller(scenario)).save(kept.run_file("P01", 1))
    del CONTROLLERS[law.name]  # another process does not know it
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with pytest.raises(SystemExit, match="0"):
        main(["study", str(path)])
    assert str(law) in capsys.readouterr().out
    assert law.name not in CONTROLLERS
    with pytest.raises(SystemExit, match="1"):
        main(["study", str(path), "--hand", str(a_hand(tmp_path))])
    assert "give it again, with -c own_law.py" in " ".join(capsys.readouterr().err.split())
    with pytest.raises(SystemExit, match="0"):
        main(["study", str(path), "--hand", str(a_hand(tmp_path)), "-c", "../own_law.py"])
    assert "## Recorded hands" in capsys.readouterr().out
    del CONTROLLERS[law.name]


def test_a_damaged_run_does_not_count_and_is_named(folder: Path, tmp_path: Path) -> None:
    design = Design.load(folder)
    design.keep(tmp_path)
    kept = Folder(tmp_path)
    kept.add("P01", dict.fromkeys(EXPERIENCE, 0), design)
    notes = {"number": 1, "law": LAWS[0].to_json(), "attempts": 1, "faults": [], "finished": True}
    kept.keep_notes("P01", 1, notes | {"answers": None})
    kept.run_file("P01", 1).write_bytes(b"no run")
    with pytest.raises(OptionError, match=r"task 1 of P01 does not count: .*P01-1\.h5"):
        read_results(tmp_path)


def test_p_values_are_corrected_for_their_number_and_few_people_have_none() -> None:
    nan = math.nan
    assert_allclose(holm([0.04, nan, 0.01, 0.03]), [0.06, nan, 0.03, 0.06], rtol=1e-12)
    assert holm([]) == []
    assert math.isnan(signed_rank(np.array([[0.0, 1.0]] * 4)))
    assert signed_rank(np.zeros((6, 2))) == 1.0
