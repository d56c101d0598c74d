"""Results as Markdown: a table of every case, and the ratios that were promised."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from results import Report, Result

from rcmqp.show.table import Table

TASKS = {"rcm": "RCM, tip and posture", "pose": "whole pose"}


@dataclass(frozen=True)
class Promise:
    """A ratio of medians that is not to be exceeded.

    Attributes:
        ours, other: names of results.
        most: of the ratio.
    """

    ours: str
    other: str
    most: float


LAW = "rcmqp pose/dual_quaternion"
HIERARCHY = "rcmqp rcm/RCM > tip > posture"
PROMISES = (
    Promise(LAW, "dqrobotics pose/pseudoinverse, no limits", 0.7),
    Promise(f"{LAW}, feed_forward", "dqrobotics pose/pseudoinverse, no limits", 0.7),
    Promise(HIERARCHY, "placo rcm/RCM hard, tip soft", 1.0),
    Promise(HIERARCHY, "placo rcm/RCM soft, tip soft", 1.0),
    Promise(HIERARCHY, "pink rcm/RCM hard, daqp", 1 / 8),
    Promise(HIERARCHY, "pink rcm/RCM hard, quadprog", 1 / 8),
    Promise(HIERARCHY, "pink rcm/RCM soft, daqp", 1 / 8),
    Promise(HIERARCHY, "pink rcm/RCM soft, quadprog", 1 / 8),
)
MOST_P99 = 3.0
"""Of p99 over the median."""


def table(report: Report, earlier: Report | None = None, pattern: str = "") -> str:
    """A line a case, the fastest first; with medians of an earlier report, if there is one.

    Only cases in whose name ``pattern`` is found.
    """
    before = {} if earlier is None else {result.name: result for result in earlier.results}
    heads = [
        "task",
        "package",
        "what",
        "median [us]",
        "p95",
        "p99",
        "max",
        "interrupted",
        "tip rms [mm]",
        "RCM max [mm]",
        *(["median before", "now / before"] if earlier else []),
    ]
    lines = []
    for task in TASKS:
        chosen = [
            result
            for result in report.results
            if result.task == task and re.search(pattern, result.name)
        ]
        for result in sorted(chosen, key=lambda result: (result.failure, result.median_us)):
            cells = [TASKS[task], result.package, result.case, *_numbers(result)]
            if (old := before.get(result.name)) and not result.failure:
                cells += [f"{old.median_us:.1f}", f"{result.median_us / old.median_us:.2f}"]
            lines.append(cells)
    lines += [
        ["", result.package, result.case, result.failure]
        for result in report.results
        if result.task not in TASKS
    ]
    return Table(heads, lines, words=3).markdown()


def promises(report: Report) -> str:
    """Each promised ratio that both sides are there for, and whether it is kept.

    Ratios are medians over blocks: in each, one case ran a moment after the other.
    """
    found = {result.name: result for result in report.results if not result.failure}
    lines = []
    for promise in PROMISES:
        if promise.ours in found and promise.other in found:
            ratios = ratio(found[promise.ours], found[promise.other])
            low, middle, high = np.percentile(ratios, [5, 50, 95])
            lines.append(
                [
                    f"{promise.ours} / {promise.other}",
                    f"{middle:.2f}",
                    f"{low:.2f} to {high:.2f}",
                    f"{promise.most:.3g}",
                    "yes" if middle <= promise.most else "no",
                ]
            )
    for name in (LAW, HIERARCHY):
        if name in found:
            spread = found[name].p99_us / found[name].median_us
            kept = "yes" if spread <= MOST_P99 else "no"
            lines.append([f"{name}: p99 / median", f"{spread:.2f}", "", f"{MOST_P99:g}", kept])
    heads = ["ratio", "found", "5 % to 95 % of blocks", "at most", "kept"]
    return Table(heads, lines, words=3).markdown()


def ratio(ours: Result, other: Result) -> list[float]:
    """Block by block, median over median, as far as both have run."""
    return [a / b for a, b in zip(ours.blocks_us, other.blocks_us, strict=False)]


def about(report: Report) -> str:
    """Machine, settings and versions in a few lines."""
    conditions = {**report.machine, **report.settings}
    lines = [", ".join(f"{key} {text}" for key, text in conditions.items())]
    packages = {result.package: result.versions for result in report.results if result.versions}
    for package, versions in packages.items():
        lines.append(f"{package}: " + ", ".join(" ".join(item) for item in versions.items()))
    return "\n".join(f"- {line}" for line in lines)


def _numbers(result: Result) -> list[str]:
    if result.failure:
        return [result.failure]
    return [
        f"{result.median_us:.1f}",
        f"{result.p95_us:.1f}",
        f"{result.p99_us:.1f}",
        f"{result.max_us:.0f}",
        str(result.interrupted),
        f"{result.tip_rms_mm:.4f}",
        f"{result.rcm_max_mm:.5f}",
    ]
