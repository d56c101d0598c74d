"""The study as tables, like the paper's Table I and more, and what it leaves in its folder."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path

from rcmqp.experiments.study.comparisons import (
    comparison_table,
    conditions,
    given_of,
    side_by_side,
    title,
)
from rcmqp.experiments.study.outcome import Outcome
from rcmqp.experiments.study.perform import Performed
from rcmqp.experiments.study.plan import Study
from rcmqp.experiments.study.replay import replay_table
from rcmqp.experiments.study.statistics import FEWEST, Summary, summary
from rcmqp.experiments.study.trial_file import TrialFile
from rcmqp.experiments.study.vocabulary import TRIALS
from rcmqp.files import write_text
from rcmqp.references.operators import GROUPS, PARAMETERS, camera_trial
from rcmqp.runs.measures import Measure
from rcmqp.runs.metrics import BEHIND, ROUNDING, Metrics
from rcmqp.runs.setup import given_words
from rcmqp.show.table import Table, definitions, literal

MEANS = {
    "completion_s": "68.03 ± 30.58; 84 and 52",
    "looking_s": "not given",
    "effector_rms_mm": "0.3398 ± 0.0163 (†)",
    "tip_rms_mm": "0.3398 ± 0.0163 (†)",
    "rcm_rms_mm": "0.00710 ± 0.00706",
    "rcm_rms_moving_mm": "not given",
    "obstacle_tip_mm": "12.52 ± 5.03 (‡)",
    "obstacle_shaft_mm": "12.52 ± 5.03 (‡)",
    "tip_speed_rms_mm_s": "not given",
    "slow_share": "not given",
    "late_share": "not given",
    "behind_s": "not given",
}
"""Measures with mean and standard deviation, and the paper's figures."""

RANGES = {
    "obstacle_tip_mm": (-math.inf, math.inf),
    "obstacle_shaft_mm": (-math.inf, math.inf),
    "slow_share": (0.0, 1.0),
    "late_share": (0.0, 1.0),
}
"""The least and largest possible value of a measure of MEANS; 0 and no end if not listed."""

EXTREMES = {"effector_max_mm": "4.82 (†)", "tip_max_mm": "4.82 (†)", "rcm_max_mm": "0.37"}
"""Largest errors of all trials [mm], and the paper's."""

JUMP = "no person but a device jump: effector; RCM error, largest [mm]"
"""Label of the row of the scenario device_jump."""

COUNTED: tuple[tuple[str, str, Callable[[Outcome], bool]], ...] = (
    ("finished", "all", lambda o: o.finished),
    ("collisions: the shaft touched the obstacle", "0", lambda o: o.collided),
    ("above a joint's speed limit", "not given", lambda o: o.speed_ratio_max > 1.0 + ROUNDING),
    ("beyond a joint's position limit", "not given", lambda o: o.limit_margin_min_rad < -ROUNDING),
)
"""Of how many trials something is true."""

NOTES = """\
(†) The paper's end effector is the point of the shaft at the trocar; whether its error is that
point's or the camera's is not said, so both are given. (‡) From where to where the paper
measures the distance is not said. Both are to the obstacle's surface: from the camera as a
point, and from the shaft's surface.

± is the standard deviation between operators, [ ] where the mean of the model lies: the 95 %
interval (Student's t) of a mean over the people drawn, given for five or more. It ends where the
measure can be no less or no more: no time is below 0 s. It says how exactly these draws give the
model's mean, and nothing about real people. Times are of those who finished, changes of those who
have both numbers. The operators are a model. Its errors are not the paper's: compare the columns.
The times spent looking, and with them the completion times, rest on parameters fitted
to the paper's own mean and deviation before this study, and how the operators keep off the
obstacle was set after trials in which one in twenty touched it: times and collisions are no
result. Unless a practice was given, the model does not learn: what differs from objective to
objective is the way. What the
paper leaves open, the scene, the period, the arm and the device's viscosity, is chosen: see
scenarios/camera_task.py and `rcmqp.references.operators.population`; an objective counts as
reached as soon as the camera is within 1 mm of it, however fast. Controllers are compared at the
periods named, and differ in more than their law: in period, feed-forward and limits, which
`rcmqp reproduce -e b --factors` takes apart. The law's RCM error grows with the period and the
square of the speed. A movement of the model's peaks at 60 or 80 mm/s, to which arm and tremor
add some; the paper's largest error, 4.82 mm, asks for 290 mm/s, or for a jump (scenario
device_jump). The same people look for the same times with every controller. hierarchical_qp knows
the obstacle and keeps the shaft out of it as far as the joints' limits allow; the paper's law
does not know it.
"""

FIGURES = ("fig4_views", "fig6_errors", "fig7_trajectory", "groups")


def table(performed: Performed, jump: Metrics | None = None) -> str:
    """Tables in Markdown: each arm and controller beside the paper, and their comparisons.

    Args:
        performed: the study.
        jump: of the scenario device_jump, for a row of its own beside the people's maxima.
    """
    parts = []
    for arm, law in conditions(performed.outcomes):
        mine = [o for o in performed.outcomes if (o.arm, o.controller) == (arm, law)]
        given = ", ".join(given_words(given_of(mine)).values())
        parts.append(
            f"## {title(arm)}, {law}\n\nThe controller: {given}.\n\n{table_one(mine, jump)}"
        )
    if beside := side_by_side(performed.outcomes):
        parts.insert(0, f"## Side by side\n\n{beside}")
    if comparison := comparison_table(performed.outcomes):
        parts.append(f"## Paired comparisons\n\n{comparison}")
    parts.append(f"{NOTES}\n## What the rows mean\n\n{rows_explained(performed.outcomes)}")
    return "\n".join(parts)


def rows_explained(outcomes: Sequence[Outcome]) -> str:
    """Markdown list: what the rows of table_one() mean that have a number."""
    names = [
        name
        for name in (*MEANS, *EXTREMES)
        if not all(math.isnan(getattr(o, name)) for o in outcomes)
    ]
    return definitions({TRIALS[name].row: TRIALS[name].meaning for name in names})


def table_one(outcomes: Sequence[Outcome], jump: Metrics | None = None) -> str:
    """Markdown: the paper's Table I of one arm and controller, by group."""
    groups = {"all": list(outcomes)}
    for group in GROUPS:
        groups[group] = [o for o in outcomes if o.group == group]
    heads = ["", "the paper", *(f"{name}, {len(of)}" for name, of in groups.items())]
    rows = []
    for name, paper in MEANS.items():
        cells = [
            _cell(summary([getattr(o, name) for o in of]), TRIALS[name], len(of))
            for of in groups.values()
        ]
        if any(cells):
            rows.append([TRIALS[name].row, paper, *cells])
    for name, paper in EXTREMES.items():
        found = [summary([getattr(o, name) for o in of]).largest for of in groups.values()]
        cells = [TRIALS[name].text(x, TRIALS[name].fixed) for x in found]
        rows.append([TRIALS[name].row_of("largest"), paper, *cells])
    if jump is not None:
        largest = f"{jump.effector_max_mm:.2f}; {jump.rcm_max_mm:.3g}"
        rows.append([JUMP, "4.82 (†); 0.37", largest])
    for label, paper, has in COUNTED:
        counts = [f"{sum(map(has, of))} of {len(of)}" for of in groups.values()]
        rows.append([label, paper, *counts])
    text = Table(heads, rows).markdown()
    if failed := [o for o in outcomes if o.failure]:
        text += (
            f"\n{len(failed)} trials failed; the first, operator {failed[0].operator}: "
            f"{literal(failed[0].failure)}\n"
        )
    return text + late_note(outcomes)


def late_note(outcomes: Sequence[Outcome]) -> str:
    """Which trials a busy machine slowed down by more than BEHIND of the time; empty for none."""
    late = [o for o in outcomes if o.behind_share > BEHIND]
    if not late:
        return ""
    each = ", ".join(f"{o.operator} by {100 * o.behind_share:.0f} %" for o in late)
    return (
        f"\n**Behind the clock** by more than {100 * BEHIND:g} % of the time: {each}. The machine "
        f"was too busy for a period of {1e3 * late[0].period:g} ms. The arm was slower than its "
        "controller asked: times, speeds and answers of these trials are partly the machine's.\n"
    )


def outcomes_csv(outcomes: Sequence[Outcome]) -> str:
    """Every trial, full precision; a column for each objective's time."""
    count = max((len(o.reached_s) for o in outcomes), default=0)
    names = [item.name for item in dataclasses.fields(Outcome) if item.name != "reached_s"]
    heads = [*names, *(f"reached_{i + 1}_s" for i in range(count))]
    rows = [[*(getattr(o, name) for name in names), *o.reached_s] for o in outcomes]
    return Table(heads, rows).csv()


def operators_csv(study: Study) -> str:
    """Who took part: a row an operator, after rows of units, ranges and sources."""
    rows: list[list[object]] = [
        [what, "", *(getattr(parameter, what) for parameter in PARAMETERS.values())]
        for what in ("unit", "low", "high", "source")
    ]
    law, arm = study.laws[0], study.arms[0]
    for trial in study.trials():
        if trial.law == law and trial.arm == arm:
            path = camera_trial(trial.made().path, study.scenario)
            person = dataclasses.asdict(path.operator)
            rows.append([trial.operator, person["group"], *(person[name] for name in PARAMETERS)])
    return Table(["operator", "group", *PARAMETERS], rows).csv()


def _cell(found: Summary, measure: Measure, people: int) -> str:
    """Mean, deviation and interval; of how many, if not of all the people."""
    if found.count == 0:
        return ""
    some = f" ({found.count} of {people})" if found.count < people else ""
    least, most = RANGES.get(measure.name, (0.0, math.inf))
    mean, deviation, low, high = (
        measure.text(x, measure.fixed)
        for x in (found.mean, found.deviation, max(found.low, least), min(found.high, most))
    )
    if found.count == 1:
        return f"{mean}{some}"
    interval = f" [{low}, {high}]" if found.count >= FEWEST else ""
    return f"{mean} ± {deviation}{interval}{some}"


def write_tables(
    performed: Performed, jump: Metrics | None = None, recorded: Sequence[TrialFile] = ()
) -> tuple[str, list[Path]]:
    """table.md, trials.csv, operators.csv, recorded.csv; the table's text and the files.

    Args:
        performed: the study.
        jump: see table().
        recorded: replays of recorded hands; there is a recorded.csv of them only if there are any.

    Raises:
        RunFileError: a file cannot be written.
    """
    study, text = performed.study, table(performed, jump)
    replayed = [each.outcome for each in recorded]
    if replayed:
        text += f"\n## Recorded hands\n\n{replay_table(replayed)}"
    head = (
        f"# Study: {study.scenario}, {study.operators} simulated operators, seed {study.seed}\n\n"
    )
    files = {
        "table.md": head + text,
        "trials.csv": outcomes_csv(performed.outcomes),
        "operators.csv": operators_csv(study),
    }
    if replayed:
        files["recorded.csv"] = outcomes_csv(replayed)
    for name, content in files.items():
        write_text(performed.folder / name, content)
    return text, [performed.folder / name for name in files]


def write_figures(performed: Performed) -> list[Path]:
    """Figs. 4, 6 and 7 and the groups, of the first arm and controller.

    The errors and the trajectory are those of the trial whose completion time is the median.

    Raises:
        RunFileError: a file cannot be written.
    """
    from rcmqp.experiments.study import figures
    from rcmqp.show import plots  # matplotlib takes long to import

    outcomes, trials = performed.outcomes, performed.study.trials()
    first = outcomes[0].arm, outcomes[0].controller
    mine = [i for i, o in enumerate(outcomes) if (o.arm, o.controller) == first and not o.failure]
    if not mine:
        return []
    mine.sort(key=lambda i: (not outcomes[i].finished, outcomes[i].completion_s))
    finished = [i for i in mine if outcomes[i].finished] or mine
    middle = finished[(len(finished) - 1) // 2]
    scenario, record = trials[middle].made(), performed.record(middle)
    drawn = (
        figures.views_figure(scenario),
        figures.trial_figure(record),
        figures.trajectory_figure(scenario, record),
        figures.groups_figure([outcomes[i] for i in sorted(mine)]),
    )
    return [
        path
        for name, figure in zip(FIGURES, drawn, strict=True)
        for path in plots.save_figure(figure, performed.folder / name)
    ]
