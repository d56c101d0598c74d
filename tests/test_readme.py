"""What the README shows is what happens."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import PIL.Image
import PIL.ImageSequence
import pytest

from rcmqp.controllers import CONTROLLERS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
HANDBOOK = (ROOT / "docs" / "handbook.md").read_text(encoding="utf-8")
PROGRAM = re.compile(r"```python\n(.*?)```\n\n(?:```text\n(.*?)```)?", re.DOTALL)
NUMBER = re.compile(r"\d[\d.e+-]*")

MOST_WORDS = 1300


@pytest.mark.parametrize(
    ("page", "least"), [(README, 1), (HANDBOOK, 4)], ids=["README", "handbook"]
)
def test_each_program_runs_and_prints_what_stands_below_it(
    page: str, least: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # what they write goes there
    shown = PROGRAM.findall(page)
    assert sum(bool(printed) for _, printed in shown) >= least
    for program, printed in shown:
        out = io.StringIO()
        known = dict(CONTROLLERS)
        try:
            with contextlib.redirect_stdout(out):
                exec(compile(program, "page", "exec"), {})
        finally:  # what a reader adds is not for the tests that follow
            CONTROLLERS.clear()
            CONTROLLERS.update(known)
        assert out.getvalue() == printed or (out.getvalue() and not printed)


def test_every_file_that_it_names_is_there() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert target.startswith("https://") or (ROOT / target).exists(), target


def test_its_picture_moves() -> None:
    first = re.search(r"!\[.+\]\((.+)\)", README)
    assert first
    with PIL.Image.open(ROOT / first[1]) as picture:
        assert sum(1 for _ in PIL.ImageSequence.Iterator(picture)) > 20
        assert (ROOT / first[1]).stat().st_size < 3e6


def test_it_is_short() -> None:
    assert len(README.split()) <= MOST_WORDS


def rows_of(page: str) -> list[list[str]]:
    """The cells of every row of its tables."""
    return [
        [*map(str.strip, line.split("|")[1:-1])] for line in page.splitlines() if line[:1] == "|"
    ]


def test_the_numbers_of_its_tables_stand_in_one_row_of_those_that_are_measured_again() -> None:
    measured = [set(row) for page in ROOT.glob("docs/*.md") for row in rows_of(page.read_text())]
    for row in rows_of(README):
        numbers = {cell for cell in row[1:] if NUMBER.fullmatch(cell)}
        assert not numbers or any(numbers <= known for known in measured), row
