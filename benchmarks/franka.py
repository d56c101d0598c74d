"""Franka's own client drives the open simulator of its interface, for long.

Wild views, jumps, lost references, 1 % of the commands lost and safe stops, in motions of 5,000
cycles each. Prints what the robot stopped for, and how far the commanded shaft came off the
trocar. ``make franka`` installs what it needs.

    python benchmarks/franka.py --motions 20
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "franka"))

from demands import everything
from fci import HOME, Account, Fci, fr3
from simulator import simulator

from rcmqp.show.table import Table

CYCLES, STOPS = 5000, 10
"""Of a motion."""


def main() -> None:
    """Run, and print a Markdown table; fail if the robot has stopped by itself."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--motions", type=int, default=20)
    parser.add_argument("--controller", default="hierarchical_qp")
    parser.add_argument("--no-jerk-limit", action="store_true", help="leave it out")
    given = parser.parse_args()
    arm = fr3(jerk=math.inf) if given.no_jerk_limit else fr3()
    total, began = Account(), time.monotonic()
    with simulator() as running:
        robot = Fci(running.address)
        for seed in range(given.motions):
            robot.go_to(HOME)
            demands = everything(seed, CYCLES, STOPS)
            account = robot.drive(arm, demands, controller=given.controller)
            total.add(account)
            print(f"motion {seed + 1}: {account}", file=sys.stderr, flush=True)
        for line in sorted(set(running.complaints())):
            print(line, file=sys.stderr)
    rows = [["motions, seconds", f"{given.motions}, {time.monotonic() - began:.0f}"]]
    for name, value in dataclasses.asdict(total).items():
        rows.append([name, str(len(value)) if name == "reflexes" else f"{value:.6g}"])
    for reflex, times in Counter(total.reflexes).items():
        rows.append([reflex.partition("reflex! ")[2], str(times)])
    print(Table(["", ""], rows).markdown(), end="")
    sys.exit(bool(total.reflexes))


if __name__ == "__main__":
    main()
