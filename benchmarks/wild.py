"""How far the shaft comes off the trocar when views change wildly, on every arm.

Four views drawn at random, each 0.4 s after the other, too fast for the arms: joints run into
their speed, acceleration and position limits. Prints a line an arm: runs, largest RCM error.

    python benchmarks/wild.py --runs 368
"""

from __future__ import annotations

import argparse

import numpy as np

from rcmqp import arm_names, compute_metrics, load_scenario, make_controller, simulate
from rcmqp.references.paths import ViewMoves
from rcmqp.show.table import Table

LOW, HIGH = (-0.6, -0.6, -3.0, -0.05), (0.6, 0.6, 3.0, 0.08)
"""Of alpha, beta, gamma [rad] and t_z [m]."""


def rcm_error(arm: str, rng: np.random.Generator, backend: str) -> float:
    """Largest RCM error [mm] of one run."""
    views = tuple(tuple(view) for view in rng.uniform(LOW, HIGH, (4, 4)).tolist())
    path = ViewMoves(views=views, move=0.4)
    scenario = load_scenario("view_steps", arm, path=path, duration=2.0, period=0.002)
    made = make_controller(
        "hierarchical_qp", scenario.insertion(), scenario.period, backend=backend
    )
    return compute_metrics(simulate(scenario, made)).rcm_max_mm


def main() -> None:
    """Run, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=20, help="for each arm")
    parser.add_argument("--backend", default="active_set")
    given = parser.parse_args()
    rng = np.random.default_rng(11)
    rows = []
    for arm in arm_names():
        found = [rcm_error(arm, rng, given.backend) for _ in range(given.runs)]
        rows.append([arm, given.runs, f"{np.median(found):.2g}", f"{max(found):.2g}"])
    print(Table(["arm", "runs", "RCM max [mm], median", "largest"], rows).markdown(), end="")


if __name__ == "__main__":
    main()
