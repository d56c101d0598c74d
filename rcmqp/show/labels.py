"""What tells runs apart, their colours too, and what each run was given."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from rcmqp.errors import RcmqpError
from rcmqp.runs.head import Head
from rcmqp.runs.run import Run
from rcmqp.runs.vocabulary import MEASURES
from rcmqp.show.setup import DEFAULT, setup_text

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
    """Of the run in that place."""
    return COLOURS[run % len(COLOURS)]


def dash(run: int) -> str:
    """Of the run in that place; it is another where colours come again."""
    return DASHES[(run + run // len(COLOURS)) % len(DASHES)]


SPHERES = ((0.84, 0.37, 0.0), (0.94, 0.89, 0.26), (0.0, 0.62, 0.45), (0.0, 0.45, 0.70))
"""Of the camera task's objectives, in their order, red, green, blue from 0 to 1: four of Okabe
and Ito's."""


GIVEN = ("feed_forward", "roll", "limits_enforced", "period_ms", "gain", "assumed", "setup")
"""Measures of given_cells(), in the order of columns."""

TOLD = ("feed_forward", "gain", "velocity_limit", "velocity_limits", "objective")
"""Options that given_cells() already tells."""


def given_cells(head: Head) -> dict[str, str]:
    """What a run's controller was given, for a table; the names are those of GIVEN."""
    given = head.given
    return {
        "feed_forward": given.feed_forward_text,
        "roll": given.roll_text,
        "limits_enforced": given.limits_text,
        "period_ms": f"{1e3 * head.scenario.period:g}",
        "gain": given.gain_text,
        "assumed": " and ".join(head.assumed) or "none",
        "setup": setup_text(head),
    }


def given_names(cells: Iterable[Mapping[str, str]]) -> list[str]:
    """Those of GIVEN that a table of these given_cells() shows: ``setup`` if one has any."""
    set_up = any(each["setup"] not in ("", DEFAULT) for each in cells)
    return [name for name in GIVEN if name != "setup" or set_up]


def given_words(cells: Mapping[str, str]) -> dict[str, str]:
    """The same in words, for a legend or a caption, out of what given_cells() says."""
    return {
        name: f"{of.label} = {cells[name]} {of.unit}" if of.unit else f"{of.label}: {cells[name]}"
        for name, of in ((name, MEASURES[name]) for name in given_names([cells]))
    }


def run_marks(runs: Sequence[Run]) -> tuple[list[str], list[list[str]]]:
    """What all runs were given, and what each run is.

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
    """What tells the runs apart, see run_marks(); no label comes twice."""
    labels = [", ".join(marks) for marks in run_marks(runs)[1]]
    return [
        f"{label}, run {i + 1}" if labels.count(label) > 1 else label
        for i, label in enumerate(labels)
    ]


def versions_text(runs: Sequence[Run]) -> str:
    """What the runs were made with, and how long they are."""
    versions = {f"{name} {version}" for run in runs for name, version in run.versions.items()}
    lengths = _all(f"{run.time[-1]:.4g} s" for run in runs)
    periods = _all(f"{1e3 * run.period:g} ms" for run in runs)
    seeds = _all(str(run.scenario.seed) for run in runs)
    return (
        f"{lengths}, sampled every {periods}; {'seeds' if ' and ' in seeds else 'seed'} {seeds}; "
        f"{', '.join(sorted(versions))}"
    )


def _all(texts: Iterable[str]) -> str:
    """Each text once, in the order in which they come: a, b and c."""
    *first, last = dict.fromkeys(texts)
    return f"{', '.join(first)} and {last}" if first else last


def joint_units(head: Head) -> tuple[str, ...]:
    """Unit of each joint's position, rad or m; rad of an arm that this machine does not have."""
    try:
        units = head.scenario.load_arm().joint_units
    except RcmqpError:
        units = ()
    return units if len(units) == len(head.joints) else ("rad",) * len(head.joints)


def unit_of(units: Iterable[str]) -> str:
    """The unit of a number over several joints: each unit once, rad or m."""
    return " or ".join(dict.fromkeys(units)) or "rad"
