"""A person at the console's page, and what is left of a session, in tests."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import rcmqp
from rcmqp import Run, compute_metrics
from rcmqp.realtime.checks import SLACK
from rcmqp.show.viewer.browser import PATIENCE

if TYPE_CHECKING:
    from playwright.sync_api import Page

ARM = "panda"


def until(true: Callable[[], Any], what: str) -> Any:
    """Wait, on a machine that may be busy."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if found := true():
            return found
        time.sleep(0.05)
    pytest.fail(f"waited for {PATIENCE:g} s: {what}")


def came_to_rest_as_it_must(file: Path, *, moved: float) -> Run:
    """What was recorded: the tip moved [m], the shaft on the trocar, limits kept, then rest."""
    run = Run.load(file)
    arm = rcmqp.load_arm(ARM)
    v = np.vstack([np.zeros((2, arm.nv)), run.v])
    a = np.diff(v, axis=0) / run.period
    assert (np.abs(run.v) <= (1.0 + SLACK) * arm.velocity).all()
    assert (np.abs(a) <= (1.0 + SLACK) * arm.acceleration).all()
    assert (np.abs(np.diff(a, axis=0) / run.period) <= (1.0 + SLACK) * arm.jerk).all()
    assert run.rcm_error.max() <= 1e-5
    assert np.linalg.norm(run.tip - run.tip[0], axis=1).max() > moved
    assert not run.v[-1].any()
    assert compute_metrics(run).rcm_max_mm <= 0.01
    return run


def cycles_of(reason: str, run: Run) -> set[int]:
    """Cycles of the safe stops for a reason."""
    return {k for why, cycles in run.stops.items() if reason in why for k in cycles}


def drag(page: Page, dx: float, dy: float) -> None:
    """Press, go by (dx, dy) [px] in small steps, and let go."""
    box = page.locator("#scope").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(1, 21):
        page.mouse.move(x + k / 20 * dx, y + k / 20 * dy)
        time.sleep(0.01)
    time.sleep(0.1)
    page.mouse.up()


def opened(window: Any, address: str) -> tuple[Page, list[str]]:
    page: Page = window.new_page()
    said: list[str] = []
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(address)
    page.wait_for_selector("html[data-ready]", state="attached", timeout=1e3 * PATIENCE)
    page.wait_for_function("rcmqp.newest && rcmqp.clock !== null", timeout=1e3 * PATIENCE)
    return page, said


def at_rest(page: Page) -> bool:
    """Whether the arm rests; fails where the loop has ended, which says nothing any more."""
    assert "ended" not in page.evaluate("rcmqp.said"), page.evaluate("rcmqp.said")
    return not page.evaluate("rcmqp.newest.moving")


def tip(page: Page) -> Any:
    return np.array(page.evaluate("rcmqp.newest.tip"))


GAMEPAD = """
window.pad = null;
navigator.getGamepads = () => [pad];
window.push = async (axes) => {
  const plug = (held) =>
    (pad = {
      index: 0, axes,
      buttons: Array.from({ length: 8 }, (_, i) => ({ pressed: held && i === 5 })),
    });
  if (!pad) {
    plug(false);
    await new Promise((go) => setTimeout(go, 300)); // the page has to see that it is let go
  }
  plug(true);
};
window.unplug = () => (pad = null);
"""
"""A stand-in gamepad: push() plugs it in if it is not, and holds its shoulder."""
