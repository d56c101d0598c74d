"""Hands other than a mouse at the console's page: a headset, a gamepad, fingers; in Chromium."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from at_the_console import ARM, GAMEPAD, at_rest, opened, tip, until
from served import served

from rcmqp.show.viewer.browser import browser

if TYPE_CHECKING:
    from playwright.sync_api import Page

IWER = Path(__file__).parent.parent / "node_modules" / "iwer" / "build" / "iwer.min.js"
"""An emulated headset."""

BLIND = """() => {
  for (const { prototype } of [WebGLRenderingContext, WebGL2RenderingContext])
    prototype.drawElements = prototype.drawArrays = () => {};
}"""
"""Nothing is drawn from now on: without a graphics card two eyes and a picture take too long."""


@pytest.fixture(scope="module")
def console() -> Iterator[tuple[Any, str]]:
    """A browser, and a console's address."""
    with served("live", "--arm", ARM) as (_, address), browser() as chromium:
        yield chromium, address


def steering(console: tuple[Any, str], *scripts: str, **options: Any) -> Page:
    """A page that steers, with scripts that come before its own."""
    chromium, address = console
    window = chromium.new_context(viewport={"width": 240, "height": 320}, **options)
    for script in scripts:
        window.add_init_script(script)
    page, _ = opened(window, address)
    until(lambda: page.evaluate("rcmqp.steers"), "the right to steer")
    until(lambda: at_rest(page), "the arm to rest")
    return page


def left(page: Page) -> None:
    """The page is closed; the next one may steer."""
    page.context.close()
    time.sleep(0.5)


def test_a_controller_of_a_headset_steers_while_its_trigger_is_held(
    console: tuple[Any, str],
) -> None:
    assert IWER.exists(), f"{IWER.name} is missing: npm ci installs the emulated headset"
    install = "window.device = new IWER.XRDevice(IWER.metaQuest3);"
    install += "device.installRuntime({forceInstall: true});"
    install += "window.guessed = false;"  # iwer says of each position that it is a guess
    install += "Object.defineProperty(XRPose.prototype, 'emulatedPosition', {get: () => guessed});"
    page = steering(console, IWER.read_text(encoding="utf-8") + install)
    until(lambda: page.locator("#headset").is_visible(), "the button of the headset")
    page.evaluate(BLIND)
    page.evaluate("document.querySelector('#headset').click()")
    until(lambda: page.evaluate("device.activeSession !== undefined"), "the headset's picture")

    def at(x: float, y: float, z: float, roll: float = 0.0) -> None:
        page.evaluate(
            """([x, y, z, half]) => {
              device.controllers.right.position.set(x, y, z);
              device.controllers.right.quaternion.set(0, 0, -Math.sin(half), Math.cos(half));
            }""",
            [0.2 + x, 1.4 + y, z - 0.3, roll / 2.0],
        )

    def trigger(value: int) -> None:
        page.evaluate(f"device.controllers.right.updateButtonValue('trigger', {value})")

    def taken() -> bool:
        """Let go and press; a busy machine may be without pictures for too long meanwhile."""
        trigger(0)
        time.sleep(0.3)
        trigger(1)
        time.sleep(0.3)
        return bool(page.evaluate("rcmqp.held"))

    def went(x: float, y: float, z: float, roll: float) -> Any:
        """What the hand goes from one place, where it takes hold, to another."""
        trigger(0)
        time.sleep(0.3)
        start = np.array(page.evaluate("rcmqp.way"))
        at(0.05, -0.02, 0.0, roll=0.5)  # let go: it does not count
        taken()
        at(x, y, z, roll)
        time.sleep(0.3)
        return page.evaluate("rcmqp.way") - start

    way = [0.01, 0.03, 0.03, 0.0]  # to the right, down and in
    until(lambda: np.allclose(went(0.06, -0.05, -0.03, roll=0.5), way, atol=1e-5), "the way")
    # clockwise; the grip is not on the axis of the turn, and goes aside
    until(lambda: abs(went(0.06, -0.05, -0.03, roll=0.9)[3] - 0.4) < 1e-5, "the roll")
    trigger(0)

    until(lambda: not page.evaluate("rcmqp.held") and at_rest(page), "the arm to rest")
    before = tip(page)
    point = (before - np.array([0.0, 0.0, 0.05])).tolist()
    there = page.evaluate("point => rcmqp.seen(point)", point)

    def followed() -> bool:
        """Hold and go to the right, until the arm has followed or a silence has ended the grip."""
        at(0.0, 0.0, 0.0)
        time.sleep(0.2)
        trigger(1)
        moved = False
        for k in range(100):
            at(0.002 * k, 0.0, 0.0)
            moved = bool(np.linalg.norm(tip(page) - before) > 1e-7)  # at rest it moves by nothing
            if moved or page.evaluate("rcmqp.said").startswith("stopped"):
                break
            time.sleep(0.02)
        trigger(0)
        return moved

    until(followed, "the arm to follow the controller")
    until(lambda: at_rest(page), "the arm to rest")
    moved = np.subtract(page.evaluate("point => rcmqp.seen(point)", point), there)
    assert moved[0] < 0.0  # right is right: the content went to the left

    until(taken, "the grip")
    page.evaluate("window.guessed = true")
    until(lambda: not page.evaluate("rcmqp.held"), "to let go as the place is a guess")
    page.evaluate("window.guessed = false")
    time.sleep(0.3)
    assert not page.evaluate("rcmqp.held")  # the trigger is still down
    until(taken, "the grip")
    page.evaluate("device.activeSession.end()")
    until(lambda: not page.evaluate("rcmqp.held"), "to let go as the picture is gone")
    until(lambda: at_rest(page), "the arm to rest")
    left(page)


def test_a_gamepad_steers_and_one_that_is_unplugged_lets_go(console: tuple[Any, str]) -> None:
    page = steering(console, GAMEPAD)
    before = tip(page)

    def pushed() -> bool:
        page.evaluate("push([0.8, 0, 0, 0])")
        time.sleep(0.4)
        moved = page.evaluate("rcmqp.newest.moving") and np.linalg.norm(tip(page) - before) > 2e-3
        if not moved:
            page.evaluate("unplug()")
            time.sleep(0.1)
        return bool(moved)

    until(pushed, "the arm to follow the stick")
    page.evaluate("unplug()")
    until(lambda: not page.evaluate("rcmqp.held") and at_rest(page), "the arm to rest")
    left(page)


def test_two_fingers_go_in_and_roll(console: tuple[Any, str]) -> None:
    page = steering(console, has_touch=True, is_mobile=True)
    box = page.locator("#scope").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    devtools = page.context.new_cdp_session(page)

    def touch(kind: str, *places: tuple[float, float]) -> None:
        points = [{"x": x + u, "y": y + v, "id": i} for i, (u, v) in enumerate(places)]
        devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    deep = page.evaluate("rcmqp.newest.depth[0]")

    def pinched() -> bool:
        start = np.array(page.evaluate("rcmqp.way"))
        touch("touchStart", (-20.0, 0.0), (20.0, 0.0))
        for k in range(1, 21):  # to twice the distance, and a quarter turn clockwise
            far, turn = 20.0 * (1.0 + k / 20), math.pi / 40 * k
            u, v = far * math.cos(turn), far * math.sin(turn)
            touch("touchMove", (-u, -v), (u, v))
        time.sleep(0.5)
        went = page.evaluate("rcmqp.way") - start
        touch("touchEnd")
        np.testing.assert_allclose(went[2:], [0.03, math.pi / 2], rtol=0, atol=0.005)
        time.sleep(0.2)
        return bool(page.evaluate("rcmqp.newest.depth[0]") > deep + 5e-3)

    until(pinched, "the arm to go in")
    assert not page.evaluate("rcmqp.held")
    left(page)
