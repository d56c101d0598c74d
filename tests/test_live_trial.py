"""rcmqp trial as a whole: an automatic operator does the task at the page, in a real Chromium."""

from __future__ import annotations

import contextlib
import json
import math
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from served import served
from websockets import Origin
from websockets.sync.client import ClientConnection, connect

from rcmqp import Run, compute_metrics
from rcmqp.references.operators.camera_task import reached
from rcmqp.references.paths import Search
from rcmqp.show.viewer.browser import PATIENCE, browser
from rcmqp.show.viewer.build import write_page

if TYPE_CHECKING:
    from playwright.sync_api import Page

READY = "html[data-ready]"
TASK = """
instructions = "Show the sphere as in the picture."
tolerance = 0.002
places = [[-0.012, -0.01, 0.11]]
spheres = [{centre = [-0.012, -0.01, 0.145], radius = 0.004}]
obstacle = {centre = [0.02, 0.02, 0.14], radius = 0.006}
"""

LAW = """
from rcmqp.controllers.hierarchical_qp import HierarchicalQP
class MyLaw(HierarchicalQP):
    pass
"""

SEEN = """() => window.rcmqp && !document.querySelector("#over")
  ? [rcmqp.sights[0], rcmqp.said] : null"""
"""Where the sphere is in the picture, and what the page says; null once the task is over."""

NOTCH, SPAN, STANDOFF = 4.0, 80.0, 35.0
"""Of the page: way for a notch of the wheel and for a drag across [mm]; and of the task [mm]."""


def trial(
    folder: Path, *options: str
) -> contextlib.AbstractContextManager[tuple[subprocess.Popen[str], str]]:
    return served("trial", "--out", str(folder), *options)


def until(true: Callable[[], Any], what: str) -> Any:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        with contextlib.suppress(Exception):  # the page may be on its way to the next one
            if found := true():
                return found
        time.sleep(0.05)
    pytest.fail(f"waited for {PATIENCE:g} s: {what}")


def came(page: Page, heading: str) -> None:
    """Wait until the page with a heading is there and ready."""
    page.wait_for_selector(f"h1:text-is('{heading}')", timeout=1e3 * PATIENCE)
    page.wait_for_selector(READY, state="attached", timeout=1e3 * PATIENCE)
    time.sleep(0.3)  # the socket opens


def answer(page: Page, **choices: int) -> None:
    for name, value in choices.items():
        page.check(f"input[name={name}][value='{value}']")


class Operator:
    """Steers by what the picture shows: where spheres are in it, and how large they look."""

    def __init__(self, page: Page) -> None:
        self.page = page
        box = page.locator("#scope").bounding_box()
        assert box is not None
        self.size, self.middle = (
            box["width"],
            (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2),
        )
        self.at = self.middle

    def hold(self) -> None:
        self.at = self.middle
        self.page.mouse.move(*self.at)
        self.page.mouse.down()

    def go(self, x: float, y: float) -> None:
        """Drag by (x, y) [mm of the hand]."""
        scale = self.size / SPAN
        self.at = (self.at[0] + scale * x, self.at[1] + scale * y)
        self.page.mouse.move(*self.at)

    def into(self, z: float) -> None:
        """Turn the wheel for ``z`` [mm], at most a notch."""
        self.page.mouse.wheel(0.0, -100.0 * max(-1.0, min(1.0, z / NOTCH)))

    def find(self) -> None:
        """Bring the sphere to where the small picture has it, until the page says it is found."""
        wanted = self.page.evaluate("rcmqp.wanted[0][0]")
        half = STANDOFF * 0.7  # of the picture, there [mm]
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if (seen := self.page.evaluate(SEEN)) is None:
                return
            (u, v, r), said = seen
            if "hold again" in said or said.startswith("at rest"):
                self.page.mouse.up()
                self.hold()
            across = (u - wanted[0], v - wanted[1])
            deep = STANDOFF * (wanted[2] / r - 1.0)
            reach = 0.5 * half * wanted[2] / r
            if not all(
                abs(p - q) < 0.4 * self.size for p, q in zip(self.at, self.middle, strict=True)
            ):
                self.page.mouse.up()
                time.sleep(0.4)
                self.hold()
            self.go(*(max(-4.0, min(4.0, reach * each)) for each in across))
            if math.hypot(*across) < 0.25:
                self.into(0.5 * deep)
            time.sleep(0.06)
        pytest.fail(f"the picture is not found: {seen}, wanted {wanted}")


def test_an_operator_finishes_the_whole_trial_by_what_the_page_shows(tmp_path: Path) -> None:
    folder, consent = tmp_path / "study", tmp_path / "consent.txt"
    consent.write_text("You may stop <b>at any time</b>.", encoding="utf-8")
    task = tmp_path / "task.toml"
    task.write_text(TASK, encoding="utf-8")
    options = ("--arm", "panda", "--practice", "2", "--consent", str(consent), "--task", str(task))
    with (
        trial(folder, *options) as (process, address),
        browser() as chromium,
    ):
        page = chromium.new_context(viewport={"width": 820, "height": 300}).new_page()
        said: list[str] = []
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto(address)
        came(page, "Before you begin")
        watcher = page.context.new_page()  # never takes the steering from the one that has it
        watcher.goto(address)
        until(lambda: "another page" in watcher.inner_text("#problem"), "the other page")
        page.bring_to_front()
        page.reload()
        came(page, "Before you begin")
        assert "You may stop <b>at any time</b>." in page.inner_text(".consent")
        answer(page, laparoscopy=0, simulators=0, haptics=0, games=0)
        page.click("button[type=submit]")
        until(lambda: "consent" in page.inner_text("#problem"), "the consent to be asked for")
        page.check("input[name=consent]")
        page.click("button[type=submit]")
        came(page, "Practice")
        page.click("#start", timeout=1e3 * PATIENCE)
        watcher.close()  # it has had its chance while the practice was loaded
        came(page, "The task")
        until(lambda: page.locator("#start").is_visible(), "the start")
        assert page.locator("#haply").is_visible()  # also for those who do not practise
        page.click("#start", timeout=1e3 * PATIENCE)
        until(lambda: page.evaluate("rcmqp.newest !== null"), "the arm")
        operator = Operator(page)
        operator.hold()
        operator.find()
        came(page, "What was it like?")
        answer(page, ease=3, followed=4)
        page.fill("textarea", "no depth in the picture")
        page.click("button[type=submit]")
        page.wait_for_selector("h1:text-is('Thank you!')", timeout=1e3 * PATIENCE)
        assert process.stdout is not None
        report = process.stdout.read()
        assert process.wait(PATIENCE) == 0, report
        assert said == []
    person = json.loads((folder / "people" / "P01.json").read_text())
    assert person["group"] == "novice"
    notes = json.loads((folder / "trials" / "P01-1.json").read_text())
    assert notes["answers"] == {"ease": 3, "followed": 4, "comment": "no depth in the picture"}
    assert notes["finished"] is True
    assert notes["attempts"] == 1
    assert notes["device"] == ["mouse"]
    for name in ("input", "state", "picture"):
        median, p95, p99, count = notes["latency_s"][name]
        assert 0.0 <= median <= p95 <= p99
        assert count > 0
    run = Run.load(folder / "trials" / "P01-1.h5")
    search = run.scenario.path
    assert isinstance(search, Search)
    insertion = run.insertion()
    places = [np.add(run.scenario.trocar.pivot, insertion.from_start(p)) for p in search.places]
    times = reached(run.time, run.tip, np.array(places), search.tolerance)
    np.testing.assert_allclose(times, notes["reached_s"], rtol=0, atol=0.02)
    metrics = compute_metrics(run)
    assert metrics.rcm_max_mm <= 0.01
    assert metrics.rcm_max_mm == pytest.approx(1e3 * run.rcm_error.max(), abs=1e-12)
    assert metrics.tip_max_mm == pytest.approx(1e3 * run.tip_error.max(), abs=1e-12)
    assert not run.v[-1].any()
    write_page([run], tmp_path / "page.html")


def say(socket: ClientConnection, kind: str, **words: Any) -> None:
    socket.send(json.dumps({"kind": kind, **words}))


def hear(socket: ClientConnection, kind: str) -> dict[str, Any]:
    """The next message of a kind."""
    while (words := json.loads(socket.recv(PATIENCE)))["kind"] != kind:
        pass
    return dict(words)


@contextlib.contextmanager
def participant(address: str) -> Iterator[ClientConnection]:
    """A page without a browser, which has the questions or steers."""
    origin, token = address.split("/?")
    url = f"{origin.replace('http', 'ws')}/hand?{token}"
    with connect(url, origin=Origin(origin)) as page:
        say(page, "take")
        assert hear(page, "role")["steers"]
        yield page


def test_a_killed_trial_has_whole_files_and_goes_on_with_its_task(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    novice = dict.fromkeys(("laparoscopy", "simulators", "haptics", "games"), 0)
    law = tmp_path / "my_law.py"
    law.write_text(LAW, encoding="utf-8")
    options = ("--arm", "panda", "--practice", "0", "--id", "P07", "-c", f"{law}:MyLaw")
    with (
        trial(folder, *options) as (process, address),
        participant(address) as page,
    ):
        say(page, "answers", values={**novice, "consent": True})
        hear(page, "next")
        say(page, "start")
        start, number, end = hear(page, "state")["tip"], 0, time.monotonic() + 60.0
        while math.dist(hear(page, "state")["tip"], start) < 2e-3:
            assert time.monotonic() < end, "the hand was let go and did not take hold again"
            for _ in range(5):  # at rest states are rare, and 100 ms of silence end a grip
                event, number = time.monotonic(), number + 1
                say(
                    page,
                    "hand",
                    number=number,
                    grip=1 + number // 200,
                    held=number % 200 > 0,
                    at=event,
                    event=event,
                    way=[4e-5 * number, 0.0, 0.0, 0.0],
                    felt=False,
                    devices=["keys"],
                )
                time.sleep(0.02)
        process.kill()
    file = folder / "trials" / "P07-1.h5"
    until(file.exists, "the run's file")
    run = Run.load(file)
    assert np.linalg.norm(run.tip[-1] - run.tip[0]) > 1e-3
    assert not run.v[-1].any()
    assert (run.controller, run.given.file) == ("my_law", "my_law.py:MyLaw")
    notes = json.loads(file.with_suffix(".json").read_text())
    assert (notes["attempts"], notes["finished"]) == (1, None)
    with (
        trial(folder, "--id", "P07", "-c", f"{law}:MyLaw") as (process, address),
        participant(address) as page,
    ):
        with urllib.request.urlopen(address) as first:
            assert "new WebSocket" in first.read().decode()  # it hears that the next one is there
        hear(page, "next")
        say(page, "break")
        assert "broken off" in hear(page, "over")["title"]
        assert process.wait(PATIENCE) == 1
    assert Run.load(file).digest == run.digest
