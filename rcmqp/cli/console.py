"""What the command line prints: tables, JSON, warnings, progress."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape

from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.head import Head
from rcmqp.runs.measures import readable
from rcmqp.runs.metrics import BEHIND, ROUNDING, Metrics, compute_metrics
from rcmqp.runs.moved import recording_remarks
from rcmqp.runs.run import Run
from rcmqp.runs.run_file import Recording
from rcmqp.runs.untrusted import one_line, printable
from rcmqp.runs.vocabulary import MEASURES
from rcmqp.show.labels import given_cells, given_words, joint_units, unit_of
from rcmqp.show.table import Table
from rcmqp.world.arm import Arm
from rcmqp.world.ease import ease_at
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Instrument
from rcmqp.world.loading import arm_names

WIDTH = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 120
RCM_WARNING_MM = 1.0
"""RCM error above which a run is remarked on: the customary engineering target."""

OBSTACLE_WARNING_MM = 0.01
"""How far inside an obstacle is remarked on: above what a step's curvature takes."""


class PlainConsole(Console):
    """A console that runs no terminal escapes out of names and messages."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does; control characters in texts are written as escapes."""
        shown = [printable(each) if isinstance(each, str) else each for each in objects]
        super().print(*shown, **options)


out = PlainConsole(width=WIDTH, emoji=False)
err = PlainConsole(stderr=True, emoji=False)

REVERSALS_WARNING = 2
"""Cycles in a row in which a joint may turn round before it is remarked on."""

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
                tasks[title] = progress.add_task(escape(one_line(title)), total=total)
            progress.advance(tasks[title], done)

        yield advance


def show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: Any = None,
    line: str | None = None,
) -> None:
    """Print a warning as a sentence; in place of warnings.showwarning()."""
    err.print(f"[yellow]warning:[/] {escape(one_line(str(message)))}", soft_wrap=True)


def print_json(data: Any) -> None:
    """One JSON object; what is not finite is null."""
    print(json.dumps(data, indent=2, allow_nan=False))


def print_written(path: Path, more: str = "") -> None:
    """Say that a file or folder is written; brackets and colons in its name are its own."""
    out.print(one_line(f"wrote {path}{more}"), markup=False, highlight=False, soft_wrap=True)


def print_note(text: str) -> None:
    """Say something that is no result, on stderr."""
    err.print(one_line(f"note: {text}"), markup=False, highlight=False, soft_wrap=True)


def print_tables(tables: Iterable[Table]) -> None:
    """Those of several tables that matter most, each below its title."""
    for table in tables:
        if table.main:
            if table.title:
                out.print(table.title, markup=False, highlight=False, soft_wrap=True)
            out.print(table)
            for note in table.notes:
                out.print(note, markup=False, highlight=False)


def print_run(result: Recording, as_json: bool, file: Path | None) -> None:
    """Print a run's results, and on stderr the limits that it broke."""
    metrics = compute_metrics(result)
    if as_json:
        print_json(run_json(result, metrics))
    else:
        out.print(one_line(result.title), markup=False, highlight=False, soft_wrap=True)
        words = ", ".join(given_words(given_cells(result.head)).values())
        out.print(one_line(words), markup=False, highlight=False, soft_wrap=True)
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
            out.print(one_line(f"run: {file}"), highlight=False, markup=False, soft_wrap=True)
    for remark in warnings(result, metrics):
        err.print(
            f"[yellow]warning:[/] {escape(one_line(remark))}", highlight=False, soft_wrap=True
        )


def warnings(run: Recording, metrics: Metrics) -> list[str]:
    """What a run did that a patient or an arm would not allow, each with where and when."""
    head = run.head
    period, trocar = head.scenario.period, head.scenario.trocar
    below, above = trocar.depth_range
    found = []
    for reason, cycles in head.stops.items():
        found.append(
            f"the controller stopped safely in {len(cycles)} of {run.column('time').shape[0]} "
            f"cycles, first at {period * cycles[0]:.3f} s: {reason}"
        )
    if metrics.speed_ratio_max > 1.0 + ROUNDING:
        _, where = _where(run, lambda part: np.abs(part.v) / part.velocity_limit)
        ratio, more = metrics.speed_ratio_max, _uncounted(head, "speed")
        found.append(f"{where} was asked for {ratio:.3g} times its speed limit{more}")
    for kind in ("acceleration", "jerk"):
        if (ratio := getattr(metrics, f"{kind}_ratio_max")) > 1.0 + ROUNDING:
            assumed = "assumed " if kind in head.assumed else ""
            found.append(
                f"the joints were asked for up to {ratio:.3g} times their {assumed}{kind} limits"
                + _uncounted(head, kind)
            )
    if metrics.limit_margin_min_rad < -ROUNDING:
        joint, where = _where(
            run, lambda part: np.maximum(part.lower - part.angles, part.angles - part.upper)
        )
        found.append(
            f"{where} left its position limits by {-metrics.limit_margin_min_rad:.3g} "
            f"{joint_units(head)[joint]}; start elsewhere, or try --set "
            "objective=joint_centring or --set K_c=0"
        )
    if metrics.rcm_max_mm > RCM_WARNING_MM:
        found.append(f"the RCM error reached {metrics.rcm_max_mm:.3g} mm")
    if metrics.depth_min_mm < 1e3 * below or metrics.depth_max_mm > 1e3 * above:
        found.append(
            f"the tip went from {metrics.depth_min_mm:.1f} to {metrics.depth_max_mm:.1f} mm, the "
            f"trocar allows {1e3 * below:.1f} to {1e3 * above:.1f} mm"
        )
    if 1e-3 * metrics.tilt_max_mrad > trocar.cone_half_angle:
        found.append(
            f"the shaft tilted by {math.degrees(1e-3 * metrics.tilt_max_mrad):.1f} deg, the cone "
            f"allows {math.degrees(trocar.cone_half_angle):.1f} deg"
        )
    inside = -metrics.obstacle_distance_min_mm
    if inside > OBSTACLE_WARNING_MM:
        found.append(f"the instrument went {inside:.3g} mm into an obstacle")
    if metrics.reversals_in_a_row > REVERSALS_WARNING:
        found.append(
            f"a joint turned round in {metrics.reversals_in_a_row:.0f} cycles in a row: the "
            "controller rattles"
        )
    if metrics.behind_share > BEHIND:
        found.append(
            f"the loop fell {metrics.behind_s:.3g} s behind the clock, "
            f"{100 * metrics.behind_share:.0f} % of the time: the machine was too busy for a "
            f"period of {1e3 * period:g} ms, and the arm was slower than its controller asked"
        )
    found += recording_remarks(head.scenario)
    gain = float(head.options.get("gain", 0.0)) * period
    if gain > 1.0:
        found.append(f"gain * period = {gain:.3g}: above 1 the law overshoots")
    return found


def _uncounted(head: Head, limit: str) -> str:
    """That a law does not know a limit which it broke; nothing if it does, or does not say."""
    limits = head.given.limits
    known = limits is None or limit in limits
    return "" if known else f": {head.controller} does not count {limit} limits"


def print_arms(arms: Iterable[Arm]) -> None:
    """A line an arm."""
    rows = [
        (
            arm.name,
            str(arm.nv),
            f"{arm.reach:.2f}",
            _spans(arm, arm.upper - arm.lower),
            _spans(arm, arm.velocity),
            _spans(arm, arm.acceleration).replace("endless", "no limit"),
            _spans(arm, arm.jerk).replace("endless", "no limit"),
            "both" if arm.assumed == {"acceleration", "jerk"} else ", ".join(sorted(arm.assumed)),
            arm.licence,
        )
        for arm in arms
    ]
    heads = "name joints reach travel speed acceleration jerk assumed licence".split()
    print_tables([Table(heads, rows, words=len(heads))])
    out.print(
        "In m, deg, deg/s, deg/s^2, deg/s^3; prismatic joints in m, m/s, m/s^2, m/s^3. Assumed: "
        "which of\nacceleration and jerk no source gives; a careful value stands in. rcmqp arms "
        "NAME lists one arm's joints.",
        style="dim",
    )


def print_arm(arm: Arm) -> None:
    """A line a joint."""
    out.print(
        f"{arm.title}: reach {arm.reach:.3f} m, flange {arm.flange}, licence {arm.licence}",
        soft_wrap=True,
        highlight=False,
        markup=False,
    )
    heads = ("joint", "unit", "lower", "upper", "speed", "acceleration", "jerk", "home")
    rows = [
        (
            joint,
            arm.joint_units[i],
            *(f"{column[i]:.4f}" for column in (arm.lower, arm.upper)),
            *(
                _limit(getattr(arm, name)[i], bool(arm.is_assumed(name)[i]))
                for name in ("velocity", "acceleration", "jerk")
            ),
            f"{arm.home[i]:.4f}",
        )
        for i, joint in enumerate(arm.joints)
    ]
    print_tables([Table(heads, rows, words=len(heads))])
    note = "Positions in the joint's unit, speeds in unit/s, accelerations in unit/s^2, jerks in "
    note += "unit/s^3."
    if arm.assumed:
        note += f" Assumed, as no source gives it: {', '.join(sorted(arm.assumed))}."
    if arm.speed_near_limits is not None:
        note += " Near its position limits a joint may move only more slowly."
    out.print(note, style="dim", soft_wrap=True)
    if arm.source is not None and arm.name not in arm_names():
        ease = ease_at(Insertion.on_shaft(arm, Instrument()))
        for line in (*arm.source.notes, f"home: {ease}"):
            out.print(one_line(line), soft_wrap=True, highlight=False, markup=False)
        for topic, source in arm.source.sources.items():
            line = one_line(f"source of {topic}: {source}")
            out.print(line, style="dim", soft_wrap=True, highlight=False, markup=False)


def run_json(result: Recording, metrics: Metrics) -> dict[str, Any]:
    """What rcmqp run --json prints."""
    head = result.head
    return {
        "scenario": head.scenario.name,
        "arm": head.scenario.arm,
        "controller": head.controller,
        "options": _plain(head.options),
        "period": head.scenario.period,
        "duration": head.scenario.duration,
        "seed": head.scenario.seed,
        "path_done": path_done(result),
        "digest": result.digest,
        "versions": dict(head.versions),
        "assumed": list(head.assumed),
        "given": given_cells(head),
        "metrics": {name: _finite(x) for name, x in dataclasses.asdict(metrics).items()},
        "warnings": warnings(result, metrics),
    }


def _plain(value: Any) -> Any:
    """A value out of JSON; numbers in it that are not finite are null."""
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return _finite(value) if isinstance(value, float) else value


def arm_json(arm: Arm) -> dict[str, Any]:
    """What rcmqp arms --json prints for one arm."""
    arrays = ("lower", "upper", "velocity", "acceleration", "jerk", "home")
    return {
        "name": arm.name,
        "title": arm.title,
        "joints": list(arm.joints),
        "joint_units": list(arm.joint_units),
        "reach": arm.reach,
        **{name: [_finite(x) for x in getattr(arm, name)] for name in arrays},
        "assumed": sorted(arm.assumed),
        "notes": [] if arm.source is None else list(arm.source.notes),
        "licence": arm.licence,
    }


def row_json(row: object) -> dict[str, Any]:
    """What rcmqp compare --json prints for one case."""
    values = dataclasses.asdict(row)  # type: ignore[call-overload]
    return {name: _finite(x) if isinstance(x, float) else x for name, x in values.items()}


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
        f"joints turn round     in {metrics.reversals_in_a_row:.0f} cycles in a row at most, in "
        f"{metrics.reversals:.0f} in all",
        f"step of a speed       {readable(metrics.step_ratio_max, '.4f')} of its limit at most",
        *_after_the_stop(metrics),
        f"controller step       {metrics.solve_time_median_us:.0f} us median, "
        f"{metrics.solve_time_p99_us:.0f} us p99, by the clock of this machine",
        *_punctual(metrics),
    )


def _punctual(metrics: Metrics) -> list[str]:
    """How late the cycles of a real-time loop were; nothing of a run that no clock drove."""
    if math.isnan(metrics.late_share):
        return []
    return [
        f"cycles late           {100 * metrics.late_share:.2f} % by half a period or more; the "
        f"loop ends {metrics.behind_s:.3f} s behind the clock"
    ]


def _governed(result: Recording) -> Sequence[str]:
    """How far a path under a governor came; nothing of other runs."""
    if (done := path_done(result)) is None:
        return ()
    rows = result.column("time").shape[0]
    time, path_time = (result.column(name)[rows - 1 : rows][0] for name in ("time", "path_time"))
    return (
        f"path under governor   {100 * done:.1f} % done at the end, "
        f"its clock {time - path_time:.3f} s behind",
    )


def path_done(result: Recording) -> float | None:
    """Share of its path's time that a governed run came to; None without a governor."""
    scenario = result.head.scenario
    if scenario.governor is None:
        return None
    path_time = result.column("path_time")
    rows = path_time.shape[0]
    return min(1.0, float(path_time[rows - 1 : rows][0]) / scenario.path.duration)


def _path_end(metrics: Metrics) -> list[str]:
    """That the run goes on after its path has ended, if it does."""
    if metrics.errors_until_s == metrics.duration_s:
        return []
    return [
        f"path ended            at {metrics.errors_until_s:g} s: rms and 95 % are until then, "
        f"max is of all {metrics.duration_s:g} s"
    ]


def _after_the_stop(metrics: Metrics) -> list[str]:
    """How tip and joints come to rest; nothing where the reference does not stop."""
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


def _where(run: Recording, excess_of: Callable[[Run], Array]) -> tuple[int, str]:
    """Number of the joint whose excess (n, nv) is largest; its name, and when that is."""
    worst, joint, where = -math.inf, 0, ""
    for part in run.parts():
        excess = excess_of(part)
        row, column = np.unravel_index(int(np.argmax(excess)), excess.shape)
        if excess[row, column] > worst:
            worst, joint = excess[row, column], int(column)
            where = f"{part.joints[column]} at {part.time[row]:.3f} s"
    return joint, where


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _limited(name: str, metrics: Metrics, more: str) -> str:
    """A measure beside a limit, and more words; without them where there is no limit."""
    value = getattr(metrics, name)
    text = MEASURES[name].text(round(value, 3) + 0.0 if math.isfinite(value) else value, ".3f")
    return text + more if math.isfinite(value) else text


def _limit(value: float, assumed: bool) -> str:
    """A limit of speed, acceleration or jerk, for people."""
    return "no limit" if math.isinf(value) else f"{value:.4f}{' assumed' if assumed else ''}"


def _spans(arm: Arm, values: Array) -> str:
    """Least to largest of a limit: of revolute joints in degrees, of prismatic ones in metres."""
    slides = np.array([unit == "m" for unit in arm.joint_units])
    turning, sliding = np.degrees(values[~slides]), values[slides]
    texts = [_span(turning, ".0f")] if turning.size else []
    texts += [f"{_span(sliding, '.3g')} m"] if sliding.size else []
    return "; ".join(texts)


def _span(values: Array, style: str) -> str:
    low, high = (format(x, style).replace("inf", "endless") for x in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"
