"""What the command line refuses, warns of and is interrupted in."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from helpers import SHORT, Call

from rcmqp import (
    compute_metrics,
    load_scenario,
    make_controller,
    simulate,
)
from rcmqp.cli.results import _summary, warnings


@pytest.mark.parametrize("page", ["run.h5", "other.h5", "link.html", "run.html", "page", "x.pdf"])
def test_view_writes_over_no_run_and_only_pages(call: Call, tmp_path: Path, page: str) -> None:
    """Told before a run is loaded: these are none."""
    for name in ("run.h5", "run.html", "other.h5"):
        (tmp_path / name).write_text(name)
    (tmp_path / "link.html").symlink_to("run.h5")
    runs = [str(tmp_path / name) for name in ("run.h5", "run.html")]
    code, out, err = call("view", *runs, "--html", str(tmp_path / page), "--no-open")
    assert (code, out) == (1, "")
    assert ("is one of the runs" if page.startswith(("link", "run.html")) else ".html") in err
    assert str(tmp_path / page) in err
    for name in ("run.h5", "run.html", "other.h5"):
        assert (tmp_path / name).read_text() == name


@pytest.mark.parametrize(
    ("opens", "option"), [(True, "--open"), (False, "--open"), (False, "--no-open")]
)
def test_view_says_where_no_browser_is(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, opens: bool, option: str
) -> None:
    asked: list[str] = []

    def show(url: str) -> bool:
        asked.append(url)
        return opens

    monkeypatch.setattr("webbrowser.open", show)
    monkeypatch.setattr("rcmqp.show.viewer.build.page", lambda *_, **__: "a page")
    file, page = tmp_path / "run.h5", tmp_path / "run.html"
    call(*SHORT, "--out", str(file))
    code, _, err = call("view", str(file), "--html", str(page), option)
    assert (code, asked) == (0, [page.as_uri()] if option == "--open" else [])
    assert ("no browser here" in err) == (option == "--open" and not opens)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (
            ("--acceleration", "fast"),
            "--acceleration fast: give a number, such as 8, or one",
        ),
        (("--jerk", "1,2,"), "--jerk 1,2,: give a number"),
        (("--jerk", "0"), "jerk = 0 rad/s^3, it must be positive; math.inf is no limit"),
        (("--acceleration", "1,2"), "acceleration has shape (2,), the arm has 7 joints"),
    ],
)
def test_limits_that_cannot_be_are_refused(
    call: Call, option: tuple[str, str], message: str
) -> None:
    code, _, err = call(*SHORT, *option)
    assert code == 1
    assert message in " ".join(err.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((*SHORT, "--arm", "lwa4"), "did you mean lwa3"),
        (("run", "conical_heliks"), "did you mean conical_helix"),
        ((*SHORT, "--controller", "dual_quat"), "did you mean dual_quaternion"),
        ((*SHORT, "--set", "feedforward=true"), "did you mean feed_forward"),
        ((*SHORT, "--set", "feed_forward"), "write NAME=VALUE"),
        ((*SHORT, "--set", "feed_forward=perhaps"), "must be true or false"),
        ((*SHORT, "--set", "K_c=many"), "must be a number"),
        ((*SHORT, "--set", "gain=3", "--gain", "4"), "given twice"),
        ((*SHORT, "--gain", "300"), "it must be below 2, or the law is unstable"),
        ((*SHORT, "--gain", "nan"), "gain = nan 1/s, it must be positive and finite"),
        (("run", "conical_helix", "--period", "-1"), "period = -1.0 s"),
        (("run", "conical_helix", "--duration", "nan"), "duration = nan s"),
        ((*SHORT, "--arm", "no/such.urdf", "--flange", "tool"), "no such file"),
        (("show", "no_such_run.h5"), "no such file"),
        (("show", "."), "is a folder"),
        (("run", "conical_helix", "--duration", "1e9"), "keeps at most"),
        ((*SHORT, "--out", "/dev/null"), "is no regular file"),
        (("run", "no_such_scenario.py"), "no such file"),
        (("controllers", "nonesuch"), "unknown controller"),
        (("reproduce", "--out", "/dev/null/results"), "cannot be made"),
    ],
)
def test_bad_input_ends_with_code_1_and_a_remedy(
    call: Call, arguments: tuple[str, ...], message: str
) -> None:
    code, out, err = call(*arguments)
    assert (code, out) == (1, "")
    assert err.startswith("error: ")
    assert message in err
    assert "Traceback" not in err


def test_a_run_that_leaves_what_the_trocar_allows_is_said(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = load_scenario("conical_helix", "ur5", period=0.01, duration=8.0)
    trocar = dataclasses.replace(
        scenario.trocar, cone_half_angle=math.radians(3.0), depth_range=(0.0, 0.105)
    )
    file = tmp_path / "tight.json"
    file.write_text(dataclasses.replace(scenario, trocar=trocar).to_json())
    code, _, err = call("run", str(file))
    assert code == 0
    assert re.search(r"the tip went from 100\.0 to 1\d\d\.\d mm, the trocar allows 0\.0", err)
    assert re.search(r"tilted by \d+\.\d deg, the cone allows 3\.0 deg", err)


@pytest.mark.parametrize(
    ("arguments", "where", "word"),
    [
        (SHORT, "rcmqp.cli.run.simulate", "interrupted"),
        (
            ("compare", "-s", "circle"),
            "rcmqp.experiments.compare.compare",
            "interrupted; the same command goes on from here",
        ),
        (
            ("study", "camera_task"),
            "rcmqp.experiments.study.perform.perform",
            "interrupted; the same command goes on from here",
        ),
    ],
)
def test_ctrl_c_ends_with_code_130_and_a_word(
    arguments: Sequence[str], where: str, word: str, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(where, interrupt)
    assert call(*arguments) == (130, "", f"{word}\n")


def test_ctrl_c_while_a_page_is_made_leaves_no_folder(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(runs: object, path: Path, *, dark: bool) -> None:
        path.write_text("half a page")
        raise KeyboardInterrupt

    monkeypatch.setattr("rcmqp.show.viewer.build.write_page", interrupt)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    call(*SHORT, "--out", str(tmp_path / "run.h5"))
    assert call("view", str(tmp_path / "run.h5")) == (130, "", "interrupted\n")
    assert list((tmp_path / "temporary").iterdir()) == []


def test_wrong_usage_ends_with_code_2(call: Call) -> None:
    assert call("run")[0] == 2
    assert call("run", "conical_helix", "--nonesuch")[0] == 2


def test_an_unwritable_path_is_found_before_the_run(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        pytest.fail("the run was started")

    monkeypatch.setattr("rcmqp.cli.run.simulate", never)
    for file in (tmp_path / "missing" / "run.h5", tmp_path):
        code, _, err = call(*SHORT, "--out", str(file))
        assert code == 1
        assert str(file) in err


def test_a_broken_limit_is_said_on_stderr(call: Call) -> None:
    assert call(*SHORT)[2] == ""
    hasty = ("--set", "objective=joint_centring", "--set", "K_c=1000")
    assert re.search(r"warning: \w+ at 0\.\d+ s was asked for \S+ times", call(*SHORT, *hasty)[2])
    found = call(*SHORT, *hasty, "--set", "velocity_limit=scale")[2]
    assert "speed limit" not in found
    assert re.search(r"warning: \w+ at 0\.000 s was asked for 2\d.\d times its acc", found)
    assert "the start of the objective, which dual_quaternion begins at full gain" in found
    found = call("run", "trocar_off_shaft", "--duration", "0.1")[2]
    assert re.search(r"at 0\.000 s was asked for \d+ times its acceleration", found)
    assert "the start of the objective" not in found  # it hurries to the trocar


def test_a_limit_reached_to_rounding_is_no_warning() -> None:
    scenario = load_scenario("circle", "panda", duration=0.05)
    run = simulate(
        scenario, make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    )
    metrics = dataclasses.replace(
        compute_metrics(run),
        limit_margin_min_rad=-1e-15,
        speed_ratio_max=1.0 + 1e-15,
        acceleration_ratio_max=1.0 + 1e-12,
    )
    assert warnings(run, metrics) == []
    assert "-0.000" not in "".join(_summary(metrics, "rad"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-a", "nosuch"), "unknown arm 'nosuch'"),
        (("-a", "panda", "-c", "foo"), "unknown controller 'foo'"),
        (("-a", "panda", "--jobs", "0"), "jobs = 0"),
        (("-a", "panda", "--flange", "tool0"), "--flange is for a URDF"),
        (("-a", "panda", "-c", "damped", "--set", "backend=daqp"), "option of damped 'backend'"),
        (("-a", "panda", "--set", "feed_forward"), "write NAME=VALUE"),
    ],
)
def test_compare_checks_names_before_anything_is_written(
    call: Call, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    folder = tmp_path / "comparison"
    code, _, err = call("compare", "-s", "conical_helix", *arguments, "--out", str(folder))
    assert code != 0
    assert message in err
    assert not folder.exists()


def test_an_option_that_only_python_can_give_says_so(call: Call) -> None:
    code, _, err = call(*SHORT, "-c", "hierarchical_qp", "--set", "levels=rcm")
    assert code != 0
    assert "only from Python" in err


def test_options_that_would_do_nothing_are_refused(call: Call, tmp_path: Path) -> None:
    for arguments, word in (
        (("run", "circle", "--arm", ""), "unknown arm ''"),
        ((*SHORT, "--set", "gain=50", "--set", "gain=40"), "gain is given twice"),
        (("reproduce", "-e", "b", "--duration", "3"), "--duration is not for experiment b"),
        (("reproduce", "--operators", "3"), "--operators is not for experiment a"),
        ((*SHORT, "-c", "hierarchical_qp", "--period", "0.03"), "limit_gain * period = 60.0 1/s"),
    ):
        code, _, err = call(*arguments)
        assert code == 1
        assert word in err
