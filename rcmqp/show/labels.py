"""What tells runs apart, and what each of them was given: for tables, pages and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rcmqp.runs.head import Head
from rcmqp.runs.run import Run

GIVEN = {
    "feed_forward": "feed-forward",
    "limits_enforced": "joint limits enforced",
    "period_ms": "T [ms]",
    "gain": "K [1/s]",
    "assumed": "limits assumed",
}
"""Title of each column of given_cells()."""

_WORDS = {
    "feed_forward": "feed-forward: {}",
    "limits_enforced": "joint limits enforced: {}",
    "period_ms": "T = {} ms",
    "gain": "K = {} 1/s",
    "assumed": "limits assumed: {}",
}

TOLD = ("feed_forward", "gain", "velocity_limit", "velocity_limits")
"""Options that given_cells() already tells."""


def given_cells(head: Head) -> dict[str, str]:
    """What a run's controller was given, for a table; the names are those of GIVEN."""
    given = head.given
    return {
        "feed_forward": given.feed_forward_text,
        "limits_enforced": given.limits_text,
        "period_ms": f"{1e3 * head.scenario.period:g}",
        "gain": given.gain_text,
        "assumed": " and ".join(head.assumed) or "none",
    }


def given_words(cells: Mapping[str, str]) -> dict[str, str]:
    """The same in words, for a legend or a caption, out of what given_cells() says."""
    return {name: _WORDS[name].format(cells[name]) for name in GIVEN}


def run_marks(runs: Sequence[Run]) -> tuple[list[str], list[list[str]]]:
    """What all runs were given, and what each run is.

    Returns:
        Words that hold for all runs; and for each run its controller, what it was given that
        others were not, its seed if they differ, and options that differ between runs of one
        controller.
    """
    words = [given_words(given_cells(run.head)) for run in runs]
    shared = [name for name in GIVEN if len({each[name] for each in words}) == 1]
    marks = []
    for run, mine in zip(runs, words, strict=True):
        alike = [other for other in runs if other.controller == run.controller]
        marks.append([run.controller, *(mine[name] for name in GIVEN if name not in shared)])
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
