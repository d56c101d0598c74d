"""Runs in tables: a row for each, or a column for each."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rcmqp.runs.behaviour import log_dimensionless_jerk, sparc
from rcmqp.runs.measures import until
from rcmqp.runs.metrics import ROUNDING, compute_metrics
from rcmqp.runs.run import Run
from rcmqp.runs.setup import (
    GIVEN,
    TOLD,
    given_cells,
    given_names,
    given_words,
    joint_units,
    unit_of,
)
from rcmqp.runs.vocabulary import MEASURES, meanings
from rcmqp.show.labels import remarks
from rcmqp.show.table import Table, definitions


@dataclass(frozen=True)
class Row:
    """The result of a case in a comparison.

    rcmqp.runs.vocabulary says what each number means. ``setting`` is the controller's as Case has
    it, empty if it is not known; ``limits_kept`` is None of a case that was not run; ``file`` is
    the name of the run's file in the comparison's folder. Of a case that failed, ``failure`` says
    why, as a sentence below the table, and its numbers are NaN.
    """

    scenario: str
    arm: str
    controller: str
    setting: str = ""
    feed_forward: str = ""
    roll: str = ""
    limits_enforced: str = ""
    period_ms: str = ""
    gain: str = ""
    assumed: str = ""
    setup: str = ""
    errors_until_s: float = np.nan
    duration_s: float = np.nan
    tip_rms_mm: float = np.nan
    tip_max_mm: float = np.nan
    contour_rms_mm: float = np.nan
    contour_max_mm: float = np.nan
    lag_max_s: float = np.nan
    rcm_rms_mm: float = np.nan
    rcm_max_mm: float = np.nan
    orientation_rms_mrad: float = np.nan
    orientation_max_mrad: float = np.nan
    limits_kept: bool | None = None
    speed_ratio_max: float = np.nan
    acceleration_ratio_max: float = np.nan
    jerk_ratio_max: float = np.nan
    limit_margin_min_rad: float = np.nan
    joint_unit: str = "rad"
    obstacle_distance_min_mm: float = np.nan
    saturated_share: float = np.nan
    singular_value_min: float = np.nan
    safe_stops: float = np.nan
    reversals_in_a_row: float = np.nan
    reversals: float = np.nan
    step_ratio_max: float = np.nan
    swing_ratio_end: float = np.nan
    overshoot_max_mm: float = np.nan
    settling_time_s: float = np.nan
    reference_end_s: float = np.nan
    sparc: float = np.nan
    ldlj: float = np.nan
    solve_time_median_us: float = np.nan
    solve_time_p99_us: float = np.nan
    digest: str = ""
    file: str = ""
    failure: str = ""


TIMES = ("solve_time_median_us", "solve_time_p99_us")
"""What differs from run to run."""

_LEAD = ("scenario", "arm", "controller", *GIVEN, "errors_until_s")
"""Columns that say what a row is of; what all rows share stands in a table's title instead."""

_ERRORS = (
    "tip_rms_mm",
    "orientation_rms_mrad",
    "rcm_max_mm",
    "limits_kept",
    "speed_ratio_max",
    "acceleration_ratio_max",
    "jerk_ratio_max",
)

_OVER_TIME = (
    "contour_max_mm",
    "orientation_max_mrad",
    "reversals",
    "overshoot_max_mm",
    "settling_time_s",
    "swing_ratio_end",
)

_MORE = (
    "tip_max_mm",
    "contour_rms_mm",
    "lag_max_s",
    "rcm_rms_mm",
    "reversals_in_a_row",
    "reference_end_s",
    "step_ratio_max",
    "limit_margin_min_rad",
    "obstacle_distance_min_mm",
    "singular_value_min",
    "saturated_share",
    "safe_stops",
    "sparc",
    "ldlj",
    "solve_time_median_us",
)

METRICS_ROWS = (
    "tip_rms_mm",
    "tip_max_mm",
    "contour_rms_mm",
    "contour_max_mm",
    "lag_max_s",
    "rcm_rms_mm",
    "rcm_max_mm",
    "orientation_rms_mrad",
    "orientation_max_mrad",
    "depth_min_mm",
    "depth_max_mm",
    "speed_ratio_max",
    "acceleration_ratio_max",
    "jerk_ratio_max",
    "limit_margin_min_rad",
    "singular_value_min",
    "tip_speed_rms_mm_s",
    "reversals_in_a_row",
    "reversals",
    "step_ratio_max",
    "reference_end_s",
    "overshoot_max_mm",
    "settling_time_s",
    "swing_ratio_end",
    "solve_time_median_us",
)
"""Measures that a page shows for each run, below what its controller was given."""


def row_of(run: Run) -> Row:
    """Sum up a run."""
    metrics = dataclasses.asdict(compute_metrics(run))
    names = {item.name for item in dataclasses.fields(Row)}
    values = {name: value for name, value in metrics.items() if name in names}
    values |= given_cells(run.head)
    ratios = (metrics[f"{name}_ratio_max"] for name in ("speed", "acceleration", "jerk"))
    kept = not any(ratio > 1.0 + ROUNDING for ratio in ratios)  # NaN where the arm has no limit
    speed = np.linalg.norm(np.diff(run.tip, axis=0), axis=1) / run.period
    return Row(
        run.scenario.name,
        run.scenario.arm,
        run.controller,
        **values,
        limits_kept=kept and metrics["limit_margin_min_rad"] >= -ROUNDING,
        safe_stops=float(np.nansum(run.diagnostics.get("safe_stop", np.zeros(1)))),
        sparc=sparc(speed, run.period),
        ldlj=log_dimensionless_jerk(speed, run.period),
        joint_unit=unit_of(joint_units(run.head)),
        digest=run.digest,
    )


def as_csv(rows: Iterable[Row]) -> str:
    """All columns, full precision."""
    names = [item.name for item in dataclasses.fields(Row)]
    return Table(names, [[getattr(row, name) for name in names] for row in rows]).csv()


def as_latex(rows: Sequence[Row]) -> str:
    """All of tables(), for a document that uses booktabs."""
    return "% needs \\usepackage{booktabs}\n" + "\n".join(each.latex() for each in tables(rows))


def metrics_table(runs: Sequence[Run], labels: Sequence[str]) -> Table:
    """Table of settings and metrics with a column for each run; missing numbers say so."""
    metrics_of_runs = [compute_metrics(run) for run in runs]
    given = [given_cells(run.head) for run in runs]
    rows = [[MEASURES[name].row, *(each[name] for each in given)] for name in given_names(given)]
    ends = [until(each.errors_until_s, each.duration_s) for each in metrics_of_runs]
    rows.append([MEASURES["errors_until_s"].row, *ends])
    unit = unit_of(unit for run in runs for unit in joint_units(run.head))
    for name in METRICS_ROWS:
        measure = MEASURES[name]
        if name == "limit_margin_min_rad":
            measure = dataclasses.replace(measure, unit=unit)
        texts = [measure.text(getattr(metrics, name)) or "missing" for metrics in metrics_of_runs]
        rows.append([measure.row, *texts])
    stops = [str(sum(map(len, run.stops.values()))) for run in runs]
    return Table(["", *labels], [*rows, [MEASURES["safe_stops"].row, *stops]])


def metrics_meanings() -> dict[str, str]:
    """Meanings of the rows of metrics_table()."""
    names = (*GIVEN, "errors_until_s", *METRICS_ROWS, "safe_stops")
    return {MEASURES[name].row: MEASURES[name].meaning for name in names}


def columns_explained() -> str:
    """Markdown list: what the columns of tables() mean."""
    return definitions(meanings((*_LEAD, *_ERRORS, *_OVER_TIME, *_MORE)))


def tables(rows: Sequence[Row]) -> list[Table]:
    """Tables of errors and limits, of behaviour over time, and of all other measures.

    Each table has the settings of every controller. Several controllers get three tables for
    each scenario and arm, in which they can be compared; one controller gets three for all.
    """
    laws = {(row.controller, row.setting, row.feed_forward, row.limits_enforced) for row in rows}
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        key = (row.scenario, row.arm) if len(laws) > 1 else ()
        groups.setdefault(key, []).append(row)
    return [each for group in groups.values() for each in _tables(group, len(laws) > 1)]


def as_markdown(rows: Sequence[Row]) -> str:
    """All of tables()."""
    return "\n".join(each.markdown() for each in tables(rows))


def _tables(rows: Sequence[Row], several: bool) -> list[Table]:
    """Three tables; values that all rows share are in the title, except those of controllers."""
    done = [row for row in rows if not row.failure]
    apart = ("controller", "feed_forward", "roll", "limits_enforced") if several else ()
    lead = [name for name in _LEAD if name in apart or len({_lead(r, name) for r in done}) != 1]
    lead = lead or ["controller"]
    title = f": {_words(done[0], [name for name in _LEAD if name not in lead])}" if done else ""
    errors = _table(f"Errors and limits{title}", rows, lead, _ERRORS if done else ())
    failures = [
        " ".join([row.scenario, *(["on", row.arm] if row.arm else [])])
        + f" with {_lead(row, 'controller')} could not be run: {row.failure}"
        for row in rows
        if row.failure
    ]
    tables = [dataclasses.replace(errors, notes=[*failures, *remarks(rows)])]
    if done:
        more = dataclasses.replace(_table(f"More{title}", done, lead, _MORE), main=False)
        tables += [_table(f"Over time{title}", done, lead, _OVER_TIME), more]
    return tables


def _words(row: Row, shared: Sequence[str]) -> str:
    """Values that all rows share, as a caption."""
    words = {name: _lead(row, name) for name in ("scenario", "controller")}
    words |= given_words(dataclasses.asdict(row))
    end = MEASURES["errors_until_s"]
    words |= {"arm": f"on {row.arm}", end.name: f"{end.label} {_lead(row, end.name)} {end.unit}"}
    return ", ".join(words[name] for name in shared if name in words)


def _table(title: str, rows: Sequence[Row], lead: Sequence[str], names: Sequence[str]) -> Table:
    unit = unit_of(x for row in rows if not row.failure for x in row.joint_unit.split(" or "))
    measures = [
        dataclasses.replace(MEASURES[name], unit=unit)
        if name == "limit_margin_min_rad"
        else MEASURES[name]
        for name in names
    ]
    heads = [MEASURES[name].column for name in lead] + [measure.column for measure in measures]
    cells = [
        [
            *(_lead(row, name) for name in lead),
            *("" if row.failure else each.text(getattr(row, each.name)) for each in measures),
        ]
        for row in rows
    ]
    return Table(heads, cells, len(lead), title)


def _lead(row: Row, name: str) -> str:
    """Text of a row in a column of _LEAD."""
    if name == "errors_until_s":
        return "" if row.failure else until(row.errors_until_s, row.duration_s)
    if name == "controller":
        options = row.setting.partition(":")[2].split(",")
        return ", ".join(
            [row.controller, *(text for text in options if text.partition("=")[0] not in TOLD)]
        ).removesuffix(", ")
    return str(getattr(row, name))
