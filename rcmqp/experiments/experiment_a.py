"""The paper's experiment A, run again: both arms, figures, and a table beside the paper's.

It ends with the paper's law beside hierarchical_qp, each with what it is given, and a report of
all runs.
"""

from __future__ import annotations

import math
import os
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcmqp.controllers import Controller, make_controller
from rcmqp.controllers.settings import controller_of
from rcmqp.errors import ToolMissing
from rcmqp.files import check_writable, make_folder
from rcmqp.runs.head import check_own
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.measures import until
from rcmqp.runs.metrics import Metrics, compute_metrics
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.setup import given_cells, given_names
from rcmqp.runs.simulate import simulate
from rcmqp.runs.vocabulary import MEASURES
from rcmqp.show import plots, tables
from rcmqp.show.report import (
    INDEX,
    LATEX,
    NUMBERS,
    TEXT,
    Picture,
    Screenshot,
    Section,
    write_report,
)
from rcmqp.show.table import Table
from rcmqp.show.viewer.browser import chromium_path
from rcmqp.world.instrument import Instrument
from rcmqp.world.instrument_file import load_instrument
from rcmqp.world.loading import arm_title
from rcmqp.world.port import Port

ARMS = ("lwa3", "meka_a2")
PERIODS = (8e-3, 1e-3)
HELIX, FAST = "conical_helix", "fast_helix"
LAW, RIVAL = "dual_quaternion", "hierarchical_qp"
BESIDE = (
    (HELIX, f"{LAW}:feed_forward=true"),
    (HELIX, RIVAL),
    (FAST, f"{LAW}:velocity_limit=scale"),
    (FAST, f"{LAW}:feed_forward=true,velocity_limit=scale"),
    (FAST, RIVAL),
)
"""Scenarios and controllers that the law is compared with, at the last of PERIODS: with
feed-forward; and where the arm is too slow, with speed limits."""

FIGURES = ("fig2_trajectories", "fig3_errors", "errors_beside_hierarchical_qp", "errors_too_fast")
PAPER_RCM_MAX_MM = 0.05

_PAPER_GIVEN = {"feed_forward": "no", "roll": "yes", "limits_enforced": "none", "gain": "60"}

_ROWS = {
    "rcm_max_mm": f"< {PAPER_RCM_MAX_MM}",
    "rcm_rms_mm": "not given",
    "tip_rms_mm": '"negligible"',
    "tip_max_mm": '"negligible"',
    "effector_rms_mm": "not given",
    "orientation_rms_mrad": "not given",
    "orientation_max_mrad": "not given",
    "tip_speed_rms_mm_s": "not given",
    "speed_ratio_max": "not given",
    "acceleration_ratio_max": "not given",
    "jerk_ratio_max": "not given",
    "limit_margin_min_rad": "not given",
    "singular_value_min": "not given",
}
"""Measures beside the paper, and what the paper has."""


ABOUT = (
    "Experiment A of the paper: the tip of an endoscope on a Schunk LWA3 and on a Meka A2 draws a "
    "conical helix inside the patient, while the shaft stays on the trocar. The first table sets "
    "the errors beside those that the paper prints.\n\n"
)
"""Of the report's reader, who may not know the paper; Markdown."""


@dataclass(frozen=True)
class ExperimentA:
    """What reproduce_a() found, and the files it left.

    Attributes:
        runs: of the paper's law, one for each sampling period and arm.
        metrics: of each of them.
        table: Markdown, the paper's figures in the first column.
        rivals: runs of BESIDE, one for each and each arm.
        beside: rows of the law at the last of PERIODS and of the rivals.
        files: all that were written.
    """

    runs: list[Run]
    metrics: list[Metrics]
    table: str
    rivals: list[Run]
    beside: list[tables.Row]
    files: list[Path]


def reproduce_a(
    out: str | os.PathLike[str],
    *,
    arms: Sequence[str] = ARMS,
    duration: float | None = None,
    port: Port | None = None,
    instrument: str | os.PathLike[str] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> ExperimentA:
    """Run experiment A with the paper's controller and write runs, a table and a report.

    The helix runs at T = 8 ms, the period that the paper's Table I implies, and at 1 ms, with
    the paper's K = 60 1/s, K_c = 7 and c_d = 1, and no extension. It ends with the law beside
    hierarchical_qp, with the same numbers, at 1 ms, see BESIDE: on the same helix, where
    feed-forward decides, and on one that is too fast, where limits do. The report holds tables,
    figures, viewers, and how to make it again.

    Args:
        out: folder, made if it is not there.
        arms: names that load_arm() knows; the paper's two.
        duration: how long to simulate [s]; the whole helix without it.
        port: where the incision is; None for each scenario's own.
        instrument: name or file of one, see load_instrument(); None for each scenario's own.
        progress: called with the run's title, cycles done since the last call, cycles in all.

    Raises:
        RunFileError: the folder or a file in it cannot be written, or a file holds another run.
    """
    tool = None if instrument is None else load_instrument(instrument)
    folder = make_folder(out)
    law = [(HELIX, LAW, arm, period) for period in PERIODS for arm in arms]
    rival = [(scenario, setting, arm, PERIODS[-1]) for scenario, setting in BESIDE for arm in arms]
    files = [folder / _run_name(*case) for case in law + rival]
    files += [folder / f"{figure}.{end}" for figure in FIGURES for end in ("png", "pdf")]
    files += [folder / f"{_shot_name(arm)}.png" for arm in arms]
    files += [folder / name for name in ("experiment_a.md", TEXT, NUMBERS, LATEX, INDEX)]
    for file in files:
        check_writable(file)
    for case, file in zip(law + rival, files, strict=False):
        check_own(file, *_made(*case, duration, port, tool))
    found = []
    for case, file in zip(law + rival, files, strict=False):
        found.append(helix(*case, duration, progress, port, tool))
        found[-1].save(file)
    runs, rivals = found[: len(law)], found[len(law) :]
    metrics = [compute_metrics(run) for run in runs]
    text = comparison_table(runs, metrics).markdown()
    pairs = [*runs[-len(arms) :], *rivals]
    beside = [tables.row_of(run) for run in pairs]
    length = "" if duration is None else f"Only the first {duration:g} s of the helix.\n\n"
    (folder / "experiment_a.md").write_text(
        f"# Experiment A\n\n{length}{text}\n## Beside {RIVAL}\n\n"
        f"{tables.as_markdown(beside)}\n"
        f"## What the columns mean\n\n{tables.columns_explained()}",
        encoding="utf-8",
    )
    again = ["rcmqp", "reproduce", "--out", str(out)]
    again += [] if duration is None else ["--duration", f"{duration:g}"]
    again += [] if port is None else _options(port)
    again += [] if instrument is None else ["--instrument", Path(instrument).name]
    names = [file.name for file in files[: len(found)]]
    written = write_report(
        found,
        folder,
        files=names,
        title="Experiment A",
        opening=_sections(ABOUT + length + text, runs[: len(arms)], beside, pairs),
        command=shlex.join(again),
    )
    files = [folder / name for name in (*names, "experiment_a.md")] + written
    return ExperimentA(runs, metrics, length + text, rivals, beside, files)


def _options(port: Port) -> list[str]:
    """The command line's options that ask for this port."""
    words = []
    for name, vector in (("--trocar", port.pivot), ("--axis", port.axis)):
        words += [] if vector is None else [f"{name}={','.join(map(str, vector))}"]
    numbers = {
        "--depth": port.depth,
        "--cone": None if port.cone is None else math.degrees(port.cone),
        "--tolerance": None if port.tolerance is None else 1e3 * port.tolerance,
    }
    given = {name: value for name, value in numbers.items() if value is not None}
    return words + [f"{name}={value:.9g}" for name, value in given.items()]


def helix(
    scenario: str,
    setting: str,
    arm: str,
    period: float,
    duration: float | None = None,
    progress: Callable[[str, int, int], None] | None = None,
    port: Port | None = None,
    instrument: Instrument | None = None,
) -> Run:
    """A helix, or the first ``duration`` [s] of it, under a controller.

    Args:
        scenario: HELIX, experiment A's, or FAST.
        setting: the controller, see controller_of().
        arm: a name that load_arm() knows.
        period: sampling period T [s].
        duration: how long to simulate [s].
        progress: see reproduce_a().
        port: where the incision is; None for the scenario's.
        instrument: in place of the scenario's own; None for that.
    """
    made, controller = _made(scenario, setting, arm, period, duration, port, instrument)
    title = f"{scenario}, {arm_title(arm)}, {setting}, T = {1e3 * period:g} ms"

    def report(done: int) -> None:
        if progress is not None:
            progress(title, done, made.cycles)

    return simulate(made, controller, report)


def _made(
    scenario: str,
    setting: str,
    arm: str,
    period: float,
    duration: float | None,
    port: Port | None,
    instrument: Instrument | None,
) -> tuple[Scenario, Controller]:
    """What helix() simulates."""
    changes: dict[str, Any] = {} if duration is None else {"duration": duration}
    changes |= {"port": port, "instrument": instrument}
    made = load_scenario(scenario, arm, period=period, **changes)
    name, options = controller_of(setting)
    return made, make_controller(name, made.insertion(), period, **options)


def comparison_table(runs: Sequence[Run], metrics: Sequence[Metrics]) -> Table:
    """What is given and measured, what the paper has, and each run."""
    heads = [f"{arm_title(run.scenario.arm)}, {1e3 * run.period:g} ms" for run in runs]
    given = [given_cells(run.head) for run in runs]
    rows = [
        [
            MEASURES[name].row,
            _PAPER_GIVEN.get(name, "not given"),
            *(cells[name] for cells in given),
        ]
        for name in given_names(given)
    ]
    ends = [until(found.errors_until_s, found.duration_s) for found in metrics]
    rows.append([MEASURES["errors_until_s"].row, "not given", *ends])
    for name, paper in _ROWS.items():
        measure = MEASURES[name]
        cells = [measure.text(getattr(found, name), measure.fixed) for found in metrics]
        rows.append([measure.row, paper, *cells])
        if name == "tip_max_mm":
            lag = [
                f"{found.tip_speed_rms_mm_s / run.options['gain']:.3f}"
                for run, found in zip(runs, metrics, strict=True)
            ]
            rows.append(["speed / K, rms [mm]", "not given", *lag])
    return Table(["", "the paper", *heads], rows)


def _run_name(scenario: str, setting: str, arm: str, period: float) -> str:
    before = "" if scenario == HELIX else f"{scenario}_"
    suffix = "" if setting == LAW else "_" + re.sub(r"\W", "_", setting)
    return f"{before}{arm}_{1e3 * period:g}ms{suffix}.h5"


def _shot_name(arm: str) -> str:
    return f"helix_{arm}"


def _screenshots(runs: Sequence[Run]) -> tuple[list[Screenshot], str]:
    """The scene at each run's end; none, and a sentence that says why, without Chromium."""
    try:
        chromium_path()
    except ToolMissing as error:
        return [], f"\nScreenshots of the arms are left out: {error}.\n"
    return [
        Screenshot(
            _shot_name(run.scenario.arm),
            f"{arm_title(run.scenario.arm)} at the end of the helix. The paper's Fig. 2, "
            '"Simulations with a conical helix trajectory tracking", shows the tool tip\'s '
            "trajectory of both robots",
            run,
        )
        for run in runs
    ], ""


def _sections(
    text: str, runs: Sequence[Run], beside: Sequence[tables.Row], pairs: Sequence[Run]
) -> tuple[Section, Section]:
    """What the report opens with: beside the paper, and beside hierarchical_qp."""
    trajectories, errors, *figures = FIGURES
    shots, missing = _screenshots(runs)
    return (
        Section(
            "Beside the paper",
            text + missing,
            pictures=(
                *shots,
                Picture(
                    trajectories,
                    "In numbers: the arm at the start, and the tip's path from the trocar",
                    plots.trajectory_figure(runs),
                ),
                Picture(
                    errors,
                    "As the paper's Fig. 3: tip and RCM error over time",
                    plots.error_figure(runs),
                ),
            ),
        ),
        Section(
            f"Beside {RIVAL}",
            tables.as_markdown(beside),
            pictures=[
                Picture(
                    figure,
                    f"Errors over time on a logarithmic scale, {scenario}",
                    plots.error_figure(
                        [run for run in pairs if run.scenario.name == scenario], logarithmic=True
                    ),
                )
                for figure, scenario in zip(figures, (HELIX, FAST), strict=True)
            ],
        ),
    )
