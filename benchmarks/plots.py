"""Medians and 99th percentiles on one axis."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from results import Report, Result
from tables import TASKS

COLOURS = {"rcmqp": "#1f5fa8"}
OTHERS = "#909090"


def draw(report: Report, path: Path) -> None:
    """One panel a task, the fastest on top: a dot at the median, a line to p99."""
    found = {
        task: sorted(
            (result for result in report.results if result.task == task and not result.failure),
            key=lambda result: -result.median_us,
        )
        for task in TASKS
    }
    sizes = [max(len(results), 1) for results in found.values()]
    figure = Figure(figsize=(8.0, 1.2 + 0.22 * sum(sizes)), layout="constrained")
    panels = figure.subplots(len(TASKS), 1, sharex=True, height_ratios=sizes, squeeze=False)
    for axes, (task, results) in zip(panels[:, 0], found.items(), strict=True):
        _panel(axes, TASKS[task], results)
    panels[-1, 0].set_xlabel("one cycle from Python: median, p99 [us]")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)


def _panel(axes: Axes, title: str, results: list[Result]) -> None:
    rows = range(len(results))
    colours = [COLOURS.get(result.package, OTHERS) for result in results]
    medians = [result.median_us for result in results]
    axes.hlines(rows, medians, [result.p99_us for result in results], colors=colours, lw=2.0)
    axes.scatter(medians, rows, c=colours, s=25.0)
    axes.set_yticks(
        rows, [f"{result.package}: {result.case}" for result in results], fontsize="x-small"
    )
    axes.set_xscale("log")
    axes.set_ylim(-0.7, len(results) - 0.3)
    axes.set_title(title, fontsize="medium")
    axes.grid(axis="x", lw=0.3)
