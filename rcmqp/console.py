"""What the command line prints: tables, JSON, warnings, progress."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from rcmqp.arm import Arm
from rcmqp.dualquaternion import Array
from rcmqp.metrics import Metrics, compute_metrics, obstacle_distance
from rcmqp.run import Run

WIDTH = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 120
RCM_WARNING_MM = 1.0
"""RCM error above which a run is remarked on: the customary engineering target."""

OBSTACLE_WARNING_MM = 0.01
"""How far inside an obstacle is remarked on: above what a step's curvature takes."""

out = Console(width=WIDTH)
err = Console(stderr=True)

_ERRORS = (
    ("tip", "tip", "mm"),
    ("effector", "effector", "mm"),
    ("rcm", "RCM", "mm"),
    ("orientation", "orientation", "mrad"),
)


@contextmanager
def bar(quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """A progress bar on stderr: call what it gives with a title, cycles done, and in all."""
    from rich.progress import Progress, TimeRemainingColumn  # only here, and slow to import

    columns = [*Progress.get_default_columns()[:-1], TimeRemainingColumn()]
    hidden = quiet or not err.is_terminal
    with Progress(*columns, console=err, transient=True, disable=hidden) as progress:
        tasks: dict[str, Any] = {}

        def advance(title: str, done: int, total: int) -> None:
            if title not in tasks:
                tasks[title] = progress.add_task(escape(title), total=total)
            progress.advance(tasks[title], done)

        yield advance


def print_json(data: Any) -> None:
    """One JSON object; what is not finite is null."""
    print(json.dumps(data, indent=2, allow_nan=False))


def print_table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> None:
    """A table of texts."""
    table = Table(*heads, box=box.SIMPLE)
    for row in rows:
        table.add_row(*map(escape, row))
    out.print(table)


def print_run(result: Run, as_json: bool, file: Path | None) -> None:
    """What came of a run; what it should not have done, on stderr."""
    metrics = compute_metrics(result)
    if as_json:
        print_json(run_json(result, metrics))
    else:
        title = f"{result.title}, T = {1e3 * result.period:g} ms"
        out.print(title, markup=False, highlight=False, soft_wrap=True)
        rows = []
        for name, label, unit in _ERRORS:
            values = (getattr(metrics, f"{name}_{kind}_{unit}") for kind in ("rms", "p95", "max"))
            rows.append([f"{label} {unit}", *(f"{value:.5f}" for value in values)])
        print_table(("error", "rms", "95 %", "max"), rows)
        for line in _summary(metrics):
            out.print(line, highlight=False, markup=False)
        if file is not None:
            out.print(f"run: {file}", highlight=False, markup=False, soft_wrap=True)
    for warning in warnings(result):
        err.print(f"[yellow]warning:[/] {escape(warning)}", highlight=False, soft_wrap=True)


def warnings(run: Run) -> list[str]:
    """What a run did that a patient or an arm would not allow, each with where and when."""
    trocar, mm = run.scenario.trocar, 1e3
    below, above = trocar.depth_range
    ratio = np.abs(run.v) / run.velocity_limit
    outside = np.maximum(run.lower - run.angles, run.angles - run.upper)
    found = []
    for reason, cycles in run.stops.items():
        found.append(
            f"the controller stopped safely in {len(cycles)} of {len(run.time)} cycles, first at "
            f"{run.time[cycles[0]]:.3f} s: {reason}"
        )
    if ratio.max() > 1.0:
        found.append(f"{_joint(run, ratio)} was asked for {ratio.max():.3g} times its speed limit")
    if outside.max() > 0.0:
        found.append(
            f"{_joint(run, outside)} left its position limits by {outside.max():.3g} rad; start "
            "elsewhere, or try --set objective=joint_centring or --set K_c=0"
        )
    if mm * run.rcm_error.max() > RCM_WARNING_MM:
        found.append(f"the RCM error reached {mm * run.rcm_error.max():.3g} mm")
    if run.depth.min() < below or run.depth.max() > above:
        found.append(
            f"the tip went from {mm * run.depth.min():.1f} to {mm * run.depth.max():.1f} mm, the "
            f"trocar allows {mm * below:.1f} to {mm * above:.1f} mm"
        )
    if run.tilt.max() > trocar.cone_half_angle:
        found.append(
            f"the shaft tilted by {math.degrees(run.tilt.max()):.1f} deg, the cone allows "
            f"{math.degrees(trocar.cone_half_angle):.1f} deg"
        )
    inside = -mm * obstacle_distance(run).min()
    if inside > OBSTACLE_WARNING_MM:
        found.append(f"the instrument went {inside:.3g} mm into an obstacle")
    gain = float(run.options.get("gain", 0.0)) * run.period
    if gain > 1.0:
        found.append(f"gain * period = {gain:.3g}: above 1 the law overshoots")
    return found


def print_arms(arms: Iterable[Arm]) -> None:
    """A line an arm."""
    rows = [
        (
            arm.name,
            str(arm.nv),
            f"{arm.reach:.2f}",
            _span(np.degrees(arm.upper - arm.lower)),
            _span(np.degrees(arm.velocity)),
            arm.licence,
        )
        for arm in arms
    ]
    print_table(("name", "joints", "reach, m", "travel, deg", "speed, deg/s", "licence"), rows)
    out.print("rcmqp arms NAME lists one arm's joints.", style="dim")


def print_arm(arm: Arm) -> None:
    """A line a joint."""
    columns = (arm.lower, arm.upper, arm.velocity, arm.acceleration, arm.home)
    out.print(
        f"{arm.title}: reach {arm.reach:.3f} m, flange {arm.flange}, licence {arm.licence}",
        soft_wrap=True,
        highlight=False,
        markup=False,
    )
    print_table(
        ("joint", "lower", "upper", "speed", "acceleration", "home"),
        [
            (joint, *(f"{column[i]:.4f}" for column in columns))
            for i, joint in enumerate(arm.joints)
        ],
    )
    out.print("In rad, rad/s, rad/s^2 (m for prismatic joints); inf: no limit given.", style="dim")


def run_json(result: Run, metrics: Metrics) -> dict[str, Any]:
    """What rcmqp run --json prints."""
    return {
        "scenario": result.scenario.name,
        "arm": result.scenario.arm,
        "controller": result.controller,
        "options": dict(result.options),
        "period": result.period,
        "duration": result.scenario.duration,
        "seed": result.scenario.seed,
        "digest": result.digest,
        "versions": dict(result.versions),
        "metrics": {name: _finite(x) for name, x in dataclasses.asdict(metrics).items()},
        "warnings": warnings(result),
    }


def arm_json(arm: Arm) -> dict[str, Any]:
    """What rcmqp arms --json prints for one arm."""
    arrays = ("lower", "upper", "velocity", "acceleration", "home")
    return {
        "name": arm.name,
        "title": arm.title,
        "joints": list(arm.joints),
        "reach": arm.reach,
        **{name: [_finite(x) for x in getattr(arm, name)] for name in arrays},
        "licence": arm.licence,
    }


def row_json(row: object) -> dict[str, Any]:
    """What rcmqp compare --json prints for one case."""
    values = dataclasses.asdict(row)  # type: ignore[call-overload]
    return {name: _finite(x) if isinstance(x, float) else x for name, x in values.items()}


def _summary(metrics: Metrics) -> Sequence[str]:
    return (
        f"depth of the tip      {metrics.depth_min_mm:.1f} to {metrics.depth_max_mm:.1f} mm",
        f"tip speed asked for   {metrics.tip_speed_rms_mm_s:.1f} mm/s rms",
        f"joint speed / limit   {metrics.speed_ratio_max:.3f} at most",
        f"margin to limits      {metrics.limit_margin_min_rad:.3f} rad at least",
        f"singular value        {metrics.singular_value_min:.4f} at least",
        f"controller step       {metrics.solve_time_median_us:.0f} us median, "
        f"{metrics.solve_time_p99_us:.0f} us p99, by the clock of this machine",
    )


def _joint(run: Run, excess: Array) -> str:
    """Name of the joint (n, nv) that exceeds most, and when."""
    row, column = np.unravel_index(int(np.argmax(excess)), excess.shape)
    return f"{run.joints[column]} at {run.time[row]:.3f} s"


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _span(values: Array) -> str:
    low, high = (f"{x:.0f}".replace("inf", "endless") for x in (np.min(values), np.max(values)))
    return low if low == high else f"{low} to {high}"
