"""A study with people: Table I, answers, learning, comparisons, and the folder with them all."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rcmqp.experiments.study.comparisons import (
    COMPARED,
    Condition,
    conditions,
    given_of,
    paired,
    side_by_side,
    title,
)
from rcmqp.experiments.study.hands import Asked, compare_asked, slowest
from rcmqp.experiments.study.outcome import Outcome
from rcmqp.experiments.study.replay import replay_table
from rcmqp.experiments.study.report import outcomes_csv, rows_explained, table_one
from rcmqp.experiments.study.statistics import FEWEST, effect, summary
from rcmqp.experiments.study.vocabulary import TRIALS
from rcmqp.experiments.trial.people import FIGURES, SUMMARIES
from rcmqp.experiments.trial.questions import RATINGS
from rcmqp.experiments.trial.results import Ended, Results, order_table, who_counts
from rcmqp.files import make_folder, write_text
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.operators import GROUPS
from rcmqp.references.paths import HandTrace
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.setup import given_words
from rcmqp.show.table import Table, literal

LEARNT = ("completion_s", "tip_rms_mm", "obstacle_shaft_mm")
"""What is followed from task to task."""

NOTES = f"""\
± is the standard deviation between people, [ ] the 95 % interval (Student's t) of the mean, given
for {FEWEST} people or more, ( ) of how many people. Times are of those who found all pictures.
(†), (‡): of which point the paper gives the error, and from where to where the distance, is not
said.

Comparisons are within people: each did every task. Change: the mean of the second less the first,
with its 95 % interval (Student's t). Effect size: the change over the standard deviation between
people (Cohen's d_av). p: Wilcoxon's signed-rank test, two-sided; p, Holm: corrected for all rows
of the table. Answers are ranks: their mean change has no interval and no effect size. Interval,
effect size and p are given for {FEWEST} people or more: of fewer, the deviation between people is
too uncertain to divide by, and the signed-rank test cannot come below p = 0.125. With few people
only large effects can be seen, and a large p does not show that nothing differs. Learning is part
of a comparison unless the orders are balanced, see "Order of the conditions". Who does not find
all pictures has no completion time and is missing from its comparison: a controller with which
fewer people finish can look faster than it is, so look at how many finished first.
"""

MODEL_NOTE = """\
Simulated operators are a model. So p values are given between real people only: not between
simulated operators, and not between these and real people. The simulated device has a scale and
viscosity of its own.
"""

ASKED = """\
How the tip was asked to go, of people after the viscosity of the page's hand: speed spectra and
smoothness, all trials treated alike, at the rate of the slowest. The trials of the model and of
recorded hands are those with the first controller. A loop behind the clock adds fast changes of
speed. This describes; it is not a test.
"""


def results_table(results: Results) -> str:
    """Markdown: people, simulated operators and recorded hands, answers and comparisons."""
    people, recorded = results.outcomes, [each.outcome for each in results.recorded]
    drawn = list(results.simulated.outcomes) if results.simulated else []
    names = {o.operator for o in people}
    counts = {
        "people": len(names),
        "their tasks": len(people),
        "simulated trials": len(drawn),
        "recorded hands": len({o.operator for o in recorded}),
    }
    parts = [
        f"{', '.join(f'{kind}: {count}' for kind, count in counts.items())}.\n",
        f"## Who is counted\n\n{who_counts(results)}",
    ]
    several = len(results.design.laws) > 1
    if several:
        parts.append(f"## Order of the conditions\n\n{order_table(results)}")
    if drawn:
        beside = side_by_side([*_named(people, "people"), *_named(drawn, "model")])
        parts.append(f"## Side by side\n\n{beside}")
    for whose, outcomes in (("People", people), ("Simulated operators", drawn)):
        for condition in conditions(outcomes):
            mine = [o for o in outcomes if (o.arm, o.controller) == condition]
            given = ", ".join(given_words(given_of(mine)).values())
            head = f"## {whose}: {title(condition[0])}, {condition[1]}"
            parts.append(f"{head}\n\nThe controller: {given}.\n\n{table_one(mine)}")
    parts.append(f"## What people said\n\n{_said(results.ended)}")
    if several:
        parts.append(f"## From task to task\n\n{_learning(results.ended)}")
        parts.append(f"## Comparisons of people\n\n{_compared(results.ended)}")
    if recorded:
        parts.append(f"## Recorded hands\n\n{replay_table(recorded)}")
    if compared := compare_asked(*asked_of(results)):
        parts.append(f"## Speed spectra\n\n{ASKED}\n{compared[0]}")
    notes = NOTES + (f"\n{MODEL_NOTE}" if drawn else "")
    parts.append(f"{notes}\n## What the rows mean\n\n{rows_explained([*people, *drawn])}")
    return "\n".join(parts)


def asked_of(results: Results) -> tuple[list[Asked], list[Asked], float]:
    """Traces of people and recordings, those of the model, and a rate, for compare_asked()."""
    found, model, first = list[Asked](), list[Asked](), str(results.design.laws[0])
    for group in GROUPS:
        mine = [each for each in results.ended if each.outcome.group == group]
        people = len({each.outcome.operator for each in mine})
        if mine:
            title = f"people, {people} {group}, {len(mine)} tasks"
            found.append((title, [each.record.traces for each in mine]))
    hands = [e for e in results.recorded if e.traces and e.outcome.controller == first]
    found += [(str(each.outcome.operator), [each.traces]) for each in hands]
    paths = [Scenario.from_json(each.scenario).path for each in hands]
    rate = slowest(path.times for path in paths if isinstance(path, HandTrace))
    if results.simulated is not None:
        for group in GROUPS:
            drawn = [
                results.simulated.record(i).traces
                for i, o in enumerate(results.simulated.outcomes)
                if o.group == group and o.controller == first and not o.failure
            ]
            if drawn:
                model.append((f"model, {len(drawn)} {group}", drawn))
    return found, model, rate


def answers_csv(results: Results) -> str:
    """Who answered what, a row for each task."""
    heads = ["participant", "group", "task", "controller", "device", "attempts"]
    heads += [*RATINGS, "comment"]
    rows = [
        [
            each.outcome.operator,
            each.outcome.group,
            each.number,
            each.outcome.controller,
            each.devices,
            each.notes["attempts"],
            *(each.answers.get(name) for name in (*RATINGS, "comment")),
        ]
        for each in results.ended
    ]
    return Table(heads, rows).csv()


def _named(outcomes: Sequence[Outcome], whose: str) -> list[Outcome]:
    """The outcomes, whose controllers say whose they are and how many people had them."""
    count = Counter(o.controller for o in outcomes)
    return [
        dataclasses.replace(o, controller=f"{o.controller}, {whose}: {count[o.controller]}")
        for o in outcomes
    ]


def _said(ended: Sequence[Ended]) -> str:
    """Ratings by controller and group, and the comments."""
    rows = []
    for condition in conditions([each.outcome for each in ended]):
        mine = [e for e in ended if (e.outcome.arm, e.outcome.controller) == condition]
        for name, (asked, words) in RATINGS.items():
            cells = [_rated(mine, name, group) for group in (None, *GROUPS)]
            counts = [sum(each.answers.get(name) == k for each in mine) for k in range(1, 5)]
            given = ", ".join(f"{word} {n}" for word, n in zip(words, counts, strict=True))
            rows.append([condition[1], asked, *cells, given])
    text = Table(["controller", "question, 1 to 4", "all", *GROUPS, "answers"], rows, words=2)
    comments = [
        f"- {each.outcome.operator}, {literal(each.outcome.controller)}: "
        f"{literal(each.answers['comment'])}\n"
        for each in ended
        if each.answers.get("comment")
    ]
    return text.markdown() + ("\n" + "".join(comments) if comments else "")


def _rated(ended: Sequence[Ended], name: str, group: str | None) -> str:
    of = [each for each in ended if group in (None, each.outcome.group)]
    return _mean([each.answers.get(name, math.nan) for each in of], ".2f")


def _learning(ended: Sequence[Ended]) -> str:
    """Task by task, whatever the controller; and from the first to the last."""
    measures: dict[str, Callable[[Ended], float]] = {
        TRIALS[name].row: lambda each, name=name: getattr(each.outcome, name)  # type: ignore[misc]
        for name in LEARNT
    }
    measures |= {
        asked: lambda each, name=name: each.answers.get(name, math.nan)  # type: ignore[misc]
        for name, (asked, _) in RATINGS.items()
    }
    numbers = sorted({each.number for each in ended})
    rows = []
    for label, of in measures.items():
        by = [{e.outcome.operator: of(e) for e in ended if e.number == k} for k in numbers]
        both = [[by[0][i], by[-1][i]] for i in by[0] if i in by[-1]]
        cells = [_mean(list(each.values()), ".3g") for each in by]
        pairs = _whole(np.array(both).reshape(-1, 2))
        sized = label in {TRIALS[name].row for name in LEARNT}
        rows.append([label, *cells, str(len(pairs)), *_change(pairs, sized=sized)])
    heads = ["", *(f"task {k}" for k in numbers), "people", "last less first", "effect size"]
    return Table(heads, rows).markdown()


def _compared(ended: Sequence[Ended]) -> str:
    """Each controller against each."""
    rows, chances = [], []
    people = [each.outcome for each in ended]
    for a, b in itertools.combinations(conditions(people), 2):
        measured = {TRIALS[name].row: paired(people, a, b, name) for name in COMPARED}
        rated = {asked: _rated_pairs(ended, a, b, name) for name, (asked, _) in RATINGS.items()}
        for label, found in (measured | rated).items():
            pairs = _whole(found)
            chances.append(signed_rank(pairs))
            cells = _change(pairs, sized=label in measured)
            rows.append([a[1], b[1], label, str(len(pairs)), *cells])
    for row, *both in zip(rows, chances, holm(chances), strict=True):
        row += ["" if math.isnan(p) else f"{p:.3g}" for p in both]
    heads = ["from", "to", "measure", "people", "change", "effect size", "p", "p, Holm"]
    periods = sorted({o.period for o in people})
    apart = (
        f"**The periods differ**, {' and '.join(f'{1e3 * T:g}' for T in periods)} ms: a change "
        "between controllers of different periods is one of both.\n"
    )
    few = f"Fewer than {FEWEST} people have both: no interval, effect size or p is given.\n"
    some = any(int(row[3]) < FEWEST for row in rows)
    text = Table(heads, rows, words=3).markdown() + (f"\n{few}" if some else "")
    return text + (f"\n{apart}" if len(periods) > 1 else "")


def _rated_pairs(ended: Sequence[Ended], a: Condition, b: Condition, name: str) -> Array:
    """Answers (n, 2) of those who rated both conditions."""
    given = {
        (each.outcome.operator, each.outcome.arm, each.outcome.controller): each.answers[name]
        for each in ended
        if name in each.answers
    }
    names = dict.fromkeys(each.outcome.operator for each in ended)
    both = [[given.get((i, *c), math.nan) for c in (a, b)] for i in names]
    return np.array(both, dtype=float).reshape(-1, 2)


def _whole(pairs: Array) -> Array:
    """The pairs (n, 2) of those who have both numbers."""
    return pairs[~np.isnan(pairs).any(axis=1)]


def _mean(values: Sequence[float], style: str) -> str:
    """Mean, deviation, and of how many people."""
    found = summary(values)
    if found.count == 0:
        return ""
    deviation = f" ± {found.deviation:{style}}" if found.count > 1 else ""
    return f"{found.mean:{style}}{deviation} ({found.count})"


def _change(pairs: Array, *, sized: bool) -> list[str]:
    """Mean change of pairs (n, 2); its interval and the effect size if they are ``sized``."""
    found = effect(*pairs.T)
    change = found.change
    if change.count == 0:
        return ["", ""]
    if not sized or change.count < FEWEST:
        return [f"{change.mean:.3g}", ""]
    size = "" if math.isnan(found.size) else f"{found.size:.2g}"
    return [f"{change.mean:.3g} [{change.low:.3g}, {change.high:.3g}]", size]


def signed_rank(pairs: Array) -> float:
    """Two-sided p of Wilcoxon's signed-rank test of pairs (n, 2); NaN below FEWEST people."""
    from scipy.stats import wilcoxon  # SciPy takes long to import

    if len(pairs) < FEWEST:
        return math.nan
    changes = pairs[:, 1] - pairs[:, 0]
    return float(wilcoxon(changes).pvalue) if changes.any() else 1.0


def holm(chances: Sequence[float]) -> list[float]:
    """Values of p, corrected for their number after Holm; NaN stays and does not count."""
    order = sorted((p, i) for i, p in enumerate(chances) if not math.isnan(p))
    found, largest = [math.nan] * len(chances), 0.0
    for rank, (p, i) in enumerate(order):
        largest = max(largest, min(1.0, (len(order) - rank) * p))
        found[i] = largest
    return found


def write_results(results: Results) -> tuple[str, list[Path]]:
    """table.md, trials.csv, answers.csv, recorded.csv; the table's text and the files.

    Raises:
        RunFileError: a file cannot be written.
    """
    text = results_table(results)
    contents = (
        f"# Study with people: {results.design.scenario}\n\n{text}",
        outcomes_csv(results.outcomes),
        answers_csv(results),
    )
    files = [results.folder / name for name in SUMMARIES]
    for file, content in zip(files, contents, strict=True):
        write_text(file, content)
    if results.recorded:
        files.append(results.folder / "recorded.csv")
        write_text(files[-1], outcomes_csv([each.outcome for each in results.recorded]))
    return text, files


def write_figures(results: Results) -> Path:
    """Fig. 4, groups, spectra of the hands, and Figs. 6 and 7 of each task; their folder.

    Raises:
        RunFileError: a file cannot be written.
    """
    from rcmqp.experiments.study import figures
    from rcmqp.show import plots  # matplotlib takes long to import

    folder = make_folder(results.folder / FIGURES)
    first = Scenario.from_json(results.ended[0].record.scenario)
    drawn = {"fig4_views": figures.views_figure(first)}
    for i, condition in enumerate(conditions(results.outcomes), start=1):
        mine = [o for o in results.outcomes if (o.arm, o.controller) == condition]
        drawn[f"groups_{i}"] = figures.groups_figure(mine)
    for each in results.ended:
        stem, scenario = f"{each.outcome.operator}-{each.number}", each.record.scenario
        drawn[f"{stem}_fig6_errors"] = figures.trial_figure(each.record)
        made = Scenario.from_json(scenario)
        drawn[f"{stem}_fig7_trajectory"] = figures.trajectory_figure(made, each.record)
    if compared := compare_asked(*asked_of(results)):
        drawn["hands"] = compared[1]
    for name, figure in drawn.items():
        plots.save_figure(figure, folder / name, endings=(".png",))
    return folder
