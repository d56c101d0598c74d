"""What the command line says of folders, names without their ending, recordings and laws."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rcmqp import load_arm
from rcmqp.cli import main
from rcmqp.cli.new import ARM
from rcmqp.controllers import CONTROLLERS
from rcmqp.errors import OptionError
from rcmqp.runs.run import Run
from rcmqp.world.arm_file import TABLES
from rcmqp.world.recorded import Recorded

SHORT = "run circle -a panda --duration 0.05"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    before = set(CONTROLLERS)
    yield
    for name in set(CONTROLLERS) - before:
        del CONTROLLERS[name]


def told(command: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and what stderr says, in one line."""
    with pytest.raises(SystemExit) as ended:
        main(shlex.split(command))
    return int(ended.value.code or 0), " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    "command",
    [
        "run d.py",
        "run d.json",
        "run d.h5",
        "run circle --arm d.toml",
        "run circle --arm d.urdf --flange tool0",
        "run circle -c d.py",
        "run circle --path d.csv",
        "run circle --motion d.csv",
        "run circle --instrument d.toml",
        "compare -s circle -a d.toml",
        "study d.h5",
        "show d.h5",
        "hands d.csv",
        "calibrate d.csv",
    ],
)
def test_a_folder_in_place_of_a_file_is_said_alike(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for ending in ("py", "json", "h5", "toml", "urdf", "csv"):
        Path(f"d.{ending}").mkdir()
    code, said = told(command, capsys)
    assert code == 1
    assert re.search(r"d\.\w+: is a folder; give ", said)


@pytest.mark.parametrize(
    ("file", "command"),
    [
        ("mine.py", "run circle -c mine"),
        ("mine.py", "compare -s circle -c mine:gain=3"),
        ("mine.py", "run mine"),
        ("mine.toml", "run circle -a mine"),
    ],
)
def test_a_name_that_is_a_files_without_its_ending_is_noticed(
    file: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path(file).write_text("")
    code, said = told(command, capsys)
    assert (code, f"'mine'; there is a file {file}: give that" in said) == (1, True)


def csv(*times: float, speed: float = 0.0, unit: str = "", sign: str = ",") -> None:
    """Write tip.csv: a way along z at ``speed`` in mm for each unit of time."""
    head = sign.join([f"t{unit}", "world x [mm]", "world y [mm]", "world z [mm]"])
    rows = [sign.join([f"{t}", "0", "0", f"{speed * t}"]) for t in times]
    Path("tip.csv").write_text("\n".join([head, *rows]))


def test_times_that_must_be_milliseconds_are_questioned() -> None:
    for unit in ("", " [s]"):
        csv(*range(0, 4000, 8), speed=0.02, unit=unit)
        with pytest.raises(OptionError, match=r"takes 3992 s and never .*0.02 mm/s; are its .* t"):
            Recorded.read("tip.csv")
    csv(*range(0, 4000, 8), speed=0.02, unit=" [ms]")
    assert Recorded.read("tip.csv").times[-1] == pytest.approx(3.992)
    for times, speed in (((0, 1, 50), 0.02), ((0, 100, 600), 2.0), ((0, 100, 4000), 0.0)):
        csv(*times, speed=speed)
        assert Recorded.read("tip.csv").times[-1] == times[-1]


@pytest.mark.parametrize(("sign", "name"), [(";", "semicolons"), ("\t", "tabs")])
def test_another_separator_is_named(sign: str, name: str) -> None:
    csv(0, 1, 2, sign=sign)
    with pytest.raises(OptionError, match=f"separated by {name}; separate them by commas"):
        Recorded.read("tip.csv")


def test_a_motion_that_ends_before_the_run_and_a_start_at_speed_are_said(
    capsys: pytest.CaptureFixture[str],
) -> None:
    csv(0, 0.01, 0.02, speed=30.0)
    code, said = told(f"{SHORT} --motion tip.csv --out run.h5", capsys)
    assert code == 0
    assert "the recorded motion ends at 0.02 s, the run at 0.05 s" in said
    assert "the recorded motion starts at 30 mm/s" in said
    assert "recorded motion ends" in told("show run.h5", capsys)[1]
    _, said = told("run circle -a panda --path tip.csv", capsys)
    assert "the recorded path starts at 30 mm/s" in said
    rest = np.linspace(0.0, 0.05, 26)
    Path("tip.csv").write_text(
        "t,world x [mm],world y [mm],world z [mm]\n"
        + "".join(f"{t},0,0,{50 * t**2}\n" for t in rest)
    )
    for option in ("--motion", "--path"):
        assert "recorded" not in told(f"{SHORT} {option} tip.csv", capsys)[1]


LAW = """
from dataclasses import dataclass
from rcmqp.controllers import Command, Controller
import numpy as np

@dataclass(frozen=True, eq=False)
class Wrong(Controller):
    def _step(self, state, reference):
        return {answer}
"""


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        ("np.zeros(7)", "a ndarray"),
        ("(np.zeros(7), 1)", "a tuple"),
        ("None", "a NoneType"),
        ("Command([0.0] * 7)", "a Command whose v is a list"),
        ("Command(None)", "a Command whose v is a NoneType"),
    ],
)
def test_a_law_that_returns_something_else_is_told_what_to_return(
    answer: str, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("wrong.py").write_text(LAW.format(answer=answer))
    code, said = told(f"{SHORT} -c wrong.py", capsys)
    assert code == 1
    assert f"wrong: _step() returned {kind}; it must return Command(v)" in said


def test_a_reports_command_makes_the_run_of_an_own_law_again(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert told("new law my_law", capsys)[0] == 0
    assert told(f"{SHORT} -c my_law.py --set gain=30 --out run.h5", capsys)[0] == 0
    del CONTROLLERS["my_law"]  # as in another process
    assert told("report run.h5 --out again", capsys)[0] == 0
    Path("my_law.py").rename("again/my_law.py")
    text = Path("again/report.md").read_text(encoding="utf-8")
    assert "# needs my_law.py in this folder\n" in text
    (command,) = re.findall(r"^rcmqp (run .*)$", text, re.MULTILINE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir("again")
        assert told(command, capsys)[0] == 0
    assert Run.load("again/run.h5").digest == Run.load("run.h5").digest


@pytest.mark.parametrize(
    "line", [x[2:] for x in ARM.splitlines() if re.match(r"# \w+ = ", x)], ids=lambda x: x[:12]
)
def test_each_line_of_the_arms_template_works_when_it_is_given(
    line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told("new arm my_robot", capsys)[0] == 0
    file = Path("my_robot.toml")
    text = file.read_text()
    assert all(f"\n[{table}]" in text for table in TABLES if table in ARM)
    file.write_text(text.replace(f"# {line}", line))
    arm = load_arm("my_robot.toml")
    key = line.partition(" ")[0]
    if '"' in line:
        assert arm.source is not None
        assert arm.source.sources[key] == "data sheet, page 12"
