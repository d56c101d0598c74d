"""What rcmqp study makes of its options."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest

from rcmqp.cli import main
from rcmqp.errors import OptionError
from rcmqp.experiments.study.plan import Law, Study
from rcmqp.experiments.study.replay import read_hands, replay
from rcmqp.references.operators import CameraTrial
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.run import Run
from rcmqp.world.instrument_file import load_instrument
from rcmqp.world.loading import load_arm

SHORT = """
import dataclasses
from rcmqp import load_scenario
def scenario(arm="panda", **options):
    return dataclasses.replace(load_scenario("camera_task", arm, **options), duration=0.4)
"""


def test_settings_of_controllers_are_laws_each_with_each_gain(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Study] = []

    def ask(chosen: Study, *_: object, **__: object) -> None:
        asked.append(chosen)
        raise OptionError("enough")

    monkeypatch.setattr("rcmqp.experiments.study.perform.perform", ask)
    settings = ["-c", "dual-quaternion:feed_forward=true,K_c=0", "-c", "damped"]
    command = ["study", "camera_task", *settings, "--out", str(tmp_path)]
    for more in ([], ["--gain", "30", "--gain", "60"]):
        with pytest.raises(SystemExit):
            main([*command, *more])
    plain, gained = asked
    law = Law("dual_quaternion", options=(("feed_forward", True), ("K_c", 0.0)))
    assert plain.laws == (law, Law("damped"))
    assert [dict(each.options).get("gain") for each in gained.laws] == [30.0, 60.0] * 2
    capsys.readouterr()
    for wrong, message in (("damped:gain=3", "given twice"), ("damped:gian=3", "did you mean")):
        with pytest.raises(SystemExit):
            main([*command, "--gain", "30", "-c", wrong])
        assert message in capsys.readouterr().err


def test_a_recorded_hand_uses_every_controller_beside_simulated_operators(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario, hand, out = (tmp_path / name for name in ("short.py", "surgeon.csv", "study"))
    scenario.write_text(SHORT, encoding="utf-8")
    lines = [f"{0.02 * k},{10.0 * (k / 100.0) ** 2},0,0" for k in range(101)]
    hand.write_text("t [s],x [mm],y [mm],z [mm]\n" + "\n".join(lines), encoding="utf-8")
    laws = ["-c", "dual_quaternion", "-c", "hierarchical_qp", "--period", "0.016"]
    command = ["study", str(scenario), *laws, "--operators", "1", "--out", str(out)]
    with pytest.raises(SystemExit, match="0"):
        main([*command, "--hand", str(hand)])
    said = capsys.readouterr().out
    for law in ("dual_quaternion", "hierarchical_qp"):
        run = Run.load(out / "recorded" / f"surgeon_panda_{law}_16ms.h5")
        assert len(run.time) == 126
        assert f"| surgeon | {law}, 16 ms |" in said
    assert len((out / "recorded.csv").read_text(encoding="utf-8").splitlines()) == 3
    assert len((out / "trials.csv").read_text(encoding="utf-8").splitlines()) == 3


def test_a_hand_is_replayed_on_the_urdf_of_another_folder(tmp_path: Path) -> None:
    urdf, hand = load_arm("lwa3").urdf, tmp_path / "surgeon.csv"
    assert urdf is not None
    arm = tmp_path / "arm.urdf"
    arm.write_text(urdf.read_text())
    hand.write_text("t,x,y,z\n" + "\n".join(f"{0.02 * k},0,0,0" for k in range(10)))
    law = Law("hierarchical_qp", 0.016)
    base = load_scenario("camera_task", str(arm), flange="flange", period=0.016)
    assert base.arm == str(arm)
    replay(read_hands([hand]), [(law, base)], tmp_path / "out")
    (file,) = (tmp_path / "out" / "recorded").iterdir()
    assert file.name.startswith("surgeon_arm_")


def test_a_recording_is_read_before_anybody_is_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def perform(*given: object, **named: object) -> None:
        raise AssertionError("operators are simulated")

    monkeypatch.setattr("rcmqp.experiments.study.perform.perform", perform)
    with pytest.raises(SystemExit, match="1"):
        main(["study", "camera_task", "--hand", str(tmp_path / "no.csv")])
    assert "no such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "performs"),
    [
        (["study", "camera_task"], "rcmqp.experiments.study.perform.perform"),
        (["reproduce", "-e", "b"], "rcmqp.experiments.study.experiment_b.perform"),
    ],
)
def test_people_of_a_study_use_the_instrument_that_is_given(
    command: list[str], performs: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Study] = []

    def ask(chosen: Study, *_: object, **__: object) -> None:
        asked.append(chosen)
        raise OptionError("enough")

    monkeypatch.setattr(performs, ask)
    (tmp_path / "scope.toml").write_text("[camera]\nangle = 0.5236\nroll = 0.2\n")
    with pytest.raises(SystemExit):
        main([*command, "--instrument", str(tmp_path / "scope.toml"), "--out", str(tmp_path)])
    made = asked[0].trials()[0].made()
    assert made.instrument == load_instrument(tmp_path / "scope.toml")
    assert isinstance(made.path, CameraTrial)
    assert made.path.task.towards == pytest.approx((0.0, 0.5, math.sqrt(0.75)), abs=1e-5)
    assert dataclasses.replace(asked[0], instrument=None).trials()[0].made() != made


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "nosuchfolder",
            "is neither a folder made by rcmqp trial nor the name of a scenario; rcmqp scenarios",
        ),
        ("camera_tsk", "nor the name of a scenario; did you mean cam"),
        (".", "the folder has no study.json; give a folder that rcmqp trial made"),
    ],
)
def test_what_is_neither_a_scenario_nor_a_trials_folder_is_said(
    name: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(["study", name])
    assert said in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []
