"""The published controllers at their defaults and at their authors' settings; the planner's start.

    python benchmarks/baselines.py

Prints the three tables of docs/controllers.md, in a minute and a half;
``tests/test_baseline_tables.py`` compares them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from rcmqp import (
    Controller,
    Metrics,
    Run,
    Scenario,
    compute_metrics,
    load_scenario,
    make_controller,
    simulate,
)
from rcmqp.references.paths import ViewMoves, ViewSteps
from rcmqp.show.table import Table

LAWS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("pose_error", {}),
    ("damped", {}),
    ("damped", {"lambda_max": 0.01, "epsilon": 0.001, "beta": 0.01}),
    ("task_priority", {}),
    ("task_reconstruction", {}),
    ("aghakhani", {}),
    ("aghakhani", {"gain": 1.0, "rcm_gain": 100.0}),
    ("vfi_qp", {}),
    ("vfi_qp", {"velocity_limits": True}),
    ("vfi_qp", {"joint_gain": 1.0}),
    ("vfi_qp", {"gain": 10.0, "damping": 0.01}),
    ("vfi_qp", {"gain": 10.0, "damping": 0.01, "joint_gain": 1.0}),
)
"""Controllers and options; where an authors' code was read, its numbers, too."""

ARMS = ("lwa3", "panda")

COLUMNS = {
    "tip rms [mm]": "tip_rms_mm",
    "RCM max [mm]": "rcm_max_mm",
    "orientation max [mrad]": "orientation_max_mrad",
    "speed / limit": "speed_ratio_max",
    "acceleration / limit": "acceleration_ratio_max",
    "jerk / limit": "jerk_ratio_max",
    "reversals in a row": "reversals_in_a_row",
    "overshoot [mm]": "overshoot_max_mm",
    "swing at the end / limit": "swing_ratio_end",
}
"""Heads of the first two tables, and the metrics below them."""

HELD = (("lwa3", (-0.58, 0.35, 0.15, -0.02)), ("ur5", (0.6, -0.71, -0.98, -0.05)))
"""Views that the arm cannot reach, held for 4 s: where task reconstruction has something to do."""

DWELLS = (2.5, 0.75)
"""How long a view is asked for [s]: longer and shorter than the planner takes to it, 1.5 s."""


def laws_table() -> str:
    """Every law on a helix that is too fast for the joints, at 1 ms."""
    rows = []
    for arm in ARMS:
        scenario = load_scenario("fast_helix", arm)
        insertion = scenario.insertion()
        for name, options in LAWS:
            controller = make_controller(name, insertion, scenario.period, **options)
            rows.append([arm, name, _said(options), *_measured(scenario, controller)])
    return _table(("arm", "controller", "options"), COLUMNS, rows)


def held_table() -> str:
    """Task priority without and with task reconstruction, at 4 ms."""
    rows = []
    for arm, view in HELD:
        path = ViewMoves(views=(view,), move=4.0, dwell=4.0)
        scenario = Scenario.on_shaft("held", arm, path, period=4e-3)
        insertion = scenario.insertion()
        for name in ("task_priority", "task_reconstruction"):
            controller = make_controller(name, insertion, scenario.period)
            rows.append([arm, str(view), name, *_measured(scenario, controller)])
    return _table(("arm", "view", "controller"), COLUMNS, rows)


def planner_table() -> str:
    """view_steps at 8 ms, planned from the last reference and from the measured pose."""
    heads = ["tip rms [mm]", "tip max [mm]", "RCM max [mm]", "orientation max [mrad]"]
    heads += ["largest step of the reference [mm]", "acceleration / limit", "reversals"]
    rows = []
    for dwell in DWELLS:
        for controller in ("dual_quaternion", "hierarchical_qp"):
            for start in ("reference", "measured"):
                run, found = view_steps(controller, start, dwell)
                cells = [
                    found.tip_rms_mm,
                    found.tip_max_mm,
                    found.rcm_max_mm,
                    found.orientation_max_mrad,
                    largest_step_mm(run),
                    found.acceleration_ratio_max,
                    found.reversals,
                ]
                rows.append([f"{dwell:g}", controller, start, *map(_cell, cells)])
    return _table(("a new view every [s]", "controller", "plan starts at"), heads, rows)


def view_steps(controller: str, start: str, dwell: float) -> tuple[Run, Metrics]:
    """A run of view_steps on the LWA3, and its metrics."""
    scenario = load_scenario("view_steps", "lwa3", period=8e-3, planner_from=start)
    path = scenario.path
    assert isinstance(path, ViewSteps)
    scenario = dataclasses.replace(scenario, path=dataclasses.replace(path, dwell=dwell))
    law = make_controller(controller, scenario.insertion(), scenario.period)
    run = simulate(scenario, law)
    return run, compute_metrics(run)


def largest_step_mm(run: Run) -> float:
    """Largest step of the desired tip in a period [mm]."""
    return 1e3 * float(np.linalg.norm(np.diff(run.tip_d, axis=0), axis=1).max())


def _measured(scenario: Scenario, controller: Controller) -> list[str]:
    found = compute_metrics(simulate(scenario, controller))
    return [_cell(getattr(found, metric)) for metric in COLUMNS.values()]


def _said(options: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in options.items())


def _cell(value: float) -> str:
    if math.isnan(value):
        return ""
    return "0" if abs(value) < 1e-5 else f"{value:.2g}" if abs(value) < 1.0 else f"{value:.3g}"


def _table(names: Iterable[str], heads: Iterable[str], rows: Iterable[list[str]]) -> str:
    names = list(names)
    return Table([*names, *heads], list(rows), words=len(names)).markdown()


if __name__ == "__main__":
    print(laws_table())
    print(held_table())
    print(planner_table(), end="")
