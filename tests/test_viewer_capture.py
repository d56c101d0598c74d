from __future__ import annotations

import io
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib.image
import numpy as np
import pytest

from rcmqp import Run, load_scenario, make_controller, simulate
from rcmqp.cli import main as command_line
from rcmqp.errors import OptionError, RunFileError, ViewError
from rcmqp.maths.dualquaternion import Array
from rcmqp.show.viewer import browser, capture
from rcmqp.show.viewer.browser import ffmpeg_path, opened
from rcmqp.show.viewer.build import write_page
from rcmqp.show.viewer.capture import snapshot, video

if TYPE_CHECKING:
    from playwright.sync_api import Page


def main(arguments: list[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        command_line(arguments)


TIME, SPEED = 5.0 / 3.0, 25.0
"""An instant of the run [s]; the video that goes this fast shows it in its third picture."""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = load_scenario("conical_helix", "lwa3", duration=2.0, period=0.01)
    controller = make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    path = tmp_path_factory.mktemp("runs") / "run.h5"
    simulate(scenario, controller).save(path)
    return path


class Shown:
    """A camera's pane of the open page, fine, and the endoscope's dark: what is to be drawn."""

    def __init__(self, file: Path, camera: str) -> None:
        self.camera, self.dark = camera, camera == "endoscope"
        with opened([Run.load(file)], (640, 480), camera, density=2, dark=self.dark) as page:
            self.text = page.locator("#caption").inner_text()
            self.written = page.locator("#caption").bounding_box()
            self.pane = page.locator("#scope" if self.dark else "#scene").bounding_box()
            self.sizes = page.evaluate("[innerWidth, innerHeight, devicePixelRatio]")
            self.pictures = [self._picture(page, t) for t in (0.0, TIME)]

    def _picture(self, page: Page, t: float) -> Array:
        page.evaluate("t => (rcmqp.seek(t), rcmqp.draw())", t)
        return pixels(io.BytesIO(page.screenshot()))


@pytest.fixture(scope="module", params=["scene", "endoscope"])
def shown(request: pytest.FixtureRequest, file: Path) -> Shown:
    return Shown(file, request.param)


def pixels(file: Path | io.BytesIO) -> Array:
    """Of a PNG (height, width, 3), 0 to 255."""
    return np.asarray(255.0 * matplotlib.image.imread(file)[..., :3])


def test_a_page_takes_no_runs_place(file: Path) -> None:
    before = file.read_bytes()
    with pytest.raises(OptionError, match=r"run\.h5: give .* ends in \.html or \.htm"):
        write_page([Run.load(file)], file)
    assert file.read_bytes() == before


def test_snapshot_draws_what_the_page_shows_at_that_time(
    file: Path, tmp_path: Path, shown: Shown
) -> None:
    picture = tmp_path / "x.png"
    arguments = ["--time", repr(TIME), "--camera", shown.camera, "--size", "640x480"]
    dark = ["--dark"] if shown.dark else []
    main(["snapshot", str(file), *arguments, *dark, "--out", str(picture)])
    image = pixels(picture)
    assert image.shape == (480, 640, 3)
    start, then = shown.pictures
    assert np.abs(image - then).mean() < 0.05
    assert np.abs(image - start).mean() > 1.0
    corners = image[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert (corners.max() < 64.0) if shown.dark else (corners.min() > 250.0)


def test_a_picture_says_above_what_it_shows_and_large_enough(shown: Shown) -> None:
    assert shown.sizes == [320, 240, 2]
    for part in ("conical_helix on Schunk LWA3", "dual_quaternion", "desired tip"):
        assert part in shown.text
    written, pane = shown.written, shown.pane
    assert written is not None
    assert pane is not None
    assert written["y"] >= 0.0
    if shown.camera == "endoscope":  # the scene's camera looks past the words
        assert written["y"] + written["height"] <= pane["y"]
        assert pane["width"] == pytest.approx(pane["height"], abs=1.0)
        assert pane["y"] + pane["height"] <= 240.5


@pytest.mark.parametrize("shown", ["endoscope"], indirect=True)
def test_video_shows_the_run_from_beginning_to_end_at_its_speed(
    file: Path, tmp_path: Path, shown: Shown
) -> None:
    film = tmp_path / "x.mp4"
    arguments = ["--camera", "endoscope", "--dark", "--speed", str(SPEED), "--size", "640x480"]
    main(["video", str(file), *arguments, "--out", str(film)])
    ask = ["-show_entries", "stream=r_frame_rate,duration", "-of", "csv=p=0", str(film)]
    said = subprocess.run(["ffprobe", "-v", "error", *ask], capture_output=True, check=True)
    rate, seconds = said.stdout.decode().strip().split(",")
    assert rate == "30/1"
    assert float(seconds) == pytest.approx(4.0 / 30.0, abs=1e-4)
    command = [ffmpeg_path(), "-v", "error", "-i", str(film), "-f", "rawvideo"]
    raw = subprocess.run([*command, "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
    frames = np.frombuffer(raw.stdout, dtype=np.uint8).reshape(-1, 480, 640, 3).astype(float)
    assert len(frames) == 4  # at 0, 0.83, 1.67 and 2 s of the run
    for picture, k in zip(shown.pictures, (0, 2), strict=True):
        off = np.abs(frames - picture).mean(axis=(1, 2, 3))
        assert np.argmin(off) == k
        assert off[k] < 0.5 * np.delete(off, k).min()


def test_panes_that_are_large_and_even_are_drawn_finely(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def stop(*_: object, density: int, dark: bool) -> None:
        asked.append(density)
        raise ViewError("seen enough")

    monkeypatch.setattr(capture, "opened", stop)
    runs = [Run.load(file)]
    for camera, size in (
        ("scene", (480, 480)),
        ("endoscope", (640, 482)),
        ("page", (1280, 800)),
        ("scene", (478, 640)),
        ("scene", (640, 478)),
        ("scene", (641, 480)),
        ("scene", (640, 481)),
    ):
        with pytest.raises(ViewError, match="seen enough"):
            snapshot(runs, tmp_path / "x.png", camera=camera, size=size)
    assert asked == [2, 2, 1, 1, 1, 1, 1]


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
    program_text = (  # who runs the tests may have told them to ignore Ctrl-C
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from rcmqp.cli import main; main()"
    )
    command = [sys.executable, "-c", program_text, "video", str(file), "--size", "64x64"]
    with tempfile.TemporaryDirectory(dir="/tmp") as short:  # Chromium's socket needs a short path
        done = subprocess.run(
            [*command, "--out", str(tmp_path / "x.mp4")],
            capture_output=True,
            text=True,
            env={**os.environ, "PATH": path, "TMPDIR": short},
            start_new_session=True,
        )
        assert not list(Path(short).iterdir())
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")
    assert [each.name for each in tmp_path.iterdir()] == ["bin"]


def test_a_snapshot_is_seen_from_where_it_is_asked_and_may_have_no_ground(
    file: Path, tmp_path: Path
) -> None:
    run = Run.load(file)
    with opened([run], (640, 480), "scene") as page:

        def seen(direction: list[float], zoom: float) -> Array:
            page.evaluate("([from, zoom]) => rcmqp.look(from, zoom)", [direction, zoom])
            ends = [(run.pivot[0] + offset).tolist() for offset in 0.1 * np.eye(3)]
            at = [page.evaluate("p => rcmqp.pixel(p)", p) for p in [run.pivot[0].tolist(), *ends]]
            return np.asarray(np.subtract(at[1:], at[0]))

        front, larger, side = seen([0, -1, 0], 1.0), seen([0, -1, 0], 2.0), seen([1, 0, 0], 1.0)
    assert front[0, 0] > 10.0  # from -y, x is to the right, z up, and y away from the eye
    assert front[2, 1] < -10.0
    assert side[1, 0] > 10.0  # from x, y is to the right
    assert abs(side[0, 0]) < 0.3 * side[1, 0]
    np.testing.assert_allclose(larger, 2.0 * front, rtol=0.01, atol=0.5)
    pictures = {}
    for name, words in (("solid", []), ("clear", ["--transparent", "--from", "1,-1,0.4"])):
        path = tmp_path / f"{name}.png"
        main(["snapshot", str(file), "--out", str(path), "--size", "320x240", *words])
        pictures[name] = matplotlib.image.imread(path)
    assert pictures["solid"].shape == (240, 320, 3)
    alpha = pictures["clear"][..., 3]
    assert alpha[0, 0] == alpha[-1, 0] == 0.0
    assert 0.02 < (alpha > 0.9).mean() < 0.9  # the arm is there
    colours = pictures["clear"][:60][alpha[:60] > 0.9][:, :3]
    assert (np.ptp(colours, axis=1) > 0.4).sum() > 10  # and the legend's colours


def test_views_that_cannot_be_are_refused_before_the_browser_starts(
    file: Path, tmp_path: Path
) -> None:
    runs, path = [Run.load(file)], tmp_path / "x.png"
    with pytest.raises(OptionError, match="is vertical, and the picture would have no up"):
        snapshot(runs, path, direction=(0.0, 0.0, -2.0))
    with pytest.raises(OptionError, match="direction = "):
        snapshot(runs, path, direction=(0.0, 0.0, 0.0))
    with pytest.raises(OptionError, match="zoom = 0"):
        snapshot(runs, path, zoom=0.0)
    with pytest.raises(OptionError, match="are of the camera scene, not endoscope"):
        snapshot(runs, path, camera="endoscope", transparent=True)
