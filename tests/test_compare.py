"""Many runs in one table."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pytest
from helpers import assert_allclose
from rich.console import Console

from rcmqp import Run, load_arm, load_scenario, make_controller, simulate
from rcmqp.cli import console, main
from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.controllers.given import UNKNOWN
from rcmqp.controllers.settings import controller_of, every_setting, with_options
from rcmqp.errors import OptionError, RunFileError
from rcmqp.experiments.compare import Case, cases, compare
from rcmqp.show.tables import TIMES, Row, as_markdown, row_of, tables

CASES = cases(
    ["conical_helix"], ["ur5", "panda"], ["dual-quaternion", "task_priority"], {"duration": 0.2}
)


BROKEN = """
from dataclasses import dataclass
from rcmqp.references.paths import PATHS
from rcmqp.runs.scenario import Scenario

@dataclass(frozen=True)
class Broken:
    duration: float = 1.0
    def command(self, t, tip_depth):
        return 1 / 0

PATHS["broken"] = Broken

def scenario(arm, *, flange=None):
    return Scenario.on_shaft("broken", arm, Broken(), flange=flange)
"""


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take longer than the runs."""
    monkeypatch.setattr("rcmqp.experiments.compare._draw", lambda folder, stem, files: None)


def numbers(rows: list[Row]) -> list[dict[str, str]]:
    """To the last digit; as text, in which NaN is NaN."""
    return [
        {name: repr(x) for name, x in dataclasses.asdict(row).items() if name not in TIMES}
        for row in rows
    ]


@pytest.mark.usefixtures("no_figures")
def test_the_rows_do_not_depend_on_the_number_of_jobs(tmp_path: Path) -> None:
    done: list[int] = []
    one = compare(CASES, tmp_path / "one", progress=done.append)
    two = compare(CASES, tmp_path / "two", jobs=2)
    assert numbers(one) == numbers(two)
    assert [(row.arm, row.controller) for row in one] == [
        (arm, name) for arm in ("ur5", "panda") for name in ("dual_quaternion", "task_priority")
    ]
    assert sum(done) == len(CASES)


def test_every_file_is_written_and_holds_the_rows(tmp_path: Path) -> None:
    rows = compare(CASES[:2], tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {
        "comparison.csv",
        "comparison.md",
        "comparison.tex",
        "conical_helix_ur5.png",
        "conical_helix_ur5.pdf",
        "conical_helix_ur5_dual_quaternion.h5",
        "conical_helix_ur5_task_priority.h5",
    }
    run = Run.load(tmp_path / "conical_helix_ur5_dual_quaternion.h5")
    assert rows[0].digest == run.digest
    assert_allclose(rows[0].rcm_max_mm, 1e3 * run.rcm_error.max())
    with (tmp_path / "comparison.csv").open() as stream:
        (first, _) = csv.DictReader(stream)
    assert float(first["tip_rms_mm"]) == rows[0].tip_rms_mm
    assert as_markdown(rows) in (tmp_path / "comparison.md").read_text()


def test_what_cannot_be_run_is_a_row_that_says_why(tmp_path: Path) -> None:
    todo = cases(["conical_helix"], ["lwa4"], ["dual_quaternion"])
    good = Case("conical_helix", None, "dual_quaternion", {"duration": 0.02})
    todo.append(Case("conical_helx", None, "dual_quaternion"))
    row, other, made = compare([*todo, good], tmp_path)
    assert made.limits_kept
    assert row.limits_kept is None
    assert "did you mean lwa3" in row.failure
    assert "did you mean conical_helix" in other.failure
    assert math.isnan(row.rcm_max_mm)
    (table, *_) = tables([row, made])
    assert "failure" not in table.heads
    (note,) = (note for note in table.notes if "lwa4" in note)
    assert note.startswith("conical_helix on lwa4 with dual_quaternion could not be run: ")
    assert "did you mean lwa3" in as_markdown([row])
    before = (tmp_path / "comparison.csv").read_bytes()
    with pytest.raises(OptionError, match=r"\(nor could the 1 others\): .* did you mean lwa3"):
        compare(todo, tmp_path)
    assert (tmp_path / "comparison.csv").read_bytes() == before


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("jobs", [1, 2])
def test_no_run_takes_the_file_of_another(jobs: int, tmp_path: Path) -> None:
    """Two URDFs of one name, two periods, two gains, the same case twice: each its own file."""
    urdfs = [tmp_path / side / "robot.urdf" for side in ("left", "right")]
    for urdf in urdfs:
        urdf.parent.mkdir()
        urdf.write_bytes(Path(str(load_arm("ur5").urdf)).read_bytes())
    made = Case("conical_helix", None, "dual-quaternion", {"duration": 0.02})
    todo = [
        *(dataclasses.replace(made, arm=str(urdf), flange="tool0") for urdf in urdfs),
        made,
        dataclasses.replace(made, changes={"duration": 0.02, "period": 0.002}),
        dataclasses.replace(made, controller="dual-quaternion:gain=30"),
        dataclasses.replace(made, arm="lwa5"),
        made,
    ]
    rows = compare(todo, tmp_path / "out", jobs=jobs)
    law = "dual_quaternion"
    assert [row.file for row in rows] == [
        f"conical_helix_robot_{law}.h5",
        f"conical_helix_robot_2_{law}.h5",
        f"conical_helix_lwa3_{law}.h5",
        f"conical_helix_lwa3_2_{law}.h5",
        f"conical_helix_lwa3_{law}_2.h5",
        "",
        f"conical_helix_lwa3_{law}_3.h5",
    ]
    for case, row in zip(todo, rows, strict=True):
        if row.file:
            run = Run.load(tmp_path / "out" / row.file)
            assert run.digest == row.digest
            assert run.scenario.arm == Path(case.arm or "lwa3").name
            assert run.period == case.changes.get("period", 0.001)
            assert run.options["gain"] == (30.0 if "gain" in case.controller else 60.0)


def test_runs_of_the_same_scenario_and_arm_share_a_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: dict[str, list[str]] = {}
    monkeypatch.setattr(
        "rcmqp.experiments.compare._draw", lambda folder, stem, files: drawn.update({stem: files})
    )
    other = [dataclasses.replace(case, changes={"duration": 0.1}) for case in CASES[:1]]
    rows = compare([*CASES[:2], *other], tmp_path)
    files = [row.file for row in rows]
    assert drawn == {"conical_helix_ur5": files[:2], "conical_helix_ur5_2": files[2:]}


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_case_that_fails_in_any_way_leaves_the_others(jobs: int, tmp_path: Path) -> None:
    broken = tmp_path / "broken.py"
    broken.write_text(BROKEN)
    todo = [Case(str(broken), "ur5", "dual_quaternion"), *CASES[:1]]
    failed, done = compare(todo, tmp_path, jobs=jobs)
    assert failed.failure == "ZeroDivisionError: division by zero"
    assert done.digest == Run.load(tmp_path / done.file).digest
    with (tmp_path / "comparison.csv").open() as stream:
        assert [row["failure"] for row in csv.DictReader(stream)] == [failed.failure, ""]


def test_a_table_that_cannot_be_written_leaves_the_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write_half(self: Path, text: str, **_: str) -> None:
        self.write_bytes(text[: len(text) // 2].encode())
        raise OSError("no space left")

    (tmp_path / "comparison.csv").write_text("earlier")
    monkeypatch.setattr(Path, "write_text", write_half)
    with pytest.raises(RunFileError, match=r"comparison\.csv.*no space left"):
        compare([], tmp_path)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["earlier"]


def test_the_command_prints_the_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = ["--duration", "0.1", "--out", str(tmp_path), "-a", "ur5", "-c", "dual-quaternion"]
    with pytest.raises(SystemExit):
        main(["compare", "-s", "conical_helix", *short, "--json"])
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["scenario"], row["arm"], row["limits_kept"]) == ("conical_helix", "ur5", True)


@pytest.mark.usefixtures("dask", "no_figures")
def test_the_rows_are_the_same_on_a_dask_cluster(tmp_path: Path) -> None:
    on_dask = compare(CASES[:2], tmp_path / "dask", jobs=-1)
    with joblib.parallel_config("sequential"):
        assert numbers(on_dask) == numbers(compare(CASES[:2], tmp_path / "here"))


def test_limits_are_kept_only_where_speed_acceleration_jerk_and_position_are() -> None:
    short = load_scenario("conical_helix", "lwa3", duration=0.05)
    run = simulate(short, make_controller("hierarchical_qp", short.insertion(), short.period))
    found = row_of(run)
    assert found.limits_kept
    for name, ratio in (
        ("velocity_limit", found.speed_ratio_max),
        ("acceleration_limit", found.acceleration_ratio_max),
        ("jerk_limit", found.jerk_ratio_max),
    ):
        tight = 0.99 * ratio * getattr(run, name)
        assert not row_of(dataclasses.replace(run, **{name: tight})).limits_kept, name
    assert not row_of(dataclasses.replace(run, upper=run.angles.max(axis=0) - 1e-3)).limits_kept


def test_an_arm_without_acceleration_limits_says_so_and_can_keep_its_limits() -> None:
    short = load_scenario("conical_helix", "ur5", duration=0.1, acceleration=math.inf)
    row = row_of(simulate(short, make_controller("dual_quaternion", short.insertion(), 1e-3)))
    assert math.isnan(row.acceleration_ratio_max)
    assert math.isnan(row.jerk_ratio_max)
    assert row.limits_kept
    assert "| no limit | no limit |" in as_markdown([row])
    assert "no limit" not in as_markdown([Row("a", "b", "c", failure="no arm")])


def made(setting: str, scenario: str = "conical_helix", arm: str = "ur5", **changes: Any) -> Row:
    """The row of a short run."""
    short = load_scenario(scenario, arm, **({"duration": 0.02} | changes))
    name, options = controller_of(setting)
    controller = make_controller(name, short.insertion(), short.period, **options)
    return dataclasses.replace(row_of(simulate(short, controller)), setting=setting)


@pytest.mark.parametrize(
    ("limits", "assumed"),
    [
        ({}, "acceleration and jerk"),
        ({"acceleration": 5.0}, "jerk"),
        ({"acceleration": 5.0, "jerk": 90.0}, "none"),
    ],
)
def test_tables_say_which_limits_are_assumed(limits: dict[str, Any], assumed: str) -> None:
    row = made("dual_quaternion", **limits)
    assert row.assumed == assumed
    assert all(f"limits assumed: {assumed}" in table.title for table in tables([row]))


SETTINGS = {
    "dual_quaternion": ("no", "none"),
    "dual_quaternion:feed_forward=true": ("yes", "none"),
    "dual_quaternion:velocity_limit=scale": ("no", "speed by scaling"),
    "dual_quaternion:feed_forward=true,velocity_limit=clip": ("yes", "speed by clipping"),
    "hierarchical_qp": ("yes", "all"),
    "weighted_qp": ("yes", "all"),
    "pose_error": ("no", "none"),
    "vfi_qp": ("no", "position"),
    "vfi_qp:velocity_limits=true": ("no", "position and speed"),
    "task_priority:gain=30,rcm_gain=20": ("no", "none"),
}

GIVEN = ["controller", "feed-forward", "roll held", "joint limits enforced"]


def test_each_table_says_what_each_controller_was_given() -> None:
    for table in tables([made(setting) for setting in SETTINGS]):
        heads = table.heads
        assert heads[:4] == GIVEN
        assert [(row[1], row[3]) for row in table.rows] == list(SETTINGS.values())
        assert [row[2] for row in table.rows] == ["yes"] * (len(SETTINGS) - 1) + ["no"]
        gains = [row[heads.index("K [1/s]")] for row in table.rows]
        assert gains == ["60"] * (len(SETTINGS) - 1) + ["30"]
        assert table.rows[-1][0] == "task_priority, rcm_gain=20"
        assert "conical_helix, on ur5, T = 1 ms, limits assumed: acceleration and jerk" in (
            table.title
        )


def test_a_law_that_says_nothing_was_given_nothing_that_is_known() -> None:
    short = load_scenario("conical_helix", "ur5", duration=0.02)
    run = simulate(short, make_controller("damped", short.insertion(), short.period))
    (table, *_) = tables([row_of(dataclasses.replace(run, given=UNKNOWN))])
    assert (
        "feed-forward: not said, roll controlled: not said, joint limits enforced: not said"
        in table.title
    )
    assert "K: not said" in table.title


def test_one_controller_on_several_arms_is_one_table_and_several_have_one_for_each_arm() -> None:
    one = [made("damped", arm=arm) for arm in ("ur5", "panda")]
    assert [list(table.heads[:2]) for table in tables(one)] == [["arm", "limits assumed"]] * 3
    several = tables([*one, *(made("pose_error", arm=arm) for arm in ("ur5", "panda"))])
    assert [table.title.split(", ")[1] for table in several] == ["on ur5"] * 3 + ["on panda"] * 3
    assert [len(table.rows) for table in several] == [2] * 6
    assert [list(table.heads[:4]) for table in several] == [GIVEN] * 6  # the same for both


def test_no_word_is_cut_in_the_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "out", Console(width=120, emoji=False))
    several = [made(setting, arm="meka_a2") for setting in SETTINGS]
    console.print_tables(tables(several))
    console.print_tables(tables([made("damped", arm=arm) for arm in ("meka_a2", "panda")]))
    text = capsys.readouterr().out
    assert "\u2026" not in text
    widths = [len(line) for line in text.splitlines() if ":" not in line]  # titles have one
    assert max(widths) <= 120


def test_a_run_that_goes_on_after_its_path_says_until_when_its_errors_count() -> None:
    rows = [
        made("dual_quaternion", duration=duration, period=0.008, arm="lwa3")
        for duration in (20.0, 100.0)
    ]
    (first, *_) = tables(rows)
    until, tip = (list(first.heads).index(name) for name in ("rms until [s]", "tip rms [mm]"))
    assert [(row[until], row[tip]) for row in first.rows] == [
        ("20", "0.335"),
        ("20 of 100", "0.335"),
    ]


def test_without_a_controller_each_is_run_with_and_without_what_it_can_be_given() -> None:
    settings = every_setting()
    assert {controller_of(setting)[0] for setting in settings} == CONTROLLERS.keys()
    assert [setting for setting in settings if setting.startswith("dual")] == [
        "dual_quaternion",
        "dual_quaternion:feed_forward=true",
        "dual_quaternion:velocity_limit=scale",
        "dual_quaternion:feed_forward=true,velocity_limit=scale",
    ]
    assert "pose_error:feed_forward=true" in settings
    assert "vfi_qp:velocity_limits=true" in settings
    assert settings.count("hierarchical_qp") == 1
    fixed = every_setting(["feed_forward=true"])
    assert with_options([s for s in fixed if s.startswith("dual")], ["feed_forward=true"]) == [
        "dual_quaternion:feed_forward=true",
        "dual_quaternion:velocity_limit=scale,feed_forward=true",
    ]


def test_the_table_of_a_moving_trocar_says_why_two_laws_differ(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the terminal, read by itself: the same law, and what decides is in the same line."""
    monkeypatch.setattr("rcmqp.experiments.compare._draw", lambda folder, stem, files: None)
    monkeypatch.setattr(console, "out", Console(width=120, emoji=False))
    laws = ["-c", "damped", "-c", "damped:feed_forward=true"]
    laws += ["-c", "hierarchical_qp", "-c", "task_priority"]
    with pytest.raises(SystemExit):
        main(["compare", "-s", "moving_trocar", "--period", "0.008", *laws, "-o", str(tmp_path)])
    text = capsys.readouterr().out
    assert max(len(line) for line in text.splitlines() if str(tmp_path) not in line) <= 120
    assert "\u2026" not in text  # nothing is cut
    lines = [
        line.split()
        for line in text.splitlines()
        if line.strip().startswith(("damped", "hier", "task"))
    ]
    assert [line[:4] for line in lines[:4]] == [
        ["damped", "no", "yes", "none"],
        ["damped", "yes", "yes", "none"],
        ["hierarchical_qp", "yes", "yes", "all"],
        ["task_priority", "no", "no", "none"],
    ]
    without, with_it, qp = (float(line[6]) for line in lines[:3])  # RCM max [mm]
    turned = [float(line[5]) for line in lines[:4]]  # orientation rms [mrad]
    assert max(turned[:3]) < 0.1 < turned[3]
    assert without > 0.5
    assert max(with_it, qp) < 0.02


@pytest.mark.usefixtures("no_figures")
def test_limits_on_the_command_line_are_every_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = ["--duration", "0.02", "--out", str(tmp_path), "-c", "dual_quaternion"]
    limits = ["--acceleration", "5", "--jerk", "inf"]
    with pytest.raises(SystemExit):
        main(["compare", "-s", "circle", "-a", "ur5", "-a", "panda", *short, *limits, "--json"])
    assert [row["assumed"] for row in json.loads(capsys.readouterr().out)] == ["none"] * 2
    for run in map(Run.load, sorted(tmp_path.glob("*.h5"))):
        assert set(run.acceleration_limit) == {5.0}
        assert np.isposinf(run.jerk_limit).all()


@pytest.mark.usefixtures("no_figures")
def test_an_option_goes_to_each_controller_that_has_it_and_a_flange_to_urdfs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf = load_arm("panda").urdf
    laws = ["-c", "dual-quaternion", "-c", "task-priority", "--set", "feed_forward=true"]
    arms = ["-a", "ur5", "-a", str(urdf), "--flange", "panda_link8"]
    short = ["--duration", "0.05", "--out", str(tmp_path), *laws, "--set", "K_c=0"]
    with pytest.raises(SystemExit):
        main(["compare", "-s", "conical_helix", *short, *arms, "--json"])
    rows = json.loads(capsys.readouterr().out)
    assert [row["failure"] for row in rows] == [""] * 4
    runs = [Run.load(file) for file in sorted(tmp_path.glob("*.h5"))]
    assert {Path(run.scenario.arm).stem: run.scenario.flange for run in runs} == {
        "ur5": None,
        Path(str(urdf)).stem: "panda_link8",
    }
    for run in runs:
        known = controller_options(run.controller)
        assert run.options.get("K_c", 0.0) == 0.0
        assert run.options.get("feed_forward", True) is True
        assert known.keys() & {"K_c", "feed_forward"}


def test_a_figure_that_cannot_be_written_is_said_from_any_process(tmp_path: Path) -> None:
    (tmp_path / "conical_helix_ur5.png").mkdir()
    with pytest.raises(RunFileError, match=r"conical_helix_ur5\.png"):
        compare(CASES[:1], tmp_path, jobs=2)
