"""A page in a real Chromium, with what it says and asks for, and what it draws."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib.image
import numpy as np

from rcmqp import Run
from rcmqp.maths.dualquaternion import Array
from rcmqp.show.viewer.browser import browser, open_page
from rcmqp.show.viewer.build import write_page

if TYPE_CHECKING:
    from playwright.sync_api import Page


class Opened:
    """A page, and what it said and asked for since it was opened."""

    def __init__(self, page: Page, requests: list[str], said: list[str]) -> None:
        self.page, self.requests, self.said = page, requests, said

    def js(self, expression: str, argument: Any = None) -> Any:
        return self.page.evaluate(expression, argument)

    def picture(self, before: str = "0", which: str = "scene") -> Array:
        """Pixels (height, width, 3) of a canvas, 0 to 255, after a piece of JavaScript."""
        data = self.js(f"{before}, rcmqp.picture('{which}')").partition(",")[2]
        image = matplotlib.image.imread(io.BytesIO(base64.b64decode(data)))
        return np.asarray(255.0 * image[..., :3])

    def seek(self, t: float) -> None:
        self.js("t => rcmqp.seek(t)", t)

    def boxes(self, name: str) -> Array:
        """Least and largest corner of each thing of a name, (m, 2, 3) in the world [m]."""
        return np.array(self.js("name => rcmqp.boxes(name)", name))


@contextmanager
def opening(runs: Sequence[Run], folder: Path) -> Iterator[Opened]:
    """The page of runs, offline."""
    file = write_page(runs, folder / "runs.html")
    requests: list[str] = []
    said: list[str] = []

    def listen(page: Page) -> None:
        page.on("request", lambda request: requests.append(request.url))
        page.on("console", lambda message: said.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: said.append(f"error: {error}"))

    with browser() as chromium:
        context = chromium.new_context(viewport={"width": 490, "height": 1020}, offline=True)
        context.on("page", listen)
        yield Opened(open_page(context, file), requests, said)
