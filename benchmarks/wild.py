"""What gives way when views change wildly, on every arm: trocar, cone, depth range, obstacles.

Four views drawn at random, each 0.4 s after the other, too fast for the arms: joints run into
their speed, acceleration and position limits. Prints a line an arm: runs, the largest RCM error,
and by how much the shaft was beyond the cone, the depth range and the obstacles at most.

    python benchmarks/wild.py --runs 368
    python benchmarks/wild.py --runs 50 --scenario cone_and_depth
"""

from __future__ import annotations

import argparse

import numpy as np

from rcmqp import arm_names, compute_metrics, load_scenario, make_controller, simulate
from rcmqp.references.paths import ViewMoves
from rcmqp.show.table import Table

LOW, HIGH = (-0.6, -0.6, -3.0, -0.05), (0.6, 0.6, 3.0, 0.08)
"""Of alpha, beta, gamma [rad] and t_z [m]."""

HEADS = (
    "RCM max [mm], median",
    "largest",
    "beyond the cone [mrad]",
    "beyond the depth range [mm]",
    "in an obstacle [mm]",
)


def gave_way(arm: str, name: str, rng: np.random.Generator, backend: str) -> list[float]:
    """Of one run: RCM error [mm]; excess of the cone [mrad], the depth range, obstacles [mm]."""
    views = tuple(tuple(view) for view in rng.uniform(LOW, HIGH, (4, 4)).tolist())
    path = ViewMoves(views=views, move=0.4)
    scenario = load_scenario(name, arm, path=path, duration=2.0, period=0.002)
    insertion, trocar = scenario.insertion(), scenario.trocar
    made = make_controller("hierarchical_qp", insertion, scenario.period, backend=backend)
    metrics = compute_metrics(simulate(scenario, made))
    shallowest, deepest = (1e3 * depth for depth in trocar.depth_range)
    distance = metrics.obstacle_distance_min_mm if insertion.obstacles else np.inf
    return [
        metrics.rcm_max_mm,
        max(0.0, metrics.tilt_max_mrad - 1e3 * trocar.cone_half_angle),
        max(0.0, metrics.depth_max_mm - deepest, shallowest - metrics.depth_min_mm),
        max(0.0, -distance),
    ]


def main() -> None:
    """Run, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=20, help="for each arm")
    parser.add_argument("--scenario", default="view_steps")
    parser.add_argument("--backend", default="active_set")
    given = parser.parse_args()
    rng = np.random.default_rng(11)
    rows = []
    for arm in arm_names():
        found = np.array(
            [gave_way(arm, given.scenario, rng, given.backend) for _ in range(given.runs)]
        )
        numbers = [np.median(found[:, 0]), *found.max(axis=0)]
        rows.append([arm, given.runs, *(f"{number:.2g}" for number in numbers)])
    print(Table(["arm", "runs", *HEADS], rows).markdown(), end="")


if __name__ == "__main__":
    main()
