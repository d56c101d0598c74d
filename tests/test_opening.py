"""The token of a live page's address is in no argument of a process."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from rcmqp.cli import main
from rcmqp.live.console import LiveReport

ADDRESS = "http://127.0.0.1:1/?token=secret"


@pytest.mark.parametrize(
    ("command", "serve", "ended"),
    [
        (["live"], "rcmqp.live.console.run_live", LiveReport("", "")),
        (["trial", "camera_task", "--out", "study"], "rcmqp.live.console.run_trial", ""),
    ],
)
def test_the_browser_is_given_a_file_that_only_this_user_can_read(
    command: list[str], serve: str, ended: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Path] = []

    def look(uri: str) -> None:
        assert "secret" not in uri
        opened.append(Path(urlsplit(uri).path))
        assert stat.S_IMODE(opened[0].stat().st_mode) == 0o600
        assert f"url={ADDRESS}" in opened[0].read_text()

    def served(*given: Any, started: Any, **options: Any) -> Any:
        started(ADDRESS)
        return ended

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", look)
    monkeypatch.setattr(serve, served)
    with pytest.raises(SystemExit, match="0"):
        main(command)
    assert len(opened) == 1
    assert not opened[0].exists()
