"""Drive the page of rcmqp live with random input, and measure what the arm and the loop do.

    python benchmarks/fuzz_console.py --minutes 10

A headless Chromium opens the page; mouse, wheel, keys, two fingers and a lost focus come in random
order and at random speed. At the end the session is stopped by Ctrl-C, and what is printed is
computed from the report and from the recorded file. Exit code 1 if something promised is not kept:
see PROMISES. The latencies are promised for a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rcmqp import Run
from rcmqp.realtime.checks import SLACK
from rcmqp.show.table import Table
from rcmqp.show.viewer.browser import PATIENCE, browser

if TYPE_CHECKING:
    from playwright.sync_api import Page

PROMISES: dict[str, Callable[[float], bool]] = {
    "largest RCM error [mm]": lambda x: x <= 0.01,
    "largest speed, acceleration or jerk over its limit": lambda x: x <= 1.0 + SLACK,
    "messages unaccounted for on the way to the server": lambda x: x == 0,
    "messages unaccounted for on the way to the loop": lambda x: x == 0,
    "errors in the page": lambda x: x == 0,
    "share of cycles in which the arm moved": lambda x: x > 0.0,
}
"""What has to hold of each measure."""

KEYS = ("ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "w", "s", "e", "q", "Shift")


class Fuzzer:
    """Random hands at a page."""

    def __init__(self, page: Page, seed: int) -> None:
        """Drive ``page``."""
        self.page, self.rng = page, np.random.default_rng(seed)
        self.devtools = page.context.new_cdp_session(page)
        box = page.locator("#scope").bounding_box()
        assert box is not None
        self.middle = np.array([box["x"], box["y"]]) + np.array([box["width"], box["height"]]) / 2
        self.size, self.place = box["width"] / 2, self.middle
        self.down: set[str] = set()

    def act(self) -> None:
        """One of the things that hands do."""
        kinds: list[tuple[float, Callable[[], Any]]] = [
            (6.0, self.press),
            (8.0, self.glide),
            (4.0, self.jump),
            (2.0, self.wheel),
            (2.0, self.key),
            (2.0, self.fingers),
            (1.0, self.let_go),
            (0.2, lambda: self.page.evaluate("window.dispatchEvent(new Event('blur'))")),
            (0.2, lambda: self.page.mouse.click(*self.place, button="right")),
            (0.5, lambda: time.sleep(self.rng.uniform(0.0, 0.5))),
        ]
        weights = np.array([weight for weight, _ in kinds])
        kinds[self.rng.choice(len(kinds), p=weights / weights.sum())][1]()
        time.sleep(self.rng.uniform(0.0, 0.02))

    def somewhere(self) -> Any:
        """A place in the picture, or a little outside."""
        return self.middle + self.rng.uniform(-1.1, 1.1, 2) * self.size

    def press(self) -> None:
        """Take hold anew: a grip that was ended by silence never begins again."""
        self.let_go()
        self.jump()
        self.page.mouse.down()
        self.down.add("mouse")

    def glide(self) -> None:
        """A drag, quick or slow."""
        here, there = self.place, self.somewhere()
        for share in np.linspace(0.0, 1.0, self.rng.integers(3, 40)):
            self.page.mouse.move(*(here + share * (there - here)))
            time.sleep(0.008)  # as a mouse of 125 Hz tells of it
        self.place = there

    def jump(self) -> None:
        """Be elsewhere at once."""
        self.place = self.somewhere()
        self.page.mouse.move(*self.place)

    def wheel(self) -> None:
        """Some notches."""
        for _ in range(self.rng.integers(1, 8)):
            self.page.mouse.wheel(0.0, float(self.rng.choice([-300.0, -100.0, 100.0])))

    def key(self) -> None:
        """Press a key, or let go of it."""
        name = str(self.rng.choice(KEYS))
        if name in self.down:
            self.page.keyboard.up(name)
        else:
            self.page.keyboard.down(name)
        self.down ^= {name}

    def fingers(self) -> None:
        """Two of them pinch, twist and slide."""
        first, second = self.somewhere(), self.somewhere()
        ways = self.rng.normal(0.0, 0.03 * self.size, (2, 2))
        self._touch("touchStart", first, second)
        for _ in range(self.rng.integers(2, 20)):
            first, second = first + ways[0], second + ways[1]
            self._touch("touchMove", first, second)
            time.sleep(0.01)
        self._touch("touchEnd")

    def _touch(self, kind: str, *places: Any) -> None:
        points = [{"x": float(x), "y": float(y), "id": i} for i, (x, y) in enumerate(places)]
        self.devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def let_go(self) -> None:
        """Of everything."""
        for name in self.down - {"mouse"}:
            self.page.keyboard.up(name)
        self.page.mouse.up()
        self.down.clear()


def fuzz(minutes: float, seed: int, file: Path) -> tuple[str, int, list[str], float]:
    """Drive the page; the report, messages that the page sent, its errors, and the load."""
    command = [sys.executable, "-m", "rcmqp", "live", "--arm", "panda", "--no-open"]
    with (
        subprocess.Popen(
            [*command, "--out", str(file)],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        ) as process,
        browser() as chromium,
    ):
        try:
            assert process.stdout is not None
            address, errors = process.stdout.readline().strip(), []
            window = chromium.new_context(viewport={"width": 320, "height": 400})
            page = window.new_page()
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.goto(address)
            page.wait_for_function("window.rcmqp?.steers", timeout=1e3 * PATIENCE)
            fuzzer, loads = Fuzzer(page, seed), []
            fuzzer.press()
            fuzzer.glide()
            end = time.monotonic() + 60.0 * minutes
            while time.monotonic() < end:
                fuzzer.act()
                loads.append(os.getloadavg()[0])
            fuzzer.let_go()
            page.wait_for_function("!rcmqp.newest.moving", timeout=1e3 * PATIENCE)
            sent = page.evaluate("rcmqp.told")
            page.close()
            time.sleep(1.0)
            process.send_signal(signal.SIGINT)
            return process.stdout.read(), sent, errors, float(np.mean(loads))
        finally:
            process.kill()


def row(report: str, what: str) -> str:
    """The value of a row of the report."""
    found = re.search(rf"^\|\s*{re.escape(what)}\s*\|(.*)\|\s*$", report, re.MULTILINE)
    assert found, f"no row {what!r} in\n{report}"
    return found[1].strip()


def measures(report: str, sent: int, errors: list[str], run: Run) -> dict[str, float]:
    """Numbers by what they measure."""
    arm = run.scenario.insertion().arm
    v = np.vstack([np.zeros((2, arm.nv)), run.v])
    a = np.diff(v, axis=0) / run.period
    shares = [
        np.abs(v) / arm.velocity,
        np.abs(a) / arm.acceleration,
        np.abs(np.diff(a, axis=0)) / run.period / arm.jerk,
    ]
    hands, lost = (
        int(row(report, "messages of the hand let through")),
        int(row(report, "- lost, as the loop did not take them")),
    )
    dropped = [line for line in report.splitlines() if line.startswith("| - dropped")]
    dropped_count = sum(int(line.strip("| ").rpartition("|")[2]) for line in dropped)
    gone = 1  # the server says once that the page is closed
    return {
        "cycles": len(run.v),
        "share of cycles in which the arm moved": float(run.v.any(axis=1).mean()),
        "largest RCM error [mm]": 1e3 * float(run.rcm_error.max()),
        "largest speed, acceleration or jerk over its limit": max(float(x.max()) for x in shares),
        "messages that the page sent": sent,
        "messages dropped and counted": dropped_count,
        "messages unaccounted for on the way to the server": sent - hands - dropped_count,
        "messages unaccounted for on the way to the loop": hands
        + gone
        - lost
        - int(row(report, "messages that the loop took")),
        "errors in the page": len(errors),
    }


def main() -> None:
    """Drive, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=7)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.h5"
        report, sent, errors, load = fuzz(given.minutes, given.seed, file)
        found = measures(report, sent, errors, Run.load(file))
    print(report)
    print(*errors, sep="\n")
    rows = [(what, f"{value:.6g}") for what, value in found.items()]
    print(Table((f"{given.minutes:g} minutes, mean load {load:.1f}", ""), rows).markdown())
    broken = [what for what, holds in PROMISES.items() if not holds(found[what])]
    if broken:
        sys.exit("not kept: " + "; ".join(broken))


if __name__ == "__main__":
    main()
