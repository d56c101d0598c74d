"""The command line as a user types it: its exit code, and what it prints."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from helpers import SHORT, Call

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
from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.references.governor import Governor
from rcmqp.runs.vocabulary import AFTER_THE_STOP

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
    for name in (*AFTER_THE_STOP, "late_share", "behind_s"):
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


def test_no_two_controllers_are_described_alike(call: Call) -> None:
    table = call("controllers")[1]
    assert "task_priority, with" in table
    assert table.count("The law that the paper") == 1  # its lines are broken by the width


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


def test_help_teaches_with_an_example_and_says_the_exit_codes(call: Call) -> None:
    assert "Exit codes: 0 done; 1 refused" in " ".join(call("--help")[1].split())
    assert "rcmqp run conical_helix --arm meka_a2" in call("run", "--help")[1]


@pytest.mark.parametrize("command", ["run", "study"])
def test_help_keeps_the_units_in_brackets(call: Call, command: str) -> None:
    assert "x [mm]" in call(command, "--help")[1]


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
        ("def scenario(): pass", "or its scenario() takes other arguments"),
        ("def scenario(arm): pass", "has no function scenario(arm, *, flange=None)"),
        (
            "def scenario(arm, *, flange=None): 1 / 0",
            "mine.py, line 1: ZeroDivisionError: division",
        ),
        ("def scenario(arm, *, flange=None): load", "mine.py, line 1: NameError: name 'load'"),
        ("\nimport nonesuch", "mine.py, line 2: ModuleNotFoundError"),
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
    assert "is a file" in call("show", str(file), "--figures", str(file))[2]
    own.write_text(urdf.read_text().replace('velocity="', 'velocity="1'))
    assert call("show", str(file), "--figures", folder)[0] == 0
    assert call("view", str(file), "--no-open", "--html", str(tmp_path / "run.html"))[0] == 0


def test_python_dash_m_is_the_command_line() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rcmqp", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip().count(".") == 2
