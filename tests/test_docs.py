"""What the site's pages show is what happens."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import sys
import warnings
from collections.abc import Iterator, MutableMapping
from pathlib import Path
from typing import Any

import pytest

from rcmqp.controllers import CONTROLLERS
from rcmqp.plants import PLANTS
from rcmqp.references.paths import PATHS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
SHOWN = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?", re.DOTALL | re.MULTILINE)
PAGES = sorted(page for page in DOCS.glob("**/*.md") if page.parts[-2] != "generated")
PROGRAMS = [
    page
    for page in PAGES
    if SHOWN.search(page.read_text(encoding="utf-8"))
    and page.stem not in ("handbook", "plugins")  # test_readme.py, test_plugins.py
]

sys.path.insert(0, str(DOCS / "_ext"))

from plain_docstrings import as_rst  # noqa: E402


@pytest.fixture(autouse=True)
def same_registries() -> Iterator[None]:
    """What a page registers is not for the tests that follow."""
    registries: list[MutableMapping[str, Any]] = [CONTROLLERS, PATHS, PLANTS]
    known = [dict(registry) for registry in registries]
    yield
    for registry, before in zip(registries, known, strict=True):
        registry.clear()
        registry.update(before)


@pytest.mark.parametrize("page", PROGRAMS, ids=lambda page: page.stem)
def test_the_programs_of_a_page_run_and_print_what_stands_below(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")  # which pages name
    monkeypatch.chdir(tmp_path)
    known: dict[str, object] = {"__name__": "__main__"}
    for program, printed in SHOWN.findall(page.read_text(encoding="utf-8")):
        out = io.StringIO()
        with warnings.catch_warnings(), contextlib.redirect_stdout(out):
            if "distributed" in program:
                warnings.simplefilter("ignore")  # Dask's own
            exec(compile(program, str(page), "exec", dont_inherit=True), known)
        assert out.getvalue() == printed


def test_every_guide_has_a_program() -> None:
    guides = {page.stem for page in DOCS.glob("guides/*.md")}
    assert len(guides) >= 12
    assert guides <= {page.stem for page in PROGRAMS}


def test_every_page_is_in_a_table_of_contents() -> None:
    listed = set()
    for page in (DOCS / "index.md", DOCS / "reference/index.md"):
        text = page.read_text(encoding="utf-8")
        for tree in re.findall(r"```\{toctree\}\n(.*?)```", text, re.DOTALL):
            entries = [x for x in tree.split() if not x.startswith(":")]
            listed |= {(page.parent / f"{entry}.md").resolve() for entry in entries}
    assert {page.resolve() for page in PAGES} - listed == {(DOCS / "index.md").resolve()}


def test_docstrings_become_text_that_says_the_same() -> None:
    lines = ["Of |v| and K_, with ``a*b``.", "", "    x = y*", "", "Args:", "    k: of 2*T."]
    made = as_rst(lines)
    assert made[0] == r"Of \|v\| and K\_, with ``a*b``."
    assert made[2:5] == ["::", "", "    x = y*"]
    assert made[-1] == r"    k: of 2\*T."


def test_every_test_that_a_page_names_is_there() -> None:
    tests = "".join(path.read_text(encoding="utf-8") for path in ROOT.glob("tests/test_*.py"))
    named = {
        name for page in PAGES for name in re.findall(r"`(test_\w+)`", page.read_text("utf-8"))
    }
    assert len(named) > 10
    assert {name for name in named if f"def {name}(" not in tests} == set()
