"""Still pictures and video of recorded runs, without a display."""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rcmqp.errors import OptionError, RunFileError, UnknownName
from rcmqp.files import check_ending, check_writable, whole_file
from rcmqp.maths.options import allowed, between, positive
from rcmqp.runs.run import Run
from rcmqp.show.viewer.browser import ffmpeg_path, opened
from rcmqp.world.instrument import unit_vector3

if TYPE_CHECKING:
    from playwright.sync_api import Page

CAMERAS = {"scene": (1280, 960), "endoscope": (800, 880), "page": (1280, 800)}
"""What a picture shows: the arm, the endoscope's own image, or the whole page; its size."""

FINE = 480
"""Scenes and endoscopes at least as wide and high are drawn as on a display of twice the density
[pixels]: lines and letters are large enough where the picture is shown small."""

LEAST_TILT = 0.01
"""Of a direction from the vertical: sine of the angle."""

RATE = 30
"""Pictures a second of a video."""


def snapshot(
    runs: Sequence[Run],
    path: str | os.PathLike[str],
    *,
    time: float = 0.0,
    camera: str = "scene",
    size: tuple[int, int] | None = None,
    dark: bool = False,
    direction: Sequence[float] | None = None,
    zoom: float = 1.0,
    transparent: bool = False,
) -> Path:
    """Write a picture (PNG) of runs at the time ``time``, and return its path.

    Args:
        runs: of one scenario; the first one's arm is solid.
        path: of the picture, it ends in .png.
        time: on the run's clock [s].
        camera: one of CAMERAS.
        size: width and height in pixels; CAMERAS' own without it.
        dark: whether the background is dark.
        direction: (3,) of ``scene``: from what it shows to the eye, in the world; without it, one
            that shows base and trocar apart.
        zoom: of ``scene``: 2 shows its middle twice as large.
        transparent: of ``scene``: whether the picture has no background.

    Raises:
        ToolMissing: Chromium or playwright is not installed.
        UnknownName: there is no such camera.
        OptionError: the time is outside the runs, the file is no .png, a direction is vertical or
            none, or what is for ``scene`` is asked of another camera.
        RunFileError: the file cannot be written.
        ViewError: see page().
    """
    size = _checked(runs, path, ".png", camera, size)
    _check_time(runs, time)
    allowed("zoom", zoom, between(0.0, 100.0))
    towards = None if direction is None else _towards(direction)
    if camera != "scene" and (towards is not None or zoom != 1.0 or transparent):
        raise OptionError(f"direction, zoom and transparent are of the camera scene, not {camera}")
    with opened(runs, size, _pane(camera), density=_density(camera, size), dark=dark) as page:
        if transparent:
            page.evaluate("rcmqp.clear()")
        page.evaluate("([from, zoom]) => rcmqp.look(from, zoom)", [towards, zoom])
        page.evaluate("t => (rcmqp.seek(t), rcmqp.draw())", time)
        picture = page.screenshot(type="png", omit_background=transparent)
    with whole_file(path) as part:
        part.write_bytes(picture)
    return Path(path)


def _towards(direction: Sequence[float]) -> list[float]:
    """Scale the direction from the scene to the camera to length 1.

    Raises:
        OptionError: it is vertical, so that no side of the picture is up.
    """
    vector = np.array(unit_vector3("direction", direction))
    if math.hypot(vector[0], vector[1]) < LEAST_TILT:
        raise OptionError(
            f"direction = {tuple(direction)} is vertical, and the picture would have no up; tilt "
            "it a little, such as 0.05,0,1"
        )
    return [float(x) for x in vector]


def video(
    runs: Sequence[Run],
    path: str | os.PathLike[str],
    *,
    camera: str = "scene",
    speed: float = 1.0,
    size: tuple[int, int] | None = None,
    dark: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write an MP4 of runs from beginning to end, and return its path.

    Args:
        runs: of one scenario; the first one's arm is solid.
        path: of the video, it ends in .mp4.
        camera: one of CAMERAS.
        speed: how fast the run's clock goes; 2 is twice as fast.
        size: width and height in pixels, both even; CAMERAS' own without it.
        dark: whether the background is dark.
        progress: called after each picture with 1 and how many there will be.

    Raises:
        ToolMissing: Chromium, playwright or ffmpeg is not installed.
        UnknownName: there is no such camera.
        OptionError: speed or size is not allowed, or the file is no .mp4.
        RunFileError: the file cannot be written; the message says what ffmpeg said.
        ViewError: see page().
    """
    ffmpeg = ffmpeg_path()
    size = _checked(runs, path, ".mp4", camera, size)
    if size[0] % 2 or size[1] % 2:
        raise OptionError(f"size = {size}, a video needs an even width and height")
    allowed("speed", speed, positive())
    duration = max(float(run.time[-1]) for run in runs)
    pictures = max(2, math.ceil(duration / speed * RATE) + 1)
    command = [ffmpeg, "-y", "-loglevel", "error", "-f", "image2pipe", "-framerate", str(RATE)]
    command += ["-c:v", "mjpeg", "-i", "-", "-c:v", "libx264", "-pix_fmt", "yuv420p"]
    command += ["-crf", "18", "-movflags", "+faststart"]
    with whole_file(path) as part:
        with opened(runs, size, _pane(camera), density=_density(camera, size), dark=dark) as page:
            times = (min(duration, k * speed / RATE) for k in range(pictures))
            said = _encoded([*command, str(part)], page, times, lambda: progress(1, pictures))
        if said:
            raise RunFileError(Path(path), f"ffmpeg could not write it: {said}")
    return Path(path)


def _encoded(
    command: Sequence[str], page: Page, times: Iterable[float], done: Callable[[], None]
) -> str:
    """Pictures of the page at ``times`` [s], one after the other into ffmpeg.

    Returns:
        What ffmpeg said where it failed; empty where it did not.
    """
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        assert encoder.stderr is not None
        try:
            for time in times:
                page.evaluate("t => (rcmqp.seek(t), rcmqp.draw())", time)
                encoder.stdin.write(page.screenshot(type="jpeg", quality=95))
                done()
            encoder.stdin.close()
        except BrokenPipeError:  # ffmpeg gave up; what it said follows
            with contextlib.suppress(BrokenPipeError):
                encoder.stdin.close()  # or Popen does, and trips over what is left in it
        said = encoder.stderr.read().decode(errors="replace").strip()
    return said or "no reason given" if encoder.returncode else ""


def _checked(
    runs: Sequence[Run],
    path: str | os.PathLike[str],
    ending: str,
    camera: str,
    size: tuple[int, int] | None,
) -> tuple[int, int]:
    """Check the arguments before the browser starts; return the picture's size."""
    if camera not in CAMERAS:
        raise UnknownName("camera", camera, CAMERAS)
    check_ending(path, ending)
    check_writable(path)
    width, height = size or CAMERAS[camera]
    if not (64 <= width <= 7680 and 64 <= height <= 7680):
        raise OptionError(f"size = {width} x {height} pixels, each must be 64 to 7680")
    return width, height


def _check_time(runs: Sequence[Run], time: float) -> None:
    last = max((float(run.time[-1]) for run in runs), default=0.0)
    if not 0.0 <= time <= last:
        raise OptionError(f"time = {time} s, the run goes from 0 to {last:g} s")


def _pane(camera: str) -> str:
    """The pane of the page that is captured; empty for the whole page."""
    return "" if camera == "page" else camera


def _density(camera: str, size: tuple[int, int]) -> int:
    """Pixels of the picture, down or across, for one of the page."""
    fine = camera != "page" and min(size) >= FINE and not any(side % 2 for side in size)
    return 2 if fine else 1
