"""What the README shows is what happens."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest

from rcmqp.controllers import CONTROLLERS

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
SHOWN = re.findall(r"```python\n(.*?)```\n\n(?:```text\n(.*?)```)?", README, flags=re.DOTALL)


def test_each_program_runs_and_prints_what_stands_below_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # what they write goes there
    assert sum(bool(printed) for _, printed in SHOWN) >= 4
    for program, printed in SHOWN:
        out = io.StringIO()
        known = dict(CONTROLLERS)
        try:
            with contextlib.redirect_stdout(out):
                exec(compile(program, "README.md", "exec"), {})
        finally:  # what a reader adds is not for the tests that follow
            CONTROLLERS.clear()
            CONTROLLERS.update(known)
        assert out.getvalue() == printed or (out.getvalue() and not printed)


def test_every_file_and_test_that_it_names_is_there() -> None:
    root = Path(__file__).parents[1]
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert target.startswith("https://") or (root / target).exists(), target
    tests = "".join(path.read_text(encoding="utf-8") for path in root.glob("tests/test_*.py"))
    named = re.findall(r"`(test_\w+)`", README)
    assert named
    for name in named:
        assert f"def {name}(" in tests, name
