"""Arms set up in one command, as the guide has them."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from public_arms import write_public_arm

from rcmqp import Run, compute_metrics, load_arm
from rcmqp.cli import main
from rcmqp.world.arm import Arm
from rcmqp.world.geometry import Collisions

ROOT = Path(__file__).parent.parent
PAIRS = re.findall(
    r"```sh\n(rcmqp new arm (\w+) .*)\n(rcmqp run .*)\n```",
    (ROOT / "docs/own-arm.md").read_text(encoding="utf-8"),
)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """With the URDFs that the guide speaks of."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "examples/psm.urdf", tmp_path)
    ur5e = write_public_arm(tmp_path, "ur5e")
    ur5e.write_text(ur5e.read_text().replace('"flange"', '"tool0"'))
    return tmp_path


def call(*words: str) -> int:
    with pytest.raises(SystemExit) as end:
        main([*words])
    return int(end.value.code or 0)


def test_the_guide_has_the_four_arms() -> None:
    assert [name for _, name, _ in PAIRS] == ["tilted", "ceiling", "on_rail", "psm"]


@pytest.mark.filterwarnings("error::rcmqp.errors.ArmWarning")
@pytest.mark.parametrize(("setup", "name", "run"), PAIRS, ids=[name for _, name, _ in PAIRS])
def test_the_guides_arms_are_set_up_and_run_in_one_command_each(
    setup: str, name: str, run: str
) -> None:
    assert call(*shlex.split(setup)[1:]) == 0
    assert call(*shlex.split(run)[1:], "--duration", "1", "--out", "run.h5") == 0
    found = Run.load("run.h5")
    metrics = compute_metrics(found)
    assert metrics.rcm_max_mm < 1e-3
    assert metrics.tip_max_mm < 0.5
    insertion = found.insertion()
    down = insertion.state(insertion.q_start).oMe.rotation[:, 2] @ [0.0, 0.0, -1.0]
    assert down > np.cos(np.radians(45.0))
    assert not Collisions(insertion.arm, insertion.instrument).first(insertion.angles_start)
    IS[name](load_arm(f"{name}.toml"), found)


def _tilted(arm: Arm, _: Run) -> None:
    frame = arm.model.frames[arm.model.getFrameId("tool0")]
    turn = frame.placement.actInv(arm.jMflange).rotation
    assert np.degrees(np.arccos(turn[2, 2])) == pytest.approx(45.0, abs=1e-3)


def _ceiling(arm: Arm, _: Run) -> None:
    first = arm.model.jointPlacements[1]
    own = load_arm("lwa3").model.jointPlacements[1]
    assert first.rotation[2, 2] == pytest.approx(-own.rotation[2, 2])
    assert first.translation[2] == pytest.approx(2.0 - own.translation[2])
    assert arm.state(arm.configuration(arm.home)).oMe.translation[2] < first.translation[2]


def _on_rail(arm: Arm, found: Run) -> None:
    assert arm.joints[0] == "rail"
    assert arm.joint_units[0] == "m"
    assert np.ptp(found.q[:, 0]) > 1e-5


def _psm(arm: Arm, found: Run) -> None:
    assert arm.joints == ("outer_yaw", "outer_pitch", "outer_insertion", "outer_roll")
    assert np.ptp(found.q[:, 2]) > 1e-5


IS = {"tilted": _tilted, "ceiling": _ceiling, "on_rail": _on_rail, "psm": _psm}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("law mine --set gain=3", "--set is of an arm's file; a law is changed in its own file"),
        ("arm mine --set like", "--set like: give a key and a value, such as like=ur5"),
        ("arm mine --set like=ur5 --set like=ur10", "--set like is there twice"),
        ("arm mine --set like=ur55", "unknown arm for like 'ur55'; did you mean ur5"),
        ("arm mine --set like=ur5 --set floor=1", "unknown key in mine.toml 'floor'"),
        ("arm mine --set like=ur5 --set a.b.c=1", "unknown key in mine.toml"),
    ],
)
def test_what_cannot_be_set_is_said_and_no_file_is_left(
    folder: Path, words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("new", *words.split()) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert said in told
    assert not (folder / "mine.toml").exists()
