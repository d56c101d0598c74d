"""A comparison that is stopped and started again; cases out of other things than names."""

from __future__ import annotations

import csv
import dataclasses
import importlib.util
import os
import signal
import subprocess
import sys
import time
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from rcmqp import Run, load_arm, load_scenario, make_controller
from rcmqp.cli import main
from rcmqp.controllers import CONTROLLERS
from rcmqp.controllers.pose_laws import Damped
from rcmqp.controllers.settings import controller_of
from rcmqp.errors import OptionError
from rcmqp.experiments import compare as comparison
from rcmqp.experiments.batch import LOADED, batch, kept_run
from rcmqp.experiments.compare import Case, arm_and_flange, cases, compare
from rcmqp.runs.simulate import simulate as simulate_whole
from rcmqp.show.tables import TIMES, Row
from rcmqp.world import plugins

SHORT = cases(
    ["conical_helix"],
    ["ur5", "panda"],
    ["damped", "damped:feed_forward=true", "dual_quaternion"],
    {"duration": 0.1},
)


@pytest.fixture(autouse=True)
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take longer than the runs."""
    monkeypatch.setattr("rcmqp.experiments.compare._draw", lambda folder, stem, files: None)


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The titles of what is simulated, in this process."""
    titles: list[str] = []

    def simulate(scenario: Any, controller: Any) -> Run:
        titles.append(f"{scenario.arm} {controller.name}")
        return simulate_whole(scenario, controller)

    monkeypatch.setattr(comparison, "simulate", simulate)
    return titles


def numbers(rows: list[Row]) -> list[dict[str, str]]:
    """To the last digit, without times."""
    return [
        {name: repr(x) for name, x in dataclasses.asdict(row).items() if name not in TIMES}
        for row in rows
    ]


def lines(file: Path) -> list[dict[str, str]]:
    """The rows of a CSV file, without times."""
    with file.open() as stream:
        return [{k: v for k, v in row.items() if k not in TIMES} for row in csv.DictReader(stream)]


KILLED = """
import sys
from rcmqp.experiments import compare
compare.PAUSE = 0.0
laws, changes = ["damped", "dual_quaternion"], {"duration": 10.0}
todo = compare.cases(["conical_helix"], ["ur5", "panda"], laws, changes)
compare.compare(todo, sys.argv[1], jobs=int(sys.argv[2]))
"""

HALF = {"duration": 10.0}


@pytest.mark.parametrize("jobs", [1, 2])
def test_killed_half_way_and_started_again_the_table_is_the_same(
    jobs: int, tmp_path: Path
) -> None:
    folder = tmp_path / "killed"
    command = [sys.executable, "-c", KILLED, str(folder), str(jobs)]
    with subprocess.Popen(command, start_new_session=True) as process:
        table, last = folder / "comparison.csv", folder / "comparison.md"
        while process.poll() is None and not last.is_file():
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    todo = cases(["conical_helix"], ["ur5", "panda"], ["damped", "dual_quaternion"], HALF)
    assert 0 < len(lines(table)) < len(todo)
    assert f"Unfinished: {len(lines(table))} of 4" in last.read_text()
    kept = lines(table)
    notes: list[str] = []
    again = compare(todo, folder, note=notes.append)
    whole = compare(todo, tmp_path / "whole")
    assert numbers(again) == numbers(whole)
    assert lines(table) == lines(tmp_path / "whole" / "comparison.csv")
    assert [row for row in lines(table) if row in kept] == kept
    assert "runs were in" in notes[0]
    assert "Unfinished" not in last.read_text()


def test_what_is_there_is_not_simulated_again(tmp_path: Path, simulated: list[str]) -> None:
    first = compare(SHORT, tmp_path)
    assert len(simulated) == len(SHORT)
    assert [repr(row) for row in compare(SHORT, tmp_path)] == [repr(row) for row in first]
    assert len(simulated) == len(SHORT)  # times and all are the file's
    (tmp_path / first[1].file).unlink()
    damaged = tmp_path / first[2].file
    damaged.write_bytes(damaged.read_bytes()[:5000])
    assert numbers(compare(SHORT, tmp_path)) == numbers(first)
    assert simulated[len(SHORT) :] == ["ur5 damped", "ur5 dual_quaternion"]


@pytest.mark.parametrize(
    "other",
    [
        {"controller": "damped:gain=30"},
        {"changes": {"duration": 0.1, "period": 0.002}},
        {"changes": {"duration": 0.1, "acceleration": 5.0}},
        {"scenario": "circle"},
    ],
)
def test_the_run_of_another_case_is_not_kept(other: dict[str, Any], tmp_path: Path) -> None:
    compare(SHORT[:1], tmp_path)
    (file,) = tmp_path.glob("*.h5")
    for case, same in ((SHORT[0], True), (dataclasses.replace(SHORT[0], **other), False)):
        scenario = case.made()
        name, options = controller_of(case.controller)
        controller = make_controller(name, scenario.insertion(), scenario.period, **options)
        assert (kept_run(file, scenario, controller) is not None) == same


def test_a_run_of_code_that_has_changed_or_of_other_versions_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compare(SHORT[:1], tmp_path)
    (file,) = tmp_path.glob("*.h5")
    scenario = SHORT[0].made()
    controller = make_controller("damped", scenario.insertion(), scenario.period)
    assert kept_run(file, scenario, controller) is not None
    with monkeypatch.context() as patch:
        patch.setattr("rcmqp.experiments.batch.versions", lambda: {"python": "4"})
        assert kept_run(file, scenario, controller) is None
    os.utime(file, (0.0, 0.0))  # older than the code
    assert kept_run(file, scenario, controller) is None


def test_a_class_that_is_in_no_file_may_have_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, simulated: list[str]
) -> None:
    kind = type("Mine", (Damped,), {"name": "mine", "__module__": "nowhere"})
    monkeypatch.setitem(CONTROLLERS, "mine", kind)
    todo = [Case("conical_helix", "ur5", "mine", {"duration": 0.05})]
    for count in (1, 2):
        (row,) = compare(todo, tmp_path)
        assert not row.failure
        assert simulated == ["ur5 mine"] * count


def test_a_controller_of_ones_own_goes_to_other_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Mine(Damped):
        name = "mine"

    monkeypatch.setitem(CONTROLLERS, "mine", Mine)
    todo = [Case("conical_helix", arm, "mine", {"duration": 0.05}) for arm in ("ur5", "panda")]
    assert [row.failure for row in compare(todo, tmp_path, jobs=2)] == ["", ""]


def test_a_broken_plug_in_is_a_row_that_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    point = EntryPoint("broken", "no_such_module:Broken", CONTROLLERS.group)
    known = plugins.points
    monkeypatch.setattr(
        plugins,
        "points",
        lambda group: {**known(group), **({"broken": (point,)} if group == point.group else {})},
    )
    todo = [Case("conical_helix", "ur5", law, {"duration": 0.05}) for law in ("broken", "damped")]
    broken, other = compare(todo, tmp_path)
    assert broken.failure.startswith("PluginError: 'broken' in rcmqp.controllers")
    assert "no_such_module" in broken.failure
    assert not other.failure


def test_code_edited_while_a_run_is_made_counts_as_changed(tmp_path: Path) -> None:
    compare(SHORT[:1], tmp_path)
    (file,) = tmp_path.glob("*.h5")
    assert file.stat().st_mtime == pytest.approx(LOADED, abs=1e-3)


def test_a_changed_base_class_in_a_file_of_ones_own_counts(tmp_path: Path) -> None:
    """A run is kept only if the files of all the controller's classes are older."""
    base = tmp_path / "own_base.py"
    base.write_text(
        "from rcmqp.controllers.pose_laws import Damped\nclass OwnBase(Damped):\n    pass\n"
    )
    spec = importlib.util.spec_from_file_location("own_base", base)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["own_base"] = module
    try:
        spec.loader.exec_module(module)
        kind = type("Derived", (module.OwnBase,), {"__module__": __name__})
        scenario = SHORT[0].made()
        controller = kind(scenario.insertion(), scenario.period)
        file = tmp_path / "run.h5"
        simulate_whole(scenario, controller).save(file)
        assert kept_run(file, scenario, controller) is not None
        os.utime(base, (file.stat().st_mtime + 1.0,) * 2)
        assert kept_run(file, scenario, controller) is None
    finally:
        del sys.modules["own_base"]


def test_tables_are_written_as_rows_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparison, "PAUSE", 0.0)
    seen: list[int] = []

    def look(_: int) -> None:
        table = tmp_path / "comparison.csv"
        seen.append(len(lines(table)) if table.is_file() else 0)

    compare(SHORT[:3], tmp_path, progress=look)
    assert seen == [0, 1, 2]  # before its own row is written
    assert len(lines(tmp_path / "comparison.csv")) == 3
    text = (tmp_path / "comparison.tex").read_text()
    assert text.count(r"\toprule") == 3
    assert r"dual\_quaternion" in text


def test_two_settings_of_one_controller_stand_beside_each_other(tmp_path: Path) -> None:
    rows = compare(SHORT[:2], tmp_path)
    assert [row.feed_forward for row in rows] == ["no", "yes"]
    assert len({row.file for row in rows}) == 2


def test_scenario_objects_stand_beside_names(tmp_path: Path) -> None:
    mine = dataclasses.replace(load_scenario("circle", "panda", duration=0.05), name="mine")
    todo = cases([mine, "circle"], [None], ["damped"], {"period": 0.002, "duration": 0.04})
    own, named = compare(todo, tmp_path, jobs=2)
    assert (own.scenario, own.arm, own.period_ms) == ("mine", "panda", "2")
    assert (named.scenario, named.arm, named.period_ms) == ("circle", "lwa3", "2")
    assert own.file == "mine_panda_damped.h5"
    assert Run.load(tmp_path / own.file).scenario == dataclasses.replace(
        mine, period=0.002, duration=0.04
    )
    moved, _ = compare([Case(mine, "ur5", "damped"), todo[0]], tmp_path)
    assert "has its arm, panda, already" in moved.failure


def test_each_urdf_has_its_own_flange(tmp_path: Path) -> None:
    urdfs = [str(load_arm(name).urdf) for name in ("ur5", "panda")]
    arms = [f"{urdfs[0]}:tool0", urdfs[1], "ur10"]
    todo = cases(["conical_helix"], arms, ["damped"], {"duration": 0.02}, "panda_link8")
    assert [case.flange for case in todo] == ["tool0", "panda_link8", None]
    rows = compare(todo, tmp_path)
    assert [row.failure for row in rows] == ["", "", ""]
    assert [Run.load(tmp_path / row.file).scenario.flange for row in rows] == [
        "tool0",
        "panda_link8",
        None,
    ]
    odd = tmp_path / "a.urdf:b"
    odd.touch()
    assert arm_and_flange(str(odd), "tool0") == (str(odd), "tool0")


def test_flanges_and_planner_are_given_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = f"{load_arm('ur5').urdf}:tool0"
    short = ["-s", "view_steps", "-a", arm, "-c", "damped", "--duration", "0.05"]
    command = ["compare", *short, "--planner-from", "measured", "-o", str(tmp_path)]
    for kept in (False, True):
        with pytest.raises(SystemExit) as end:
            main(command)
        said = capsys.readouterr().err
        assert not end.value.code, said
        assert ("1 of 1 runs were in" in said) == kept
    (file,) = tmp_path.glob("*.h5")
    scenario = Run.load(file).scenario
    assert (scenario.flange, scenario.planner_from) == ("tool0", "measured")
    for more, message in (
        (["--flange", "tool0"], "none of the arms is one"),
        (["--planner-from", "there"], "planner_from"),
        (["--jobs", "0"], "jobs = 0"),
    ):
        with pytest.raises(SystemExit) as end:
            main([*command, *more])
        assert end.value.code
        assert message in capsys.readouterr().err


def test_a_batch_gives_each_piece_its_number() -> None:
    assert sorted(batch(divmod, [(7, 2), (9, 4)], jobs=2)) == [(0, (3, 1)), (1, (2, 1))]
    for jobs in (0, 1.5, None):
        with pytest.raises(OptionError, match="jobs = "):
            batch(divmod, [], jobs=jobs)  # type: ignore[arg-type]
