"""Controllers, scenarios and arms in files of one's own, and the templates of these."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest

from rcmqp import Run, compute_metrics, load_scenario
from rcmqp.cli import main
from rcmqp.controllers import CONTROLLERS
from rcmqp.controllers.settings import registered
from rcmqp.errors import OptionError, UnknownName
from rcmqp.references.paths import Circle

TWO = """
from dataclasses import dataclass
from rcmqp.controllers import Command, Controller
import numpy as np

@dataclass(frozen=True, eq=False)
class Still(Controller):
    gain: float = 1.0
    def _step(self, state, reference):
        return Command(np.zeros(state.angles.size))

@dataclass(frozen=True, eq=False)
class Stiller(Still):
    pass
"""

PLAIN = """
class Mine(Controller):
    gain: float = 1.0
    def _step(self, state, reference):
        return Command(np.zeros(state.angles.size))
"""


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rcmqp.experiments.compare._draw", lambda *_: None)


def call(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    return int(ended.value.code or 0)


def test_a_template_of_a_law_runs_as_it_stands_wherever_a_name_stands(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert call("new", "law", "swift_law") == 0
    run = ["run", "conical_helix", "-c", "swift_law.py", "--set", "gain=30", "--duration", "0.3"]
    assert call(*run, "--out", "run.h5") == 0
    found = Run.load("run.h5")
    assert (found.controller, found.options["gain"]) == ("swift_law", 30.0)
    assert compute_metrics(found).rcm_max_mm < 0.01
    assert (found.given.feed_forward, found.given.limits, found.given.roll) == (True, (), True)
    capsys.readouterr()
    laws = ["-c", "swift_law.py:SwiftLaw:gain=20", "-c", "damped", "--jobs", "2"]
    assert call("compare", "-s", "circle", *laws, "--duration", "0.1", "--json", "-o", "c") == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["controller"] for row in rows] == ["swift_law", "damped"]
    assert rows[0]["gain"] == "20"


def test_a_law_of_ones_own_is_one_of_a_study(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("new", "law", "study_law") == 0
    study = ["study", "camera_task", "-c", "study_law.py", "--operators", "2", "--jobs", "2"]
    assert call(*study, "--out", "s", "--json") == 0
    assert "study_law" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        ("scenario", ["run", "mine.py", "--duration", "0.1"]),
        ("arm", ["run", "conical_helix", "--arm", "mine.toml", "--duration", "0.1"]),
        ("arm", ["arms", "mine.toml"]),
    ],
)
def test_templates_run_as_they_stand(kind: str, command: list[str]) -> None:
    assert call("new", kind, "mine") == 0
    assert call(*command) == 0


def test_new_writes_over_nothing_and_wants_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.urdf").write_text("mine")
    assert call("new", "arm", "mine") == 1
    assert "mine.urdf is there already" in capsys.readouterr().err
    assert not Path("mine.toml").exists()
    assert Path("mine.urdf").read_text() == "mine"
    for name in ("3x", "../x", "class", "a b", "", "_", "__"):
        assert call("new", "law", name) == 1
        assert "letters, digits and underscores" in capsys.readouterr().err


def test_new_takes_controller_as_another_word_for_law(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("new", "controller", "my_own") == 0
    assert "class MyOwn(Controller):" in Path("my_own.py").read_text()
    assert call("new", "controller", "hierarchical_qp") == 1
    assert "a controller that is there already" in capsys.readouterr().err
    assert call("new", "robot", "mine") == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "unknown kind of file 'robot' (known: arm, controller, law, scenario)" in said
    assert "Value error" not in said


def test_an_annotation_without_a_dataclass_is_explained(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("mine.py").write_text(TWO.partition("@dataclass")[0] + PLAIN)
    said = "Mine has the annotation gain, but is not a dataclass, so gain is not an option of it"
    for given in (
        ["mine.py", "--gain", "30"],
        ["mine.py:gain=30"],
        ["mine.py", "--set", "gain=3"],
    ):
        assert call("run", "circle", "-c", *given) == 1
        error = " ".join(capsys.readouterr().err.split())
        assert f"{said}: write @dataclass(frozen=True, eq=False) above the class" in error
    assert call("compare", "-s", "circle", "-c", "mine.py", "--set", "gain=3", "-o", "c") == 1
    assert said in " ".join(capsys.readouterr().err.split())
    del CONTROLLERS["mine"]


@pytest.mark.parametrize(
    ("kind", "name", "said"),
    [
        ("law", "numpy", "a Python module"),
        ("law", "json", "a Python module"),
        ("law", "sys", "a Python module"),
        ("scenario", "rcmqp", "a Python module"),
        ("law", "hierarchical_qp", "a controller that is there already"),
        ("law", "command", "a name that the file needs for itself, Command"),
        ("law", "rcm_task", "a name that the file needs for itself, RcmTask"),
        ("scenario", "circle", "a scenario that is there already"),
        ("arm", "panda", "an arm that is there already"),
    ],
)
def test_new_takes_no_name_that_is_taken(
    kind: str, name: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A numpy.py in the folder would break every Python that starts there."""
    assert call("new", kind, name) == 1
    assert f"{name} is {said}" in capsys.readouterr().err
    assert list(Path().iterdir()) == []
    assert call("new", "arm", "json") == 0  # which hides nothing from Python


@pytest.mark.parametrize("setting", ["gain=-3", "gain=0", "damping=-1", "gain=2000"])
def test_the_template_of_a_law_refuses_what_makes_it_unstable(
    setting: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("new", "law", "steady_law") == 0
    assert call("run", "circle", "-c", "steady_law.py", "--set", setting) == 1
    assert re.search(rf"{setting[:4]}\w* .*it must be", capsys.readouterr().err)


def test_advice_names_options_that_the_law_has(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("new", "law", "advised_law") == 0
    ran = ("run", "into_joint_limit", "--duration", "6", "-c")
    assert call(*ran, "advised_law.py") == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "left its position limits by" in said
    assert (
        "advised_law does not count position limits; start elsewhere warning" in f"{said} warning"
    )
    assert call(*ran, "dual_quaternion") == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "try --set objective=joint_centring or --set K_c=0" in said


def test_a_file_of_several_laws_wants_one_named() -> None:
    Path("two.py").write_text(TWO)
    with pytest.raises(OptionError, match=r"several: Still, Stiller; say which, two.py:Still"):
        registered("two.py")
    assert registered("two.py:Stiller:gain=2") == "stiller:gain=2"
    assert registered("two.py:Still") == "still"
    assert registered("two.py:Still") == "still"  # and the class is the same
    with pytest.raises(UnknownName, match=r"controller in two\.py"):
        registered("two.py:Stil")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1", "one controller, and has none: write a dataclass"),
        ("import nosuch_module", "bad.py, line 1: ModuleNotFoundError"),
        ("\n\nraise ValueError('no')", "bad.py, line 3: ValueError: no"),
        ("x = 1\ny = = 2", "bad.py, line 2: SyntaxError: invalid syntax"),
        ("raise SystemExit", "bad.py, line 1: SystemExit"),
        (
            TWO.split("@dataclass(frozen=True, eq=False)\nclass Stiller")[0].replace(
                "Still", "Damped"
            ),
            "named 'damped'",
        ),
        (None, "bad.py: no such file"),
    ],
)
def test_a_file_without_a_law_is_said_in_words(
    text: str | None, said: str, tmp_path: Path
) -> None:
    if text is not None:
        Path("bad.py").write_text(text.replace("Still", "Damped"))
    with pytest.raises(OptionError, match=said):
        registered("bad.py")


def test_other_settings_are_left_as_they_are() -> None:
    for setting in ("damped", "damped:gain=3", "my-law", "x.pyc"):
        assert registered(setting) == setting


def test_a_scenarios_file_may_have_a_class_and_is_run_once_until_it_changes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Dataclasses look their annotations up in the module, which has to be known by then."""
    text = """
from __future__ import annotations
import dataclasses
from typing import ClassVar
from rcmqp import Scenario
from rcmqp.references.paths import Circle
print("run")

@dataclasses.dataclass(frozen=True)
class Size:
    most: ClassVar[float] = 0.02

def scenario(arm: str = "panda", *, flange: str | None = None) -> Scenario:
    return Scenario.on_shaft("own", arm, Circle(radius=Size.most), flange=flange)
"""
    Path("own.py").write_text(text)
    assert load_scenario("own.py", duration=0.1).path == Circle(radius=0.02)
    load_scenario("own.py")
    assert capsys.readouterr().out == "run\n"
    Path("own.py").write_text(text.replace("0.02", "0.03"))
    os.utime("own.py", ns=(1, 1))
    assert load_scenario("own.py").path == Circle(radius=0.03)


def test_an_error_in_a_law_of_ones_own_is_said_with_its_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("slip.py").write_text(
        TWO.partition("@dataclass(frozen=True, eq=False)\nclass Stiller")[0]
        .replace("Still", "Slip")
        .replace("np.zeros", "np.zeross")
    )
    assert call("run", "circle", "-c", "slip.py", "--duration", "0.1") == 1
    said = capsys.readouterr().err
    assert "slip.py, line 10, in _step: AttributeError" in said
    assert "report" not in said


def test_a_run_whose_law_is_not_here_asks_for_its_file(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert call("new", "law", "far_law") == 0
    assert call("run", "circle", "-c", "far_law.py", "--duration", "0.1", "--out", "far.h5") == 0
    del CONTROLLERS["far_law"]
    capsys.readouterr()
    assert call("run", "far.h5") == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "far.h5 was made with far_law, a law in a file of its author's" in said
    assert "give that file: --controller far_law.py:FarLaw" in said


def test_a_run_is_made_again_with_its_own_law_and_options_and_not_over_itself(
    capsys: pytest.CaptureFixture[str],
) -> None:
    law = ["-c", "damped", "--set", "gain=30", "--duration", "0.1", "--out", "run.h5"]
    assert call("run", "circle", *law) == 0
    assert call("run", "run.h5", "--out", "again.h5") == 0
    assert Run.load("again.h5").digest == Run.load("run.h5").digest
    assert call("run", "run.h5", "--set", "gain=20", "--out", "other.h5") == 0
    assert (Run.load("other.h5").controller, Run.load("other.h5").options["gain"]) == (
        "damped",
        20.0,
    )
    assert call("run", "run.h5", "--out", "run.h5") == 1
    assert "give another file" in capsys.readouterr().err
    assert call("compare", "-s", "run.h5", "-c", "damped", "-o", "c", "--json") == 0
