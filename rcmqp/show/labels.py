"""Labels and colours of runs, and remarks on why they differ."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.run import Run
from rcmqp.runs.setup import TOLD, given_cells, given_names, given_words, remark_of
from rcmqp.world.arm import Arm

if TYPE_CHECKING:
    from rcmqp.show.tables import Row

COLOURS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#9048F0",
    "#8B5A2B",
)
"""Six of Okabe and Ito's, and a violet and a brown that are no nearer to them for the
colour-blind; one a run, as many as there are controllers."""

DASHES = ("solid", "dashed", "dashdot", "dotted")
"""Of lines over time."""


def colour(run: int) -> str:
    """Colour of the i-th run."""
    return COLOURS[run % len(COLOURS)]


def dash(run: int) -> str:
    """Dash style of the i-th run; it changes each time the colours repeat."""
    return DASHES[(run + run // len(COLOURS)) % len(DASHES)]


SPHERES = ((0.84, 0.37, 0.0), (0.94, 0.89, 0.26), (0.0, 0.62, 0.45), (0.0, 0.45, 0.70))
"""Of the camera task's objectives, in their order, red, green, blue from 0 to 1: four of Okabe
and Ito's."""


def run_marks(runs: Sequence[Run]) -> tuple[list[str], list[list[str]]]:
    """The settings that all runs share, and the marks of each run.

    Returns:
        Words that hold for all runs; and for each run its controller, what it was given that
        others were not, its seed if they differ, and options that differ between runs of one
        controller.
    """
    cells = [given_cells(run.head) for run in runs]
    words, names = list(map(given_words, cells)), given_names(cells)
    shared = [name for name in names if len({each[name] for each in cells}) == 1]
    marks = []
    for run, mine in zip(runs, words, strict=True):
        alike = [other for other in runs if other.controller == run.controller]
        apart = [name for name in mine if name not in shared]
        marks.append([run.controller, *(mine[name] for name in apart)])
        if any(other.scenario.seed != run.scenario.seed for other in runs):
            marks[-1].append(f"seed = {run.scenario.seed}")
        marks[-1] += [
            f"{name} = {value}"
            for name, value in run.options.items()
            if name not in TOLD and any(other.options.get(name) != value for other in alike)
        ]
    return [words[0][name] for name in shared], marks


def run_labels(runs: Sequence[Run]) -> list[str]:
    """A label for each run, all different; see run_marks()."""
    labels = [", ".join(marks) for marks in run_marks(runs)[1]]
    return [
        f"{label}, run {i + 1}" if labels.count(label) > 1 else label
        for i, label in enumerate(labels)
    ]


def versions_text(runs: Sequence[Run]) -> str:
    """Durations, periods, seeds and versions of runs, as one text."""
    versions = {f"{name} {version}" for run in runs for name, version in run.versions.items()}
    lengths = _all(f"{run.time[-1]:.4g} s" for run in runs)
    periods = _all(f"{1e3 * run.period:g} ms" for run in runs)
    seeds = _all(str(run.scenario.seed) for run in runs)
    return (
        f"{lengths}, sampled every {periods}; {'seeds' if ' and ' in seeds else 'seed'} {seeds}; "
        f"{', '.join(sorted(versions))}"
    )


def _all(texts: Iterable[str]) -> str:
    """Each text once, in order: a, b and c."""
    *first, last = dict.fromkeys(texts)
    return f"{', '.join(first)} and {last}" if first else last


FEED_FORWARD = (
    "feed-forward: without it a law does not know how fast reference and trocar move, and stays "
    "behind by about their speed / K. With it, and no limit in the way, what is left is about "
    "their acceleration * T / (2 K)."
)
ROLL = (
    "roll held: a law that does not hold it lets the instrument turn about its shaft, and its "
    "orientation error is mostly that turn."
)
LIMITS = (
    "joint limits: a law keeps those that are named as enforced. It does not count the others, "
    "and may break them."
)


def remarks(rows: Sequence[Row]) -> list[str]:
    """Sentences that explain why the rows of controllers differ."""
    done = [row for row in rows if not row.failure]
    texts = []
    if {"yes", "no"} <= {row.feed_forward for row in done}:
        texts.append(FEED_FORWARD)
    if {"yes", "no"} <= {row.roll for row in done}:
        texts.append(ROLL)
    uncounted = any(not row.limits_kept and row.limits_enforced != "all" for row in done)
    if uncounted or len({row.limits_enforced for row in done}) > 1:
        texts.append(LIMITS)
    laws = dict.fromkeys(row.controller.partition(",")[0] for row in done)
    return texts + [f"{law}: {remark}" for law in laws if (remark := remark_of(law))]


def spans(arm: Arm, values: Array) -> str:
    """Least to largest of a limit: of revolute joints in degrees, of prismatic ones in metres."""
    slides = np.array([unit == "m" for unit in arm.joint_units])
    turning, sliding = np.degrees(values[~slides]), values[slides]
    texts = [_span(turning, ".0f")] if turning.size else []
    texts += [f"{_span(sliding, '.3g')} m"] if sliding.size else []
    return "; ".join(texts)


def _span(values: Array, style: str) -> str:
    low, high = (format(x, style).replace("inf", "endless") for x in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"
