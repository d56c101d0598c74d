from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib.image
import numpy as np
import pytest

from rcmqp import Run, load_scenario, make_controller, simulate
from rcmqp.cli import main as command_line
from rcmqp.errors import OptionError, RunFileError, ViewError
from rcmqp.viewer import browser
from rcmqp.viewer.browser import ffmpeg_path, opened
from rcmqp.viewer.build import write_page
from rcmqp.viewer.capture import snapshot, video

if TYPE_CHECKING:
    from playwright.sync_api import Page


def main(arguments: list[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        command_line(arguments)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = load_scenario("conical_helix", "lwa3", duration=0.2, period=0.01)
    controller = make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    path = tmp_path_factory.mktemp("runs") / "run.h5"
    simulate(scenario, controller).save(path)
    return path


def test_a_page_takes_no_runs_place(file: Path) -> None:
    before = file.read_bytes()
    with pytest.raises(OptionError, match=r"run\.h5: give .* ends in \.html or \.htm"):
        write_page([Run.load(file)], file)
    assert file.read_bytes() == before


@pytest.mark.parametrize("camera", ["scene", "endoscope"])
def test_snapshot_draws_a_picture_of_the_size_asked_for(
    file: Path, tmp_path: Path, camera: str
) -> None:
    picture = tmp_path / "x.png"
    arguments = ["--time", "0.1", "--camera", camera, "--size", "320x240", "--out", str(picture)]
    main(["snapshot", str(file), *arguments])
    image = np.asarray(matplotlib.image.imread(picture))
    assert image.shape[:2] == (240, 320)
    assert len(np.unique(image[..., :3].reshape(-1, 3), axis=0)) > 200


@pytest.mark.parametrize("camera", ["scene", "endoscope"])
def test_a_picture_says_above_what_it_shows_and_large_enough(file: Path, camera: str) -> None:
    with opened([Run.load(file)], (640, 480), camera, density=2) as page:
        text = page.locator("#caption").inner_text()
        written = page.locator("#caption").bounding_box()
        shown = page.locator("#scope" if camera == "endoscope" else "#scene").bounding_box()
        sizes = page.evaluate("[innerWidth, innerHeight, devicePixelRatio]")
    assert sizes == [320, 240, 2]
    for part in ("conical_helix on Schunk LWA3", "dual_quaternion", "desired tip"):
        assert part in text
    assert written is not None
    assert shown is not None
    assert written["y"] >= 0.0
    if camera == "endoscope":  # the scene leaves room itself: its camera looks past the words
        assert written["y"] + written["height"] <= shown["y"]
        assert shown["width"] == pytest.approx(shown["height"], abs=1.0)
        assert shown["y"] + shown["height"] <= 240.5


def test_video_is_as_long_as_the_run(file: Path, tmp_path: Path) -> None:
    film = tmp_path / "x.mp4"
    main(["video", str(file), "--size", "160x120", "--speed", "0.5", "--out", str(film)])
    command = [ffmpeg_path(), "-i", str(film), "-f", "null", "-"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    seconds = (Run.load(file).time[-1]) / 0.5
    frames = int(said.rpartition("frame=")[2].split()[0])
    assert frames == round(30 * seconds) + 1


def program(folder: Path, name: str, text: str) -> str:
    """A shell script of that name, and the path that finds it first."""
    script = folder / name
    script.write_text(f"#!/bin/sh\n{text}\n")
    script.chmod(0o755)
    return f"{folder}{os.pathsep}{os.environ['PATH']}"


def test_a_browser_that_cannot_draw_is_found_at_once(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(browser, "FLAGS", ("--disable-3d-apis", "--no-first-run"))
    monkeypatch.setattr(browser, "PATIENCE", 1e4)
    with pytest.raises(ViewError, match=r"does not open in Chromium: Error creating WebGL"):
        snapshot([Run.load(file)], tmp_path / "x.png", size=(64, 64))


def test_a_browser_that_dies_is_an_error_of_one_line(file: Path, tmp_path: Path) -> None:
    def crash(page: Page) -> None:
        assert page.context.browser is not None
        page.context.browser.new_browser_cdp_session().send("Browser.crash")

    with pytest.raises(ViewError, match="Chromium stopped at its work") as raised:
        with opened([Run.load(file)], (64, 64)) as page:
            crash(page)
    assert "\n" not in str(raised.value)


def test_a_browser_that_does_not_start_is_an_error_of_one_line(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", program(tmp_path, "chromium", "exit 3"))
    with pytest.raises(ViewError, match=rf"{tmp_path}/chromium does not start: ") as raised:
        snapshot([Run.load(file)], tmp_path / "x.png")
    assert "\n" not in str(raised.value)


def test_what_a_failing_ffmpeg_says_is_said_and_nothing_is_left(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bin").mkdir()
    fail = program(tmp_path / "bin", "ffmpeg", "echo no such codec >&2; exit 1")
    monkeypatch.setenv("PATH", fail)
    with pytest.raises(RunFileError, match=r"x\.mp4: ffmpeg could not write it: no such codec"):
        video([Run.load(file)], tmp_path / "x.mp4", size=(64, 64))
    assert [path.name for path in tmp_path.iterdir()] == ["bin"]


def test_ctrl_c_ends_with_one_word_and_leaves_nothing(file: Path, tmp_path: Path) -> None:
    """A terminal tells every process that it started, the browser's too: so does this ffmpeg."""
    (tmp_path / "bin").mkdir()
    path = program(tmp_path / "bin", "ffmpeg", "head -c 1 >/dev/null; kill -INT 0")
    command = [sys.executable, "-m", "rcmqp", "video", str(file), "--size", "64x64"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "x.mp4")],
        capture_output=True,
        text=True,
        env={**os.environ, "PATH": path, "TMPDIR": str(tmp_path)},
        start_new_session=True,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")
    assert [each.name for each in tmp_path.iterdir()] == ["bin"]
