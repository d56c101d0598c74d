"""The command line as a user types it: its exit code, and what it prints."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeAlias

import pytest

from rcmqp import (
    Run,
    arm_names,
    compute_metrics,
    load_arm,
    load_scenario,
    make_controller,
    scenario_names,
    simulate,
)
from rcmqp.cli import main
from rcmqp.cli.results import _summary, warnings
from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.references.governor import Governor
from rcmqp.runs.vocabulary import AFTER_THE_STOP

Call: TypeAlias = Callable[..., tuple[int, str, str]]

PROMISED_METRICS = {  # names that others script against
    "tip_rms_mm",
    "tip_max_mm",
    "effector_rms_mm",
    "effector_max_mm",
    "rcm_rms_mm",
    "rcm_max_mm",
    "orientation_rms_mrad",
    "speed_ratio_max",
    "limit_margin_min_rad",
    "singular_value_min",
    "solve_time_median_us",
    "solve_time_p99_us",
    "errors_until_s",
    "reversals_in_a_row",
    "step_ratio_max",
    "swing_ratio_end",
    "overshoot_max_mm",
    "settling_time_s",
}
SHORT = ("run", "conical_helix", "--duration", "0.1", "--period", "0.01")


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Call:
    """Run a command line: exit code, stdout, stderr."""

    def run(*arguments: str) -> tuple[int, str, str]:
        capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            main(arguments)
        code = stop.value.code
        return int(code or 0), *capsys.readouterr()

    return run


def read_json(text: str) -> Any:
    return json.loads(text)


def test_a_governor_is_put_in_and_taken_out(call: Call, tmp_path: Path) -> None:
    """Its own file says what it does; the path is not done when the time is up."""
    line = ("run", "fast_helix", "--arm", "ur5", "--controller", "hierarchical_qp")
    code, out, _ = call(*line, "--governor", "--out", str(tmp_path / "run.h5"))
    assert code == 0
    run = Run.load(tmp_path / "run.h5")
    assert run.scenario == load_scenario("fast_helix", "ur5", governor=Governor())
    done = run.path_time[-1] / run.scenario.path.duration
    behind = run.time[-1] - run.path_time[-1]
    assert 0.05 < done < 0.99
    assert f"{100 * done:.1f} % done at the end, its clock {behind:.3f} s behind" in out
    (tmp_path / "governed.json").write_text(run.scenario.to_json(), encoding="utf-8")
    again = ("run", str(tmp_path / "governed.json"), "--controller", "hierarchical_qp", "--json")
    found = read_json(call(*again)[1])
    assert found["digest"] == run.digest
    assert found["path_done"] == done
    found = read_json(call(*again, "--no-governor")[1])
    assert found["path_done"] is None
    assert found["digest"] == simulate_fast_helix().digest
    code, _, err = call("run", "camera_task", "--governor")
    assert (code, "cannot slow a CameraTrial" in " ".join(err.split())) == (1, True)


def simulate_fast_helix() -> Run:
    scenario = load_scenario("fast_helix", "ur5")
    return simulate(
        scenario, make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    )


def test_compare_puts_a_governor_in_too(call: Call, tmp_path: Path) -> None:
    chosen = ("compare", "-s", "fast_helix", "-a", "ur5", "-c", "hierarchical_qp", "--json")
    line = (*chosen, "--acceleration", "inf")
    (plain,) = read_json(call(*line, "--out", str(tmp_path / "plain"))[1])
    (governed,) = read_json(call(*line, "--governor", "--out", str(tmp_path / "governed"))[1])
    assert governed["contour_max_mm"] < 0.3 * plain["contour_max_mm"]
    assert governed["lag_max_s"] > plain["lag_max_s"] > 0.0


def test_run_prints_one_json_object_with_the_promised_names(call: Call) -> None:
    code, out, err = call(*SHORT, "--arm", "meka_a2", "--seed", "3", "--json")
    found = read_json(out)
    assert (code, err) == (0, "")
    assert (found["scenario"], found["arm"]) == ("conical_helix", "meka_a2")
    assert found["controller"] == "dual_quaternion"
    assert (found["period"], found["duration"], found["seed"]) == (0.01, 0.1, 3)
    assert set(found["versions"]) >= {"rcmqp", "pin", "numpy"}
    assert set(found["metrics"]) >= PROMISED_METRICS
    assert found["metrics"].pop("obstacle_distance_min_mm") is None  # there is no obstacle
    assert found["assumed"] == ["acceleration", "jerk"]
    for name in AFTER_THE_STOP:
        assert found["metrics"].pop(name) is None  # the helix goes on to the end
    assert all(isinstance(value, float) for value in found["metrics"].values())


def test_period_gain_and_settings_reach_the_controller(call: Call) -> None:
    settings = ("--set", "feed_forward=true", "--set", "K_c=0", "--set", "velocity_limit=clip")
    _, out, _ = call(*SHORT, "--gain", "30", *settings, "--json")
    options = read_json(out)["options"]
    assert options["gain"] == 30.0
    assert options["feed_forward"] is True
    assert options["K_c"] == 0.0
    assert options["velocity_limit"] == "clip"


def test_a_run_written_is_the_run_shown(call: Call, tmp_path: Path) -> None:
    file = tmp_path / "helix.h5"
    _, written, _ = call(*SHORT, "--out", str(file), "--json")
    _, shown, _ = call("show", str(file), "--json")
    assert read_json(shown) == read_json(written)
    assert Run.load(file).digest == read_json(written)["digest"]


def test_run_and_show_name_every_error_and_the_file(call: Call, tmp_path: Path) -> None:
    file = tmp_path / "helix.h5"
    code, out, _ = call(*SHORT, "--out", str(file))
    assert code == 0
    for text in ("tip mm", "effector mm", "RCM mm", "orientation mrad", "joint speed", str(file)):
        assert text in out
    assert call("show", str(file))[1] == out


def test_an_error_too_small_for_its_decimal_places_has_three_digits(
    call: Call, tmp_path: Path
) -> None:
    file = tmp_path / "helix.h5"
    out = call(*SHORT, "--controller", "hierarchical-qp", "--out", str(file))[1]
    found = compute_metrics(Run.load(file))
    cells = next(line.split()[2:] for line in out.splitlines() if "RCM mm" in line)
    assert 0.0 < found.rcm_rms_mm < 1e-4
    assert cells[0] == f"{found.rcm_rms_mm:.3g}"
    for cell, value in zip(
        cells, (found.rcm_rms_mm, found.rcm_p95_mm, found.rcm_max_mm), strict=True
    ):
        assert math.isclose(float(cell), value, rel_tol=5e-3, abs_tol=5e-6)
    assert found.orientation_max_mrad > 1e-4
    assert f"  {found.orientation_max_mrad:.5f} " in out


def test_show_draws_figures(call: Call, tmp_path: Path) -> None:
    file, folder = tmp_path / "helix.h5", tmp_path / "figures"
    call(*SHORT, "--out", str(file))
    code, out, _ = call("show", str(file), "--figures", str(folder))
    names = {path.name for path in folder.iterdir()}
    assert code == 0
    assert names == {
        f"helix_{kind}{end}" for kind in ("trajectory", "errors") for end in (".png", ".pdf")
    }
    assert all(name in out.replace("\n", "") for name in names)


def test_what_is_written_is_named_as_it_is(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Brackets and colons are no markup, wherever they are in a name."""
    folder = tmp_path / "a[b]" / "c[/b] :x:"
    folder.mkdir(parents=True)
    made = SimpleNamespace(table="", beside=[], files=[folder])
    monkeypatch.setattr("rcmqp.experiments.experiment_a.reproduce_a", lambda *_, **__: made)
    monkeypatch.setattr("rcmqp.show.viewer.build.page", lambda *_, **__: "a page")
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda _, part, **__: part.touch())
    file = str(folder / "run[red].h5")
    call(*SHORT, "--out", file)
    short = ("-s", "circle", "-a", "lwa3", "-c", "damped", "--duration", "0.05")
    for arguments, count in (
        (("show", file, "--figures", str(folder / "figures[/]")), 4),
        (("view", file, "--html", str(folder / "run[a].html"), "--no-open"), 1),
        (("report", file, "--out", str(folder / "report")), 10),
        (("compare", *short, "--out", str(folder / "compared")), 1),
        (("reproduce", "--out", str(folder)), 1),
    ):
        code, out, _ = call(*arguments)
        written = re.findall(
            r"^wrote (.*?)(?: \(\d+\.\d MB\)|: all columns.*)?$", out, re.MULTILINE
        )
        assert (code, len(written)) == (0, count)
        assert all(Path(name).exists() for name in written)


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


def test_view_is_dark_where_it_is_to_be(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "rcmqp.show.viewer.build.page", lambda _, dark: "dark" if dark else "light"
    )
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    file, page = str(tmp_path / "run.h5"), tmp_path / "run.html"
    call(*SHORT, "--out", file)
    for options, theme in (((), "light"), (("--dark",), "dark")):
        call("view", file, "--html", str(page), "--no-open", *options)
        out = call("view", file, "--no-open", *options)[1]
        temporary = Path(out.removeprefix("wrote ").partition(" (")[0])
        assert temporary.parent.parent == tmp_path
        assert page.read_text() == temporary.read_text() == theme


def test_lists_hold_the_whole_registries(call: Call) -> None:
    arms = read_json(call("arms", "--json")[1])
    assert [arm["name"] for arm in arms] == arm_names()
    assert all(arm["reach"] > 0.3 and arm["licence"] and arm["joints"] for arm in arms)
    assert list(read_json(call("scenarios", "--json")[1])) == scenario_names()
    controllers = read_json(call("controllers", "--json")[1])
    assert controllers == {name: controller_options(name) for name in CONTROLLERS}


@pytest.mark.parametrize("command", ["arms", "scenarios", "controllers"])
def test_tables_name_every_entry(call: Call, command: str) -> None:
    _, table, _ = call(command)
    for entry in read_json(call(command, "--json")[1]):
        assert (entry["name"] if command == "arms" else entry) in table


def test_one_arm_and_one_controller_are_explained(call: Call) -> None:
    _, out, _ = call("arms", "kinova")
    assert "j2s6s200_joint_1" in out
    assert "inf" in out  # continuous
    assert "Departures:" in call("controllers", "dual-quaternion")[1]


def test_what_is_assumed_of_an_arm_is_said(call: Call) -> None:
    for name, assumed in (("panda", []), ("lwa3", ["jerk"]), ("ur5", ["acceleration", "jerk"])):
        assert read_json(call("arms", name, "--json")[1])[0]["assumed"] == assumed
        _, out, _ = call("arms", name)
        assert out.count(" assumed ") == load_arm(name).nv * len(assumed)
        assert ("Assumed, as no source gives it" in out) == bool(assumed)
    row = next(line for line in call("arms")[1].splitlines() if "meka_a2" in line)
    assert " both " in row


def test_limits_are_given_on_the_command_line_and_said_in_the_summary(call: Call) -> None:
    short = (*SHORT, "--arm", "ur5")
    words = "feed-forward: no, roll controlled: yes, joint limits enforced: none, "
    words += "T = 10 ms, K = 60 1/s, limits assumed"
    assert f"{words}: acceleration and jerk\n" in call(*short)[1]
    given = ("--acceleration", "8", "--jerk", "inf,9,9,9,9,9")
    _, out, _ = call(*short, *given)
    assert f"{words}: none\n" in out
    found = read_json(call(*short, *given, "--json")[1])
    assert found["assumed"] == []
    assert found["given"] == {
        "feed_forward": "no",
        "roll": "yes",
        "limits_enforced": "none",
        "period_ms": "10",
        "gain": "60",
        "assumed": "none",
        "setup": "default",
    }
    ratio = read_json(call(*short, "--json")[1])["metrics"]["acceleration_ratio_max"]
    own = load_arm("ur5").acceleration
    assert 0.75 < found["metrics"]["acceleration_ratio_max"] / (ratio * own[0] / 8.0) < 1.05
    _, out, _ = call(*short, "--acceleration", "inf")
    assert out.count("no limit") == 2
    found = read_json(call(*short, "--acceleration", "inf", "--json")[1])["metrics"]
    assert found["acceleration_ratio_max"] is found["jerk_ratio_max"] is None


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


def test_help_teaches_with_an_example_and_says_the_exit_codes(call: Call) -> None:
    assert "Exit codes: 0 done; 1 refused" in " ".join(call("--help")[1].split())
    assert "rcmqp run conical_helix --arm meka_a2" in call("run", "--help")[1]


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


def test_overshoot_is_said(call: Call) -> None:
    assert "above 1 the law overshoots" in call(*SHORT, "--gain", "130")[2]


def test_what_is_not_finite_is_null_in_json(call: Call, tmp_path: Path) -> None:
    urdf = load_arm("kinova").urdf
    assert urdf is not None
    text = re.sub(r'type="revolute"', 'type="continuous"', urdf.read_text())
    file = tmp_path / "endless.urdf"
    file.write_text(text)
    arm = ("--arm", str(file), "--flange", "j2s6s200_end_effector")
    code, out, _ = call("run", "conical_helix", *arm, "--duration", "0.05", "--json")
    assert code == 0
    assert read_json(out)["metrics"]["limit_margin_min_rad"] is None


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
    assert re.search(r"warning: the joints were asked for up to 2\d.\d times their acc", found)


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


@pytest.mark.parametrize("name", scenario_names())
def test_scenario_files_run_by_themselves(name: str) -> None:
    file = Path(__file__).parents[1] / "scenarios" / f"{name}.py"
    command = [sys.executable, str(file), "--duration", "0.05", "--arm", "ur5", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert read_json(done.stdout)["scenario"] == name


def test_a_scenario_file_of_ones_own_runs(call: Call, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "import dataclasses\nfrom rcmqp import load_scenario\n"
        "def scenario(arm='lwa3', *, flange=None):\n"
        "    return dataclasses.replace(load_scenario('conical_helix', arm), name='mine')\n"
    )
    _, out, _ = call("run", str(file), "--duration", "0.05", "--arm", "panda", "--json")
    assert (read_json(out)["scenario"], read_json(out)["arm"]) == ("mine", "panda")
    for content, message in (
        ("", "has no function scenario"),
        ("scenario = 5", "has no function scenario(arm, *, flange=None)"),
        ("def scenario(): pass", "has no function scenario(arm, *, flange=None)"),
        ("def scenario(arm): pass", "has no function scenario(arm, *, flange=None)"),
        ("def scenario(arm, *, flange=None): 1 / 0", "cannot be run: ZeroDivisionError: division"),
        ("def scenario(arm, *, flange=None): load", "cannot be run: NameError: name 'load'"),
        ("import nonesuch", "cannot be run: ModuleNotFoundError"),
        ("def scenario(arm='', *, flange=None): return 5", "returned int, it must be a Scenario"),
    ):
        file.write_text(content)
        assert message in call("run", str(file))[2]
    file.write_text("def scenario(): pass")
    code, out, _ = call("compare", "-s", str(file), "-c", "damped", "-o", str(tmp_path), "--json")
    assert (code, out) == (1, "")


def test_a_json_scenario_has_its_own_arm(call: Call, tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_text(load_scenario("conical_helix", "ur5", duration=0.05).to_json())
    assert read_json(call("run", str(file), "--json")[1])["arm"] == "ur5"
    assert "has its own arm, ur5" in call("run", str(file), "--arm", "panda")[2]
    file.write_text("{}")
    assert str(file) in call("run", str(file))[2].replace("\n", "")


def test_figures_of_a_run_are_of_the_urdf_that_it_was_made_with(
    call: Call, tmp_path: Path
) -> None:
    urdf = load_arm("lwa3").urdf
    assert urdf is not None
    own, file, folder = tmp_path / "own.urdf", tmp_path / "run.h5", str(tmp_path / "figures")
    own.write_text(urdf.read_text())
    call(*SHORT, "--arm", str(own), "--flange", "flange", "--out", str(file))
    assert call("show", str(file), "--figures", folder)[0] == 0
    assert "cannot be made" in call("show", str(file), "--figures", str(file))[2]
    own.write_text(urdf.read_text().replace('velocity="', 'velocity="1'))
    assert call("show", str(file), "--figures", folder)[0] == 0
    assert call("view", str(file), "--no-open", "--html", str(tmp_path / "run.html"))[0] == 0


def test_python_dash_m_is_the_command_line() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rcmqp", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip().count(".") == 2


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
