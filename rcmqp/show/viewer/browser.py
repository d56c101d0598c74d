"""A browser without a display: the system's Chromium, driven by playwright."""

from __future__ import annotations

import importlib.util
import io
import logging
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from rcmqp.errors import ToolMissing, ViewError
from rcmqp.runs.run import Run
from rcmqp.show.viewer.build import write_page

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, Error, Page, ViewportSize

CHROMIUMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
"""Names that Chromium goes by; the first that is found is taken."""

FLAGS = (
    "--use-angle=swiftshader",  # draws without a graphics card
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)

PATIENCE = 120.0
"""How long a page may take to open, on a slow machine without a graphics card [s]."""


INTERRUPTION = 0.3
"""How much later Ctrl-C may be heard of than its consequences [s]."""


def chromium_path() -> str:
    """Where the system's Chromium is.

    Raises:
        ToolMissing: it is nowhere on the path, or playwright is not installed.
    """
    if importlib.util.find_spec("playwright") is None:
        raise ToolMissing("playwright", "pip install 'rcmqp[browser]'")
    for name in CHROMIUMS:
        if (path := shutil.which(name)) is not None:
            return path
    raise ToolMissing(
        "Chromium",
        f"apt-get install chromium, or put one of {', '.join(CHROMIUMS)} on the path",
    )


def ffmpeg_path() -> str:
    """Path of the program ffmpeg.

    Raises:
        ToolMissing: it is not on the path.
    """
    path = shutil.which("ffmpeg")
    if path is None:
        raise ToolMissing("ffmpeg", "apt-get install ffmpeg, or put it on the path")
    return path


@contextmanager
def browser() -> Iterator[Browser]:
    """A headless Chromium, closed afterwards.

    Raises:
        ToolMissing: Chromium or playwright is not installed.
        ViewError: it does not start.
    """
    executable = chromium_path()
    from playwright.sync_api import Error, sync_playwright

    root = hasattr(os, "geteuid") and os.geteuid() == 0  # Windows has no root
    flags = [*FLAGS, "--no-sandbox"] if root else list(FLAGS)
    with _interruptible(), sync_playwright() as playwright:
        try:
            chromium = playwright.chromium.launch(
                executable_path=executable,
                args=flags,
                handle_sigint=False,  # it is closed below
            )
        except Error as error:
            raise _failed(f"{executable} does not start", error) from error
        try:
            yield chromium
        except KeyboardInterrupt:
            sys.stderr = io.StringIO()  # playwright complains of how it was ended
            logging.getLogger("asyncio").setLevel(logging.CRITICAL)  # later, too
            raise
        finally:
            with suppress(Error):  # nothing is left to be closed, perhaps
                chromium.close()


def open_page(chromium: Browser | BrowserContext, file: Path, pane: str = "") -> Page:
    """A page out of write_page(), ready to be driven by ``window.rcmqp``.

    Args:
        chromium: out of browser(), or a context of it.
        file: of the page.
        pane: ``scene`` or ``endoscope``, to see only that; all without it.

    Raises:
        ViewError: the page does not open.
    """
    from playwright.sync_api import Error

    opened = chromium.new_page()
    opened.set_default_timeout(1e3 * PATIENCE)
    try:
        opened.goto(f"{file.resolve().as_uri()}#{pane}")
        opened.wait_for_selector("html[data-ready], html[data-failed]", state="attached")
        failure = opened.evaluate("document.documentElement.dataset.failed")
    except Error as error:
        raise _failed(f"{file} does not open in Chromium", error) from error
    if failure is not None:
        raise ViewError(f"{file} does not open in Chromium: {failure}")
    return opened


@contextmanager
def opened(
    runs: Sequence[Run],
    size: tuple[int, int],
    pane: str = "",
    *,
    density: int = 1,
    dark: bool = False,
) -> Iterator[Page]:
    """The page of runs, or one pane of it, in a headless browser's window.

    Args:
        runs: of one scenario.
        size: of the window in pixels, multiples of ``density``.
        pane: see open_page().
        density: how many pixels, down or across, the page takes for one of its own.
        dark: whether the background is dark.

    Raises:
        ToolMissing: Chromium or playwright is not installed.
        ViewError: the runs do not go together, the page does not open, or Chromium ends before
            the page is left.
    """
    chromium_path()
    from playwright.sync_api import Error

    with tempfile.TemporaryDirectory() as folder:
        file = write_page(runs, Path(folder) / "run.html", dark=dark)
        with browser() as chromium:
            viewport: ViewportSize = {"width": size[0] // density, "height": size[1] // density}
            try:
                window = chromium.new_context(viewport=viewport, device_scale_factor=density)
                yield open_page(window, file, pane)
            except Error as error:
                raise _failed("Chromium stopped at its work", error) from error


def _failed(what: str, error: Error) -> ViewError:
    """Error text: the action that failed, and the first line of playwright's message."""
    first = error.message.partition("\n")[0]
    return ViewError(f"{what}: {first}")


@contextmanager
def _interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt for errors that follow when Ctrl-C ends playwright's driver."""
    heard: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        heard.append(number)
        raise KeyboardInterrupt

    is_default = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_default and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, note)
    stderr = sys.stderr
    try:
        yield
    except Exception as error:
        if not heard:
            time.sleep(INTERRUPTION)
        if heard:
            raise KeyboardInterrupt from error
        raise
    finally:
        sys.stderr = stderr
        if signal.getsignal(signal.SIGINT) is note:
            signal.signal(signal.SIGINT, signal.default_int_handler)
