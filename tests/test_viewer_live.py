"""The scene on live sources: frames are pushed one by one; modules are not bundled."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers import assert_allclose
from opened import Opened, opening

from rcmqp import Run, load_scenario, make_controller, simulate
from rcmqp.maths.dualquaternion import Array
from rcmqp.show.viewer.browser import PATIENCE
from rcmqp.show.viewer.build import page

if TYPE_CHECKING:
    from playwright.sync_api import Route

ROOT = Path(__file__).parent.parent
SCRIPT = '<script type="module" src="tests/viewer/live_page.js">'
SITE = "http://viewer.test/"


@pytest.fixture(scope="module")
def run() -> Run:
    scenario = load_scenario("conical_helix", "lwa3", duration=3.0, period=0.015)
    controller = make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    return simulate(scenario, controller)


@pytest.fixture(scope="module")
def recorded(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    with opening([run], tmp_path_factory.mktemp("page")) as opened:
        yield opened


def live(recorded: Opened, run: Run, points: int, step: float) -> Opened:
    """A page that shows frames of a run as they are pushed; its window is as large."""
    text = re.sub('<script type="module">.*(?=</script>)', SCRIPT, page([run]), flags=re.DOTALL)

    def answer(route: Route) -> None:
        name = route.request.url.removeprefix(SITE)
        if name.startswith("?"):
            route.fulfill(body=text, content_type="text/html")
        else:
            route.fulfill(path=ROOT / name, content_type="text/javascript")

    said: list[str] = []
    opened = recorded.page.context.new_page()
    opened.on("pageerror", lambda error: said.append(str(error)))
    opened.route(f"{SITE}**", answer)
    opened.goto(f"{SITE}?points={points}&step={step}")
    opened.wait_for_selector(
        "html[data-ready], html[data-failed]", state="attached", timeout=1e3 * PATIENCE
    )
    assert said == []
    return Opened(opened, [], said)


def far_apart(one: Array, other: Array) -> float:
    """Share of the pixels that differ visibly."""
    assert one.shape == other.shape
    return float((np.abs(one - other).max(axis=-1) > 3.0).mean())


def test_a_live_scene_ends_up_like_the_recorded_one(recorded: Opened, run: Run) -> None:
    shown = live(recorded, run, points=1000, step=2e-5)
    times = shown.js("rcmqp.times")
    for first, last in ((1, 80), (80, 120), (120, None)):  # its buffers grow in between
        shown.js("times => rcmqp.show(times)", times[first:last])
        newest = np.searchsorted(run.time, shown.js("rcmqp.newest()") - 1e-6)
        assert_allclose(shown.js("rcmqp.trail()")[-1], run.tip[newest], rtol=0, atol=3e-5)
    recorded.seek(times[-1])
    shown.js("rcmqp.frame()")
    for which in ("scene", "endoscope"):
        assert far_apart(shown.picture(which=which), recorded.picture(which=which)) < 1e-3
    halfway = shown.picture(f"rcmqp.seek({times[100]})")
    recorded.js("rcmqp.show('desired', false)")
    assert far_apart(halfway, recorded.picture(f"rcmqp.seek({times[100]})")) < 0.01
    recorded.js("rcmqp.show('desired', true)")
    shown.page.close()


def test_a_live_trail_keeps_its_newest_points_only(recorded: Opened, run: Run) -> None:
    shown = live(recorded, run, points=32, step=1e-4)
    for first in range(1, run.time.size, 40):
        shown.js("first => rcmqp.show(rcmqp.times.slice(first, first + 40))", first)
    trail = np.array(shown.js("rcmqp.trail()"))
    far = np.linalg.norm(run.tip[:, None] - trail, axis=-1)
    assert far.min(axis=0).max() < 1e-6  # each is a tip
    rows = far.argmin(axis=0)
    assert set(np.diff(rows)) == {1}  # in their order, without a gap: it moves fast by now
    assert 16 <= len(rows) <= 32
    assert np.linalg.norm(run.tip[rows[-1] :] - trail[-1], axis=1).max() <= 1e-4  # to the end
    assert shown.js("rcmqp.stretches()") <= 62
    shown.page.close()
