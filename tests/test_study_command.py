"""What rcmqp study makes of its options."""

from __future__ import annotations

from pathlib import Path

import pytest

from rcmqp.cli import main
from rcmqp.errors import OptionError
from rcmqp.experiments.study.plan import Law, Study


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
