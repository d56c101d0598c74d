"""Scenarios x arms x controllers, each run in a process of its own, in one table."""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from rcmqp.controllers import make_controller
from rcmqp.errors import OptionError, RunFileError
from rcmqp.files import check_writable, make_folder, unlike, whole
from rcmqp.loading import arm_names
from rcmqp.markdown import literal
from rcmqp.metrics import (
    AFTER_THE_STOP,
    ROUNDING,
    after_the_stop,
    against_limit,
    compute_metrics,
)
from rcmqp.run import Run
from rcmqp.scenario_loading import load_scenario, own_arm
from rcmqp.simulate import simulate
from rcmqp.smoothness import log_dimensionless_jerk, sparc


@dataclass(frozen=True)
class Case:
    """One run to make.

    Attributes:
        scenario, controller: names.
        arm: name; None for the scenario's own.
        changes: fields of the scenario to be other than it has them.
        options: of the controller.
        flange: where the arm is a URDF, the frame that carries the instrument.
    """

    scenario: str
    arm: str | None
    controller: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    flange: str | None = None


@dataclass(frozen=True)
class Row:
    """What came of a case.

    Attributes:
        limits_kept: whether no joint left its position, speed or acceleration limits; None of a
            case that was not run.
        safe_stops: cycles that ended in the controller's safe stop.
        acceleration_ratio_max, jerk_ratio_max: NaN, too, on arms without such limits.
        assumed: which limits, acceleration or jerk, nobody has given; see Arm.assumed.
        errors_until_s, reversals_in_a_row and so on: see Metrics.
        sparc, ldlj: smoothness of the tip's speed, see rcmqp.smoothness.
        file: name of the run's file in the comparison's folder.
        failure: why there is no run; empty where there is one. Numbers are NaN then.
    """

    scenario: str
    arm: str
    controller: str
    errors_until_s: float = np.nan
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
    assumed: str = ""
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

_NAMES = {"scenario": "scenario", "arm": "arm", "controller": "controller"}

_TITLES = {
    **_NAMES,
    "errors_until_s": "rms until [s]",
    "tip_rms_mm": "tip rms [mm]",
    "contour_rms_mm": "contour rms [mm]",
    "lag_max_s": "lag max [s]",
    "rcm_rms_mm": "RCM rms [mm]",
    "rcm_max_mm": "RCM max [mm]",
    "limits_kept": "limits kept",
    "speed_ratio_max": "speed / limit",
    "acceleration_ratio_max": "acc. / limit",
    "jerk_ratio_max": "jerk / limit",
    "limit_margin_min_rad": "margin [rad]",
    "saturated_share": "saturated",
    "safe_stops": "stops",
    "solve_time_median_us": "step [us]",
    "failure": "failure",
}

_OVER_TIME = {
    **_NAMES,
    "orientation_rms_mrad": "orientation rms [mrad]",
    "orientation_max_mrad": "max [mrad]",
    "reversals_in_a_row": "reversals in a row",
    "reversals": "in all",
    "step_ratio_max": "step of v / limit",
    "reference_end_s": "reference stops [s]",
    "overshoot_max_mm": "overshoot [mm]",
    "settling_time_s": "below 1 mm after [s]",
    "swing_ratio_end": "swing at the end / limit",
    "sparc": "SPARC",
    "ldlj": "LDLJ",
}


def cases(
    scenarios: Sequence[str],
    arms: Sequence[str | None],
    controllers: Sequence[str],
    changes: Mapping[str, Any] | None = None,
    options: Mapping[str, Mapping[str, Any]] | None = None,
    flange: str | None = None,
) -> list[Case]:
    """Every combination, scenarios first; see Case.

    Args:
        scenarios: names.
        arms: names, or paths of URDFs; None for the scenario's own.
        controllers: names.
        changes: fields of every scenario.
        options: of each controller that is to have some, by its name.
        flange: for the arms that are URDFs.
    """
    named = (None, *arm_names())
    return [
        Case(
            scenario,
            arm,
            name,
            changes or {},
            (options or {}).get(name, {}),
            None if arm in named else flange,
        )
        for scenario, arm, name in itertools.product(
            scenarios, arms, [controller.replace("-", "_") for controller in controllers]
        )
    ]


def compare(
    todo: Sequence[Case],
    out: str | os.PathLike[str],
    *,
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[Row]:
    """Run every case and write the runs, comparison.csv and comparison.md into a folder.

    The rows come in the order of the cases, and but for times they are the same whatever the
    number of jobs, the names of the files too: where a name would come twice, the second is
    numbered. A case that cannot be run is a row that says why, unless none can.

    Args:
        todo: what to run.
        out: folder, made if it is not there.
        jobs: how many processes; joblib's n_jobs, so -1 is one for each core, and a backend
            chosen with joblib.parallel_config() is used.
        progress: called with 1 after each case.

    Raises:
        RunFileError: the folder or a file in it cannot be written.
        OptionError: no case could be run; tables that are there stay as they were.
    """
    folder = make_folder(out).resolve()  # workers may be elsewhere
    check_writable(folder / "comparison.csv")
    stems, files = _names(todo)
    rows = []
    parallel = Parallel(n_jobs=jobs, return_as="generator", batch_size=1)
    work = (delayed(run_case)(case, folder / file) for case, file in zip(todo, files, strict=True))
    for row in parallel(work):
        rows.append(row)
        if progress is not None:
            progress(1)
    if rows and all(row.failure for row in rows):
        more = f" (nor could the {len(rows) - 1} others)" if len(rows) > 1 else ""
        first = f"{todo[0].scenario} with {todo[0].controller}"
        raise OptionError(f"{first} could not be run{more}: {rows[0].failure}")
    for name, text in (
        ("comparison.csv", as_csv(rows)),
        ("comparison.md", f"# Comparison\n\n{as_markdown(rows)}"),
    ):
        with whole(folder / name) as part:
            part.write_text(text, encoding="utf-8")
    figures: dict[str, list[str]] = {}
    for stem, row in zip(stems, rows, strict=True):
        if row.file:
            figures.setdefault(stem, []).append(row.file)
    for problem in parallel(delayed(_draw)(folder, *figure) for figure in figures.items()):
        if problem is not None:
            raise RunFileError(Path(problem[0]), problem[1])
    return rows


def run_case(case: Case, file: Path) -> Row:
    """Run one case and save the run."""
    try:
        scenario = load_scenario(case.scenario, case.arm, flange=case.flange, **case.changes)
        insertion = scenario.insertion()
        controller = make_controller(case.controller, insertion, scenario.period, **case.options)
        run = simulate(scenario, controller)
        run.save(file)
        return dataclasses.replace(row_of(run), file=file.name)
    except Exception as error:  # noqa: BLE001  (the other cases go on, and the row has it)
        failure = f"{type(error).__name__}: {error}"
        return Row(case.scenario, case.arm or "", case.controller, failure=failure)


def row_of(run: Run) -> Row:
    """Sum up a run."""
    found = dataclasses.asdict(compute_metrics(run))
    names = {item.name for item in dataclasses.fields(Row)}
    speed = np.linalg.norm(np.diff(run.tip, axis=0), axis=1) / run.period
    return Row(
        run.scenario.name,
        run.scenario.arm,
        run.controller,
        **{name: value for name, value in found.items() if name in names},
        limits_kept=found["speed_ratio_max"] <= 1.0 + ROUNDING
        and not found["acceleration_ratio_max"] > 1.0 + ROUNDING
        and found["limit_margin_min_rad"] >= -ROUNDING,
        assumed=" ".join(run.assumed),
        safe_stops=float(np.nansum(run.diagnostics.get("safe_stop", np.zeros(1)))),
        sparc=sparc(speed, run.period),
        ldlj=log_dimensionless_jerk(speed, run.period),
        digest=run.digest,
    )


def _names(todo: Iterable[Case]) -> tuple[list[str], list[str]]:
    """For each case the name of its figure, and that of its run's file; no file's comes twice.

    Cases that differ in nothing but the controller and its options share a figure.
    """
    figures: dict[str, str] = {}
    stems, files = list[str](), list[str]()
    for case in todo:
        key = repr((case.scenario, case.arm, case.flange, sorted(case.changes.items())))
        if key not in figures:
            figures[key] = unlike(figures.values(), _stem(case))
        stems.append(figures[key])
        name = f"{stems[-1]}_{case.controller.replace('-', '_')}"
        files.append(unlike(files, name, ".h5"))
    return stems, files


def _stem(case: Case) -> str:
    """Scenario and arm of a case."""
    try:
        arm = case.arm or own_arm(case.scenario)
    except Exception:  # noqa: BLE001  (nor can it be run, which is said then)
        arm = "none"
    return f"{Path(case.scenario).stem.replace('-', '_')}_{Path(arm).stem}"


def _draw(folder: Path, stem: str, files: Sequence[str]) -> tuple[str, str] | None:
    """The errors of all controllers over the same time axis; or (file, reason) why not."""
    from rcmqp import plots  # matplotlib takes long to import

    try:
        runs = [Run.load(folder / file) for file in files]
        plots.save_figure(plots.error_figure(runs, logarithmic=True), folder / stem)
    except RunFileError as error:
        return str(error.path), error.reason
    return None


def as_csv(rows: Iterable[Row]) -> str:
    """All columns, full precision."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [item.name for item in dataclasses.fields(Row)])
    writer.writeheader()
    writer.writerows(dataclasses.asdict(row) for row in rows)
    return text.getvalue()


def as_markdown(rows: Iterable[Row]) -> str:
    """The columns that a reader compares: errors and limits; then what happens over time."""
    rows = list(rows)
    lines = [_line(_TITLES.values()), _rule(_TITLES)]
    for row in rows:
        cells = {name: _cell(getattr(row, name)) for name in _TITLES}
        if not row.failure:
            for name in ("acceleration", "jerk"):
                ratio, assumed = f"{name}_ratio_max", name in row.assumed.split()
                cells[ratio] = against_limit(getattr(row, ratio), ".4g", assumed=assumed)
        lines.append(_line(cells.values()))
    made = [row for row in rows if not row.failure]
    if made:
        lines += ["", _line(_OVER_TIME.values()), _rule(_OVER_TIME)]
    for row in made:
        cells = {name: _cell(getattr(row, name)) for name in _OVER_TIME}
        for name in AFTER_THE_STOP:
            cells[name] = after_the_stop(getattr(row, name), ".4g")
        lines.append(_line(cells.values()))
    return "\n".join(lines) + "\n"


def _rule(titles: Iterable[str]) -> str:
    """Below the heads: names and remarks to the left, numbers to the right."""
    return _line("---" if name in (*_NAMES, "failure") else "---:" for name in titles)


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.4g}"
    return literal(str(value))
