"""Print the results of a run, and warnings about it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape

from rcmqp.cli.console import err, out, print_json, print_tables, say
from rcmqp.runs.head import Head
from rcmqp.runs.measures import readable
from rcmqp.runs.metrics import BEHIND, ROUNDING, ChangeRatios, Metrics, compute_metrics
from rcmqp.runs.moved import recording_remarks
from rcmqp.runs.run_file import Recording, where_largest
from rcmqp.runs.setup import given_cells, given_words, joint_units, unit_of
from rcmqp.runs.untrusted import one_line
from rcmqp.runs.vocabulary import MEASURES
from rcmqp.show.table import Table

RCM_WARNING_MM = 1.0
"""RCM error above which a run is remarked on: the customary engineering target."""


OBSTACLE_WARNING_MM = 0.01
"""How far inside an obstacle is remarked on: above what a step's curvature takes."""


REVERSALS_WARNING = 2
"""Cycles in a row in which a joint may turn round before it is remarked on."""


FIRST_CYCLES = 2
"""Cycles in which a jump of speed at the start shows: in the first, and its end in the second."""


START_ERROR_M = 1e-6
"""Error at the start above which it may be what the joints hurry to undo."""


_ERRORS = (
    ("tip", "tip", "mm"),
    ("effector", "effector", "mm"),
    ("rcm", "RCM", "mm"),
    ("orientation", "orientation", "mrad"),
)


def print_run(result: Recording, as_json: bool, file: Path | None) -> None:
    """Print a run's results, and on stderr the limits that it broke."""
    metrics = compute_metrics(result)
    if as_json:
        print_json(run_json(result, metrics))
    else:
        say(one_line(result.title))
        words = ", ".join(given_words(given_cells(result.head)).values())
        say(one_line(words))
        rows = []
        for name, label, unit in _ERRORS:
            values = (getattr(metrics, f"{name}_{kind}_{unit}") for kind in ("rms", "p95", "max"))
            rows.append([f"{label} {unit}", *(readable(value, ".5f") for value in values)])
        print_tables([Table(("error", "rms", "95 %", "max"), rows)])
        for line in (
            *_path_end(metrics),
            *_summary(metrics, unit_of(joint_units(result.head))),
            *_governed(result),
        ):
            out.print(line, highlight=False, markup=False)
        if file is not None:
            say(one_line(f"run: {file}"))
    for remark in warnings(result, metrics):
        err.print(
            f"[yellow]warning:[/] {escape(one_line(remark))}", highlight=False, soft_wrap=True
        )


def warnings(run: Recording, metrics: Metrics) -> list[str]:
    """List what would harm a patient or an arm in a run, each with joint and time."""
    head = run.head
    period, trocar = head.scenario.period, head.scenario.trocar
    below, above = trocar.depth_range
    texts = []
    for reason, cycles in head.stops.items():
        texts.append(
            f"the controller stopped safely in {len(cycles)} of {run.column('time').shape[0]} "
            f"cycles, first at {period * cycles[0]:.3f} s: {reason}"
        )
    if metrics.speed_ratio_max > 1.0 + ROUNDING:
        _, _, where = where_largest(run, lambda part: np.abs(part.v) / part.velocity_limit)
        ratio, more = metrics.speed_ratio_max, _uncounted(head, "speed")
        texts.append(f"{where} was asked for {ratio:.3g} times its speed limit{more}")
    for kind in ("acceleration", "jerk"):
        if (ratio := getattr(metrics, f"{kind}_ratio_max")) > 1.0 + ROUNDING:
            assumed = "assumed " if kind in head.assumed else ""
            changes = ChangeRatios()
            _, row, where = where_largest(run, lambda part: changes.of(part)[kind])  # noqa: B023
            texts.append(
                f"{where} was asked for {ratio:.3g} times its {assumed}{kind} limit"
                + _uncounted(head, kind)
                + (_start_of_objective(run) if row < FIRST_CYCLES else "")
            )
    if metrics.limit_margin_min_rad < -ROUNDING:
        joint, _, where = where_largest(
            run, lambda part: np.maximum(part.lower - part.angles, part.angles - part.upper)
        )
        texts.append(
            f"{where} left its position limits by {-metrics.limit_margin_min_rad:.3g} "
            f"{joint_units(head)[joint]}{_uncounted(head, 'position')}; {_away_from_limits(head)}"
        )
    if metrics.rcm_max_mm > RCM_WARNING_MM:
        texts.append(f"the RCM error reached {metrics.rcm_max_mm:.3g} mm")
    if metrics.depth_min_mm < 1e3 * below or metrics.depth_max_mm > 1e3 * above:
        texts.append(
            f"the tip went from {metrics.depth_min_mm:.1f} to {metrics.depth_max_mm:.1f} mm, the "
            f"trocar allows {1e3 * below:.1f} to {1e3 * above:.1f} mm"
        )
    if 1e-3 * metrics.tilt_max_mrad > trocar.cone_half_angle:
        texts.append(
            f"the shaft tilted by {math.degrees(1e-3 * metrics.tilt_max_mrad):.1f} deg, the cone "
            f"allows {math.degrees(trocar.cone_half_angle):.1f} deg"
        )
    inside = -metrics.obstacle_distance_min_mm
    if inside > OBSTACLE_WARNING_MM:
        texts.append(f"the instrument went {inside:.3g} mm into an obstacle")
    if metrics.reversals_in_a_row > REVERSALS_WARNING:
        texts.append(
            f"a joint turned round in {metrics.reversals_in_a_row:.0f} cycles in a row: the "
            "controller rattles"
        )
    if metrics.behind_share > BEHIND:
        texts.append(
            f"the loop fell {metrics.behind_s:.3g} s behind the clock, "
            f"{100 * metrics.behind_share:.0f} % of the time: the machine was too busy for a "
            f"period of {1e3 * period:g} ms, and the arm was slower than its controller asked"
        )
    texts += recording_remarks(head.scenario)
    gain = float(head.options.get("gain", 0.0)) * period
    if gain > 1.0:
        texts.append(f"gain * period = {gain:.3g}: above 1 the law overshoots")
    return texts


def _uncounted(head: Head, limit: str) -> str:
    """Words for a limit that the controller broke and does not know; empty otherwise."""
    limits = head.given.limits
    known = limits is None or limit in limits
    return "" if known else f": {head.controller} does not count {limit} limits"


def _start_of_objective(run: Recording) -> str:
    """Say that the null-space objective begins with a jump; empty if something else may do so."""
    head = run.head
    redundant = len(head.joints) > 6 and head.options.get("K_c")
    if not redundant or not run.column("effector_error")[0:1] < START_ERROR_M:
        return ""
    return (
        f"; the start of the objective, which {head.controller} begins at full gain: try "
        "--set K_c=0, or -c hierarchical_qp, which keeps the limits"
    )


def _away_from_limits(head: Head) -> str:
    """Return what to do about joints at their limits, by options that the controller has."""
    tries = []
    if head.options.get("objective", "joint_centring") != "joint_centring":
        tries.append("--set objective=joint_centring")
    if head.options.get("K_c"):
        tries.append("--set K_c=0")
    return "start elsewhere" + (f", or try {' or '.join(tries)}" if tries else "")


def run_json(result: Recording, metrics: Metrics) -> dict[str, Any]:
    """The JSON of a run, for rcmqp run --json."""
    head = result.head
    return {
        "scenario": head.scenario.name,
        "arm": head.scenario.arm,
        "controller": head.controller,
        "options": dict(head.options),
        "period": head.scenario.period,
        "duration": head.scenario.duration,
        "seed": head.scenario.seed,
        "path_done": path_done(result),
        "digest": result.digest,
        "versions": dict(head.versions),
        "assumed": list(head.assumed),
        "given": given_cells(head),
        "metrics": dataclasses.asdict(metrics),
        "warnings": warnings(result, metrics),
    }


def _summary(metrics: Metrics, unit: str) -> Sequence[str]:
    return (
        f"contour error         {readable(metrics.contour_rms_mm, '.5f')} mm rms, "
        f"{readable(metrics.contour_max_mm, '.5f')} mm max, tip late by "
        f"{metrics.lag_max_s:.3f} s at most",
        f"depth of the tip      {metrics.depth_min_mm:.1f} to {metrics.depth_max_mm:.1f} mm",
        f"tip speed asked for   {metrics.tip_speed_rms_mm_s:.1f} mm/s rms",
        f"joint speed / limit   {metrics.speed_ratio_max:.3f} at most",
        f"acceleration / limit  {_limited('acceleration_ratio_max', metrics, ' at most')}",
        f"jerk / limit          {_limited('jerk_ratio_max', metrics, ' at most')}",
        f"margin to limits      {_limited('limit_margin_min_rad', metrics, f' {unit} at least')}",
        f"singular value        {metrics.singular_value_min:.4f} at least",
        f"joint reversals       {metrics.reversals:.0f}, in at most "
        f"{metrics.reversals_in_a_row:.0f} cycles in a row",
        f"step of a speed       {readable(metrics.step_ratio_max, '.4f')} of its limit at most",
        *_after_the_stop(metrics),
        f"controller step       {metrics.solve_time_median_us:.0f} us median, "
        f"{metrics.solve_time_p99_us:.0f} us p99, by the clock of this machine",
        *_punctual(metrics),
    )


def _punctual(metrics: Metrics) -> list[str]:
    """Return how late the cycles of a real-time loop were; nothing for a simulated run."""
    if math.isnan(metrics.late_share):
        return []
    return [
        f"cycles late           {100 * metrics.late_share:.2f} % by half a period or more; the "
        f"loop ends {metrics.behind_s:.3f} s behind the clock"
    ]


def _governed(result: Recording) -> Sequence[str]:
    """Say how much of the path a run with a governor completed; empty for other runs."""
    if (done := path_done(result)) is None:
        return ()
    rows = result.column("time").shape[0]
    time, path_time = (result.column(name)[rows - 1 : rows][0] for name in ("time", "path_time"))
    return (
        f"path under governor   {100 * done:.1f} % done at the end, "
        f"its clock {time - path_time:.3f} s behind",
    )


def path_done(result: Recording) -> float | None:
    """Share of the path that a run with a governor completed; None without a governor."""
    scenario = result.head.scenario
    if scenario.governor is None:
        return None
    path_time = result.column("path_time")
    rows = path_time.shape[0]
    return min(1.0, float(path_time[rows - 1 : rows][0]) / scenario.path.duration)


def _path_end(metrics: Metrics) -> list[str]:
    """Say that the run goes on after its path has ended; empty if it does not."""
    if metrics.errors_until_s == metrics.duration_s:
        return []
    return [
        f"path ended            at {metrics.errors_until_s:g} s: rms and 95 % are until then, "
        f"max is of all {metrics.duration_s:g} s"
    ]


def _after_the_stop(metrics: Metrics) -> list[str]:
    """Say how tip and joints come to rest; empty if the reference does not stop."""
    if math.isnan(metrics.reference_end_s):
        return []
    settling = MEASURES["settling_time_s"].text(metrics.settling_time_s, ".3f")
    tip = "never for good" if settling == "never" else f"for good after {settling} s"
    lines = [
        f"reference stops       at {metrics.reference_end_s:.3f} s; tip error below 1 mm {tip}"
    ]
    if not math.isnan(metrics.swing_ratio_end):
        overshoot = MEASURES["overshoot_max_mm"].text(metrics.overshoot_max_mm)
        swing = MEASURES["swing_ratio_end"].text(metrics.swing_ratio_end)
        lines += [
            f"tip past its end      {overshoot} mm at most",
            f"swing of a speed      {swing} of its limit in the last second",
        ]
    return lines


def _limited(name: str, metrics: Metrics, more: str) -> str:
    """A measure as text with more words behind it, or ``no limit``."""
    value = getattr(metrics, name)
    text = MEASURES[name].text(round(value, 3) + 0.0 if math.isfinite(value) else value, ".3f")
    return text + more if math.isfinite(value) else text
