"""Every example runs, and draws the picture that the gallery shows."""

from __future__ import annotations

import inspect
import re
import runpy
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib.image
import pytest

from rcmqp.references.paths import PATHS

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
SHORT = {"duration": 0.4, "period": 0.01}
"""What an example is given here, of the two that it has [s]."""


@pytest.fixture(autouse=True)
def same_paths() -> Iterator[None]:
    """What an example registers is not for the tests that follow."""
    known = dict(PATHS)
    yield
    PATHS.clear()
    PATHS.update(known)


def main_of(script: Path) -> Callable[..., None]:
    made: Callable[..., None] = runpy.run_path(str(script))["main"]
    return made


def test_there_are_twelve_numbered_from_one() -> None:
    assert [int(script.name[:2]) for script in EXAMPLES] == list(range(1, 13))


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda script: script.stem)
def test_it_is_short_and_the_gallery_has_it(script: Path) -> None:
    lines = script.read_text(encoding="utf-8").splitlines()
    assert 20 <= len(lines) <= 60
    assert re.fullmatch(r'"""[A-Z].*[.:]', lines[0]), "a title, then what it shows"
    assert (ROOT / f"docs/gallery/{script.stem}.png").is_file(), "make gallery"


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda script: script.stem)
def test_it_runs_and_draws_its_picture(
    script: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    main, picture = main_of(script), tmp_path / "drawn.png"
    given = inspect.signature(main).parameters
    assert given["picture"].default == f"{script.stem}.png"
    main(str(picture), **{name: value for name, value in SHORT.items() if name in given})
    assert capsys.readouterr().out
    pixels = matplotlib.image.imread(picture)
    assert min(pixels.shape[:2]) > 300
    assert len({tuple(pixel) for pixel in pixels[::4, ::4].reshape(-1, pixels.shape[2])}) > 20
    assert sorted(file.name for file in tmp_path.iterdir()) in (
        ["drawn.png"],
        ["drawn.pdf", "drawn.png"],
    )
