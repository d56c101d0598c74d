"""A study with people as tables: Table I, answers, learning, comparisons."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from rcmqp.experiments.study.comparisons import (
    COMPARED,
    conditions,
    given_of,
    paired,
    side_by_side,
    title,
)
from rcmqp.experiments.study.outcome import Outcome
from rcmqp.experiments.study.statistics import FEWEST, effect, summary
from rcmqp.experiments.study.tables import EXTREMES, MEANS, table_one
from rcmqp.experiments.study.vocabulary import TRIALS
from rcmqp.experiments.trial.questions import RATINGS
from rcmqp.experiments.trial.results import Ended, Results
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.operators import GROUPS
from rcmqp.show.labels import given_words
from rcmqp.show.table import Table, definitions, literal

LEARNT = ("completion_s", "tip_rms_mm", "obstacle_shaft_mm")
"""What is followed from task to task."""

NOTES = """\
± is the standard deviation between people, [ ] the 95 % interval (Student's t) of the mean, given
for five people or more. Times are of those who found all pictures. (†), (‡): of which point the
paper gives the error, and from where to where the distance, is not said.

Comparisons are within people: each did every task. Change: the mean of the second less the first,
with its 95 % interval (Student's t). Effect size: the change over the standard deviation between
people (Cohen's d_av). p: Wilcoxon's signed-rank test, two-sided, given for five people or more;
p, Holm: corrected for all rows of the table. With few people only large effects can be seen, and
a large p does not show that nothing differs. The order of the controllers is counterbalanced, so
learning does not favour one of them as soon as every order was done equally often.
"""

MODEL = """\
Simulated operators are a model: there are no p values on people who are drawn, and none between
them and real people. Their device has a scale and viscosity of its own.
"""


def results_table(results: Results) -> str:
    """Markdown: people, simulated operators beside them, answers, learning and comparisons."""
    people = results.outcomes
    drawn = list(results.simulated.outcomes) if results.simulated else []
    names = {o.operator for o in people}
    parts = [f"{len(names)} people, {len(people)} tasks; {len(drawn)} simulated trials.\n"]
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
    if len(results.design.laws) > 1:
        parts.append(f"## From task to task\n\n{_learning(results.ended)}")
        parts.append(f"## Comparisons of people\n\n{_compared(people)}")
    explained = {TRIALS[name].row: TRIALS[name].meaning for name in (*MEANS, *EXTREMES)}
    notes = NOTES + (f"\n{MODEL}" if drawn else "")
    parts.append(f"{notes}\n## What the rows mean\n\n{definitions(explained)}")
    return "\n".join(parts)


def answers_csv(results: Results) -> str:
    """Who answered what, a row for each task."""
    heads = ["participant", "group", "task", "controller", "attempts", *RATINGS, "comment"]
    rows = [
        [
            each.outcome.operator,
            each.outcome.group,
            each.number,
            each.outcome.controller,
            each.notes["attempts"],
            *(each.answers.get(name) for name in (*RATINGS, "comment")),
        ]
        for each in results.ended
    ]
    return Table(heads, rows).csv()


def _named(outcomes: Sequence[Outcome], whose: str) -> list[Outcome]:
    return [dataclasses.replace(o, controller=f"{o.controller}, {whose}") for o in outcomes]


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
        rows.append([label, *cells, *_change(np.array(both).reshape(-1, 2))[:2]])
    heads = ["", *(f"task {k}" for k in numbers), "last less first", "effect size"]
    return Table(heads, rows).markdown()


def _compared(people: Sequence[Outcome]) -> str:
    """Each controller against each."""
    rows, chances = [], []
    for a, b in itertools.combinations(conditions(people), 2):
        for name in COMPARED:
            pairs = paired(people, a, b, name)
            pairs = pairs[~np.isnan(pairs).any(axis=1)]
            chances.append(signed_rank(pairs))
            cells = _change(pairs)
            rows.append([a[1], b[1], TRIALS[name].row, str(len(pairs)), *cells])
    for row, *both in zip(rows, chances, holm(chances), strict=True):
        row += ["" if math.isnan(p) else f"{p:.3g}" for p in both]
    heads = ["from", "to", "measure", "people", "change", "effect size", "p", "p, Holm"]
    return Table(heads, rows, words=3).markdown()


def _mean(values: Sequence[float], style: str) -> str:
    found = summary(values)
    if found.count == 0:
        return ""
    deviation = f" ± {found.deviation:{style}}" if found.count > 1 else ""
    return f"{found.mean:{style}}{deviation}"


def _change(pairs: Array) -> list[str]:
    """Mean change with its interval, and effect size, of pairs (n, 2)."""
    found = effect(*pairs.T)
    change = found.change
    if change.count == 0:
        return ["", ""]
    interval = f" [{change.low:.3g}, {change.high:.3g}]" if change.count >= FEWEST else ""
    return [f"{change.mean:.3g}{interval}", "" if math.isnan(found.size) else f"{found.size:.2g}"]


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
