"""How large a page of a minute at 1 kHz is, how soon it can be used, and how fast it plays.

``python benchmarks/page.py`` prints Markdown. Each opening is that of a new browser; what counts
runs from the browser being told to open the file. The browser draws without a graphics card, so
that frames a second are a lower bound.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import statistics
import tempfile
from pathlib import Path
from typing import Any

from rcmqp import load_scenario, make_controller, simulate
from rcmqp.references.paths import ConicalHelix
from rcmqp.show.table import Table
from rcmqp.show.viewer import write_page
from rcmqp.show.viewer.browser import browser, open_page

HEADS = ("arm", "size [MB]", "scene drawn, play reacts [s]", "plots too [s]", "frames/s", "idle")
PLAYED = 3000  # how long frames are counted [ms]
COUNT = """ms => {
  const before = rcmqp.draws;
  return new Promise((done) => setTimeout(() => done(rcmqp.draws - before), ms));
}"""


def minute_page(arm: str, folder: Path) -> Path:
    """The page of a helix of one minute, nine turns, at 1 kHz."""
    path = ConicalHelix(duration=60.0, turns=9.0, pitch=0.04 / 9)
    scenario = dataclasses.replace(load_scenario("conical_helix", arm), path=path, duration=60.0)
    controller = make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    return write_page([simulate(scenario, controller)], folder / f"{arm}.html")


def opening(file: Path) -> dict[str, float]:
    """What a new browser takes [ms], and how many frames a second it draws, playing and idle."""
    with browser() as chromium:
        window: Any = chromium.new_context(viewport={"width": 1280, "height": 800})
        page = open_page(window, file)
        found = {name: page.evaluate(f"rcmqp.{name}") for name in ("drawnIn", "openedIn")}
        page.wait_for_timeout(500)
        found["idle"] = page.evaluate(COUNT, PLAYED) / PLAYED * 1e3
        page.evaluate("rcmqp.play()")
        found["playing"] = page.evaluate(COUNT, PLAYED) / PLAYED * 1e3
    return found


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", nargs="+", default=["lwa3", "panda"])
    parser.add_argument("--times", type=int, default=5, help="openings of each page")
    given = parser.parse_args()
    print(f"{given.times} openings, least and median; {os.cpu_count()} cores, ", end="")
    print(f"load before {os.getloadavg()[0]:.1f}\n")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for arm in given.arms:
            file = minute_page(arm, Path(folder))
            seen = [opening(file) for _ in range(given.times)]
            times = [
                f"{min(ms) / 1e3:.2f}, {statistics.median(ms) / 1e3:.2f}"
                for ms in ([each[name] for each in seen] for name in ("drawnIn", "openedIn"))
            ]
            rates = [
                f"{statistics.median(each[name] for each in seen):.0f}"
                for name in ("playing", "idle")
            ]
            rows.append([arm, f"{file.stat().st_size / 1e6:.2f}", *times, *rates])
    print(Table(HEADS, rows).markdown(), end="")


if __name__ == "__main__":
    main()
