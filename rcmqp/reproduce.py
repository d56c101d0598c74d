"""The paper's experiment A, run again: both arms, figures, and a table beside the paper's."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcmqp.controllers import make_controller
from rcmqp.loading import arm_title
from rcmqp.metrics import Metrics, compute_metrics
from rcmqp.run import Run, check_writable, make_folder
from rcmqp.scenario import load_scenario
from rcmqp.simulate import simulate

ARMS = ("lwa3", "meka_a2")
PERIODS = (8e-3, 1e-3)
FIGURES = ("fig2_trajectories", "fig3_errors")
PAPER_RCM_MAX_MM = 0.05

_ROWS: tuple[tuple[str, str, str, str], ...] = (
    ("RCM error, max [mm]", "rcm_max_mm", f"< {PAPER_RCM_MAX_MM}", ".4f"),
    ("RCM error, rms [mm]", "rcm_rms_mm", "not given", ".4f"),
    ("tip error, rms [mm]", "tip_rms_mm", '"negligible"', ".3f"),
    ("tip error, max [mm]", "tip_max_mm", '"negligible"', ".3f"),
    ("effector error, rms [mm]", "effector_rms_mm", "not given", ".3f"),
    ("orientation error, rms [mrad]", "orientation_rms_mrad", "not given", ".3f"),
    ("tip speed asked for, rms [mm/s]", "tip_speed_rms_mm_s", "not given", ".1f"),
    ("joint speed over its limit, max", "speed_ratio_max", "not given", ".2f"),
    ("margin to joint limits, least [rad]", "limit_margin_min_rad", "not given", ".2f"),
    ("singular value, least", "singular_value_min", "not given", ".3f"),
)


@dataclass(frozen=True)
class ExperimentA:
    """What reproduce_a() found, and the files it left.

    Attributes:
        runs: one for each sampling period and arm.
        metrics: of each run.
        table: Markdown, the paper's figures in the first column.
        files: all that were written.
    """

    runs: list[Run]
    metrics: list[Metrics]
    table: str
    files: list[Path]


def reproduce_a(
    out: str | os.PathLike[str],
    *,
    arms: Sequence[str] = ARMS,
    duration: float | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> ExperimentA:
    """Run experiment A with the paper's controller and write runs, figures and a table.

    The helix runs at T = 8 ms, the period that the paper's Table I implies, and at 1 ms, with
    the paper's K = 60 1/s, K_c = 7 and c_d = 1, and no extension.

    Args:
        out: folder, made if it is not there.
        arms: names that load_arm() knows; the paper's two.
        duration: how long to simulate [s]; the whole helix without it.
        progress: called with the run's title, cycles done since the last call, cycles in all.

    Raises:
        RunFileError: the folder or a file in it cannot be written.
    """
    folder = make_folder(out)
    files = _files(folder, arms)
    for file in files:
        check_writable(file)
    runs = []
    changes: dict[str, Any] = {} if duration is None else {"duration": duration}
    for period in PERIODS:
        for arm in arms:
            scenario = load_scenario("conical_helix", arm, period=period, **changes)
            controller = make_controller("dual_quaternion", scenario.insertion(), period)
            title = f"{arm_title(arm)}, T = {1e3 * period:g} ms"

            def report(done: int, title: str = title, total: int = scenario.cycles) -> None:
                if progress is not None:
                    progress(title, done, total)

            run = simulate(scenario, controller, report)
            run.save(folder / _run_name(arm, period))
            runs.append(run)
    metrics = [compute_metrics(run) for run in runs]
    table = comparison_table(runs, metrics)
    _write_figures(runs[: len(arms)], folder)
    length = "" if duration is None else f"Only the first {duration:g} s of the helix.\n\n"
    (folder / "experiment_a.md").write_text(f"# Experiment A\n\n{length}{table}", encoding="utf-8")
    return ExperimentA(runs, metrics, length + table, files)


def comparison_table(runs: Sequence[Run], metrics: Sequence[Metrics]) -> str:
    """Markdown table: what is measured, what the paper gives, and each run."""
    heads = [f"{arm_title(run.scenario.arm)}, {1e3 * run.period:g} ms" for run in runs]
    lines = [
        f"| {' | '.join(['', 'the paper', *heads])} |",
        f"| {' | '.join(['---', *['---:'] * (len(runs) + 1)])} |",
    ]
    for label, name, paper, style in _ROWS:
        cells = [format(getattr(found, name), style) for found in metrics]
        lines.append(f"| {' | '.join([label, paper, *cells])} |")
        if name == "tip_max_mm":
            lag = [
                f"{found.tip_speed_rms_mm_s / run.options['gain']:.3f}"
                for run, found in zip(runs, metrics, strict=True)
            ]
            lines.append(f"| {' | '.join(['speed / K, rms [mm]', 'not given', *lag])} |")
    return "\n".join(lines) + "\n"


def _run_name(arm: str, period: float) -> str:
    return f"{arm}_{1e3 * period:g}ms.h5"


def _files(folder: Path, arms: Sequence[str]) -> list[Path]:
    """All that reproduce_a() writes."""
    names = [_run_name(arm, period) for period in PERIODS for arm in arms]
    names += [f"{figure}.{end}" for figure in FIGURES for end in ("png", "pdf")]
    return [folder / name for name in [*names, "experiment_a.md"]]


def _write_figures(runs: Sequence[Run], folder: Path) -> None:
    from rcmqp import plots  # matplotlib takes long to import

    for name, draw in zip(FIGURES, (plots.trajectory_figure, plots.error_figure), strict=True):
        plots.save_figure(draw(runs), folder / name)
