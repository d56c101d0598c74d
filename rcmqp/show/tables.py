"""Runs in tables: a row for each, in CSV and in Markdown."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcmqp.runs.metrics import (
    AFTER_THE_STOP,
    ROUNDING,
    after_the_stop,
    against_limit,
    compute_metrics,
    readable,
    until,
)
from rcmqp.runs.printable import csv_text
from rcmqp.runs.run import Run
from rcmqp.runs.smoothness import log_dimensionless_jerk, sparc
from rcmqp.show.labels import GIVEN, TOLD, given_cells, given_words
from rcmqp.show.markdown import TitledTable


@dataclass(frozen=True)
class Row:
    """What came of a case.

    Attributes:
        setting: the controller's, as Case has it; empty if it is not known.
        feed_forward, limits_enforced, period_ms, gain: what the controller was given, as
            given_cells() has it.
        limits_kept: whether no joint left its position, speed, acceleration or jerk limits; None
            of a case that was not run.
        safe_stops: cycles that ended in the controller's safe stop.
        acceleration_ratio_max, jerk_ratio_max: NaN, too, on arms without such limits.
        assumed: which limits, acceleration or jerk, nobody has given, see Arm.assumed; or none.
        errors_until_s, reversals_in_a_row and so on: see Metrics.
        sparc, ldlj: smoothness of the tip's speed, see rcmqp.runs.smoothness.
        file: name of the run's file in the comparison's folder.
        failure: why there is no run; empty where there is one. Numbers are NaN then.
    """

    scenario: str
    arm: str
    controller: str
    setting: str = ""
    feed_forward: str = ""
    limits_enforced: str = ""
    period_ms: str = ""
    gain: str = ""
    assumed: str = ""
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

_LEAD = {
    "scenario": "scenario",
    "arm": "arm",
    "controller": "controller",
    **GIVEN,
    "until": "rms until [s]",
}
"""Columns that say what a row is of; what all rows share stands in a table's title instead."""

_ERRORS = {
    "tip_rms_mm": "tip rms [mm]",
    "orientation_rms_mrad": "orient. rms [mrad]",
    "rcm_max_mm": "RCM max [mm]",
    "limits_kept": "joint limits kept",
    "speed_ratio_max": "speed / limit",
    "acceleration_ratio_max": "acc. / limit",
    "jerk_ratio_max": "jerk / limit",
}

_OVER_TIME = {
    "contour_max_mm": "contour max [mm]",
    "orientation_max_mrad": "orient. max [mrad]",
    "reversals": "cycles with a reversal",
    "overshoot_max_mm": "overshoot [mm]",
    "settling_time_s": "below 1 mm after [s]",
    "swing_ratio_end": "swing at the end / limit",
}

_MORE = {
    "tip_max_mm": "tip max [mm]",
    "contour_rms_mm": "contour rms [mm]",
    "lag_max_s": "lag max [s]",
    "rcm_rms_mm": "RCM rms [mm]",
    "reversals_in_a_row": "reversals in a row",
    "reference_end_s": "reference stops [s]",
    "step_ratio_max": "step of v / limit",
    "limit_margin_min_rad": "margin to limits [rad]",
    "obstacle_distance_min_mm": "to obstacle [mm]",
    "singular_value_min": "singular value, least",
    "saturated_share": "saturated",
    "safe_stops": "stops",
    "sparc": "SPARC",
    "ldlj": "LDLJ",
    "solve_time_median_us": "step [us]",
}


def row_of(run: Run) -> Row:
    """Sum up a run."""
    found = dataclasses.asdict(compute_metrics(run))
    names = {item.name for item in dataclasses.fields(Row)}
    values = {name: value for name, value in found.items() if name in names}
    values |= given_cells(run.head)
    ratios = (found[f"{name}_ratio_max"] for name in ("speed", "acceleration", "jerk"))
    kept = not any(ratio > 1.0 + ROUNDING for ratio in ratios)  # NaN where the arm has no limit
    speed = np.linalg.norm(np.diff(run.tip, axis=0), axis=1) / run.period
    return Row(
        run.scenario.name,
        run.scenario.arm,
        run.controller,
        **values,
        limits_kept=kept and found["limit_margin_min_rad"] >= -ROUNDING,
        safe_stops=float(np.nansum(run.diagnostics.get("safe_stop", np.zeros(1)))),
        sparc=sparc(speed, run.period),
        ldlj=log_dimensionless_jerk(speed, run.period),
        digest=run.digest,
    )


def as_csv(rows: Iterable[Row]) -> str:
    """All columns, full precision."""
    names = [item.name for item in dataclasses.fields(Row)]
    return csv_text(names, (dataclasses.asdict(row) for row in rows))


def tables(rows: Sequence[Row]) -> list[TitledTable]:
    """Errors and limits; what happens over time; and what else there is.

    What every controller was given stands in each table. Several controllers get three tables for
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
    return "\n".join(each.markdown for each in tables(rows))


def _tables(rows: Sequence[Row], several: bool) -> list[TitledTable]:
    """Three tables; what all rows share is in the title, but for what tells controllers apart."""
    made = [row for row in rows if not row.failure]
    apart = ("controller", "feed_forward", "limits_enforced") if several else ()
    lead = [name for name in _LEAD if name in apart or len({_lead(r, name) for r in made}) != 1]
    lead = lead or ["controller"]
    title = f": {_words(made[0], [name for name in _LEAD if name not in lead])}" if made else ""
    found = [_table(f"Errors and limits{title}", rows, lead, _ERRORS)]
    if len(made) < len(rows):
        cells = [[*texts, row.failure] for texts, row in zip(found[0].rows, rows, strict=True)]
        found[0] = dataclasses.replace(found[0], heads=[*found[0].heads, "failure"], rows=cells)
    if made:
        more = dataclasses.replace(_table(f"More{title}", made, lead, _MORE), main=False)
        found += [_table(f"Over time{title}", made, lead, _OVER_TIME), more]
    return found


def _words(row: Row, shared: Sequence[str]) -> str:
    """What all rows share, in the words of a caption."""
    words = {name: _lead(row, name) for name in ("scenario", "controller")}
    words |= given_words(dataclasses.asdict(row))
    words |= {"arm": f"on {row.arm}", "until": f"rms until {_lead(row, 'until')} s"}
    return ", ".join(words[name] for name in shared)


def _table(
    title: str, rows: Sequence[Row], lead: Sequence[str], titles: Mapping[str, str]
) -> TitledTable:
    heads = [_LEAD[name] for name in lead] + list(titles.values())
    cells = [
        [*(_lead(row, name) for name in lead), *(_cell(row, name) for name in titles)]
        for row in rows
    ]
    return TitledTable(title, heads, cells, len(lead))


def _lead(row: Row, name: str) -> str:
    """What a row is of, in a column of _LEAD."""
    if name == "until":
        return "" if row.failure else until(row.errors_until_s, row.duration_s)
    if name == "controller":
        options = row.setting.partition(":")[2].split(",")
        return ", ".join(
            [row.controller, *(text for text in options if text.partition("=")[0] not in TOLD)]
        ).removesuffix(", ")
    return str(getattr(row, name))


def _cell(row: Row, name: str) -> str:
    """A number of a row, for people."""
    value = getattr(row, name)
    if row.failure or value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if name in AFTER_THE_STOP:
        return after_the_stop(value)
    if name in ("acceleration_ratio_max", "jerk_ratio_max", "limit_margin_min_rad"):
        return against_limit(value)
    if np.isinf(value):
        return "none"
    return "" if np.isnan(value) else readable(value, ".3g")
