"""What a new user types first: rcmqp alone, its help, its completion, and rcmqp doctor."""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import typer

from rcmqp.cli import NEXT, app, doctor, main
from rcmqp.cli.doctor import examine
from rcmqp.errors import OptionError, ToolMissing


def output(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> str:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert (ended.value.code or 0) == code
    return capsys.readouterr().out


def found() -> dict[str, doctor.Finding]:
    return {each.what: each for each in examine()}


def test_rcmqp_alone_says_what_to_do_next(capsys: pytest.CaptureFixture[str]) -> None:
    shown = output(capsys)
    known = set(typer.main.get_group(app).commands)
    for line, _ in NEXT:
        for command in line.split("; "):
            assert command.split()[0] == "rcmqp"
            assert command.split()[1] in known | {"--help"}
            assert command in shown
    assert len(shown.splitlines()) < 20


@pytest.mark.parametrize("arguments", [("-h",), ("run", "-h"), ("doctor", "-h")])
def test_h_is_help(capsys: pytest.CaptureFixture[str], arguments: Sequence[str]) -> None:
    assert "Usage: " in output(capsys, *arguments)


def test_the_shell_can_complete_commands() -> None:
    asked = {"_RCMQP_COMPLETE": "complete_bash", "COMP_WORDS": "rcmqp doc", "COMP_CWORD": "1"}
    code = "import sys; sys.argv = ['rcmqp']; from rcmqp.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | asked, capture_output=True, text=True
    )
    assert done.stdout.split() == ["doctor"]


def test_doctor_names_every_package_that_rcmqp_needs(capsys: pytest.CaptureFixture[str]) -> None:
    shown = json.loads(output(capsys, "doctor", "--json"))
    named = {each["what"]: each for each in shown}
    needed = [each for each in importlib.metadata.requires("rcmqp") or [] if ";" not in each]
    assert len(needed) > 10
    for requirement in needed:
        name = requirement.partition(">=")[0]
        assert named[name]["found"] == importlib.metadata.version(name)
        assert not named[name]["remedy"]
    assert "ok" in output(capsys, "doctor")


def test_doctor_ends_with_code_1_where_something_needed_is_old_or_missing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = ["numpy>=99.0", "no-such-package>=1.0", "nothing>=1 ; extra == 'test'"]
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: wanted)
    shown = json.loads(output(capsys, "doctor", "--json", code=1))
    remedies = {each["what"]: each["remedy"] for each in shown}
    assert remedies["numpy"] == "pip install 'numpy>=99.0'"
    assert remedies["no-such-package"] == "pip install 'no-such-package>=1.0'"
    assert "nothing" not in remedies
    assert "missing" in output(capsys, "doctor", code=1)


def test_doctor_has_a_remedy_for_everything_that_is_optional(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def missing() -> str:
        raise ToolMissing("it", "install it")

    def refused() -> Any:
        raise OptionError("raise rtprio")

    monkeypatch.setattr(doctor, "chromium_path", missing)
    monkeypatch.setattr(doctor, "ffmpeg_path", missing)
    monkeypatch.setattr(doctor, "real_time_priority", refused)
    monkeypatch.setattr(doctor, "GRAPHICS", str(tmp_path))
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    optional = [each for each in found().values() if each.state != "ok"]
    assert len(optional) == 5
    for each in optional:
        assert (each.state, each.found) == ("optional", "")
        assert each.remedy


def test_doctor_finds_what_is_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (compiler := tmp_path / "my-cc").touch(mode=0o755)
    (tmp_path / "renderD128").touch()
    monkeypatch.setenv("CC", str(compiler))
    monkeypatch.setattr(doctor, "GRAPHICS", str(tmp_path))
    monkeypatch.setattr("sys.platform", "linux")
    assert found()["C compiler, to build"].found == str(compiler)
    assert found()["graphics card, for pages"].found == str(tmp_path / "renderD128")
