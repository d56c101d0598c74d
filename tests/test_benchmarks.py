"""The benchmark, cut short: that it runs and measures what it says, not how fast anything is."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from rcmqp import _kernel, arm_names

SIMULATION = Path(__file__).parent.parent / "benchmarks" / "simulation.py"
FUZZ = Path(__file__).parent.parent / "benchmarks" / "fuzz.py"
EXTENSIONS = Path(__file__).parent.parent / "benchmarks" / "extensions.py"
SAFE_STOPS = Path(__file__).parent.parent / "benchmarks" / "safe_stops.py"
RUN = Path(__file__).parent.parent / "benchmarks" / "run.py"
LIMITS = Path(__file__).parent.parent / "benchmarks" / "limits.py"
SIZES = Path(__file__).parent.parent / "benchmarks" / "sizes.py"
REST = Path(__file__).parent.parent / "benchmarks" / "rest.py"
CASES = ("dual_quaternion", "RCM > tip > posture", "pose > posture")


def test_a_short_benchmark_follows_the_circle_and_names_a_peer_that_cannot_be_had(
    tmp_path: Path,
) -> None:
    (tmp_path / "file").touch()
    options = ["--cycles", "60", "--block", "30", "--cases", "dual_quaternion$|> posture$"]
    nowhere = ["--peers", "mink", "--envs", str(tmp_path / "file")]
    done = subprocess.run(
        [sys.executable, RUN, *options, *nowhere, "--save", tmp_path / "found.json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "found.json").read_text())["results"]
    ours = {result["case"]: result for result in found if result["package"] == "rcmqp"}
    assert sorted(ours) == sorted(CASES)
    for result in ours.values():
        assert result["failure"] == ""
        assert len(result["blocks_us"]) == 2
        assert result["cycles"] == 60
        most = 4e-3 if result["case"] == "dual_quaternion" else 2e-4  # the law lags
        assert result["tip_rms_mm"] < most  # standing still would be 5.5e-3
        assert result["rcm_max_mm"] < 1e-4
        assert result["versions"]["rcmqp"]
    (mink,) = (result for result in found if result["package"] == "mink")
    assert "not installed" in mink["failure"]
    rows = [line for line in done.stdout.splitlines() if line.startswith("| ")]
    for case in CASES:
        assert any(f"| rcmqp | {case} |" in row for row in rows)
    assert any("| mink |" in row and "not installed" in row for row in rows)


def test_a_few_safe_stops_are_inside_every_limit() -> None:
    done = subprocess.run(
        [sys.executable, SAFE_STOPS, "--states", "16"], capture_output=True, text=True, check=True
    )
    rows = [line.strip("| ").split(" | ") for line in done.stdout.splitlines()[2:]]
    assert [row[0] for row in rows] == [*arm_names(), "all"]
    assert [int(row[1]) for row in rows] == [2] * len(arm_names()) + [16]
    over, excess, longest = (float(rows[-1][column]) for column in (3, 4, 6))
    assert over < 1e-9
    assert excess < 1e-7
    assert longest < 6.0
    assert float(rows[-1][8]) < 0.05  # [mm], where the trocar can be kept


def test_what_simulate_adds_is_a_row_for_each_law() -> None:
    done = subprocess.run(
        [sys.executable, SIMULATION, "--duration", "0.05", "--rounds", "1"],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = [line.strip("| ").split(" | ") for line in done.stdout.splitlines()[2:]]
    assert [row[0] for row in rows] == ["dual_quaternion", "hierarchical_qp"]
    assert all(len(row) == 4 and float(row[1]) > 0.0 for row in rows)


def test_extensions_has_a_line_for_each_task_and_limit_in_python() -> None:
    done = subprocess.run(
        [sys.executable, EXTENSIONS, "--cycles", "120"], capture_output=True, text=True, check=True
    )
    rows = [line.strip("| ").split(" | ") for line in done.stdout.splitlines()[2:]]
    assert len(rows) == 10
    assert all(len(row) == 7 and float(row[2].split()[0]) > 0.0 for row in rows)
    in_python = {row[1] for row in rows if float(row[5].split()[0]) > 0.0}
    assert in_python == {
        "roll in Python",
        "depth limit in Python",
        "README's LevelCamera for roll",
        "README's GentleInsertion",
    }


def test_bindings_answer_or_refuse_hostile_calls_and_then_answer_as_before() -> None:
    done = subprocess.run(
        [sys.executable, FUZZ, "--calls", "3000"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    rows = [
        line.strip("| ").split(" | ") for line in done.stdout.splitlines()[2:-2] if "|" in line
    ]
    assert all(int(row[1]) > 0 for row in rows if row[0] != "no constructor")
    assert all(int(row[2]) > 0 for row in rows)
    module = {name for name, kind in vars(_kernel).items() if callable(kind)}
    assert module <= {row[0] for row in rows}


def test_rest_has_a_line_for_each_hard_view_and_each_controller_and_arm() -> None:
    """The same draws for every controller, and the fault of a law that knows no limits."""
    options = ["--runs", "1", "--arms", "meka_a2", "--no-scenarios", "--controllers"]
    done = subprocess.run(
        [sys.executable, REST, *options, "dual_quaternion", "hierarchical_qp"],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [line.strip("| ").split(" | ") for line in done.stdout.splitlines() if "|" in line]
    rows = [row for row in lines if row[0] in ("dual_quaternion", "hierarchical_qp")]
    given, hard, drawn = rows[:2], rows[2:4], rows[4:]
    assert [row[1] for row in given] == ["no", "yes"]
    assert [row[:3] for row in hard] == [
        [name, "meka_a2", "(0.0, 0.7, 0.0, 0.0)"]
        for name in ("dual_quaternion", "hierarchical_qp")
    ]
    assert [row[1:3] for row in drawn] == [["meka_a2", "1"]] * 2
    assert len(rows) == 6


def test_limits_has_a_line_for_each_arm() -> None:
    done = subprocess.run(
        [sys.executable, LIMITS, "--duration", "0.3", "--arms", "lwa3", "ur5"],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = [line.strip("| ").split(" | ") for line in done.stdout.splitlines()[2:]]
    assert [row[0] for row in rows] == ["lwa3", "ur5"]
    assert all(float(row[1].rstrip("%")) > 50.0 and float(row[5]) > 1.0 for row in rows)
    assert all(float(row[8]) >= float(row[7]) >= 1.0 for row in rows)


def test_sizes_has_a_line_for_each_number_of_levels() -> None:
    done = subprocess.run(
        [sys.executable, SIZES, "--cycles", "60", "--joints", "7"],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = [line.strip("| ").split(" | ") for line in done.stdout.splitlines()[2:]]
    assert [row[:2] for row in rows] == [["7", str(levels)] for levels in (2, 3, 4, 5, 6)]
    for row in rows:
        assert len(row) == 6
        assert all(float(cell.split(" (")[0]) > 0.0 for cell in row[2:])
        assert [cell.endswith("%)") for cell in row[2:]] == [False, True, True, True]
