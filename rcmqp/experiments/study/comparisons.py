"""What differs between controllers, and between arms: the same people with each."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcmqp.experiments.study.outcome import Outcome
from rcmqp.experiments.study.statistics import FEWEST, Effect, Summary, effect, summary
from rcmqp.experiments.study.vocabulary import TRIALS
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.setup import GIVEN, given_names
from rcmqp.show.table import Table
from rcmqp.world.loading import arm_names, arm_title

COMPARED = ("rcm_rms_mm", "tip_rms_mm", "effector_rms_mm", "obstacle_shaft_mm", "completion_s")
"""What controllers, and arms, are compared by."""

SIDE_BY_SIDE = (
    ("rcm_rms_mm", "mean", ".2g"),
    ("tip_rms_mm", "mean", ".2g"),
    ("tip_max_mm", "largest", ".3g"),
    ("effector_rms_mm", "mean", ".2g"),
    ("obstacle_shaft_mm", "mean", ".2g"),
    ("obstacle_shaft_mm", "least", ".2g"),
    ("completion_s", "mean", ".0f"),
    ("speed_ratio_max", "largest", ".2g"),
)
"""Outcome's field, which number of its Summary, and its style: people differ more than that."""

CHANGES = (
    "Change: the mean change ± its Monte-Carlo error, its standard error over the people drawn. "
    "Effect size: that change over the standard deviation between people (Cohen's d_av, of both "
    "samples' mean variance) ± its Monte-Carlo error, by the jackknife, given for "
    f"{FEWEST} people or more: of fewer, the deviation is too uncertain to divide by. More people "
    "make the "
    "errors smaller, not the effects larger; there are no p values, because people who are drawn "
    "from a model can be had in any number."
)
"""What the columns of a comparison mean."""

Condition = tuple[str, str]
"""Arm and controller, as an Outcome names them."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One measure, with two controllers on one arm or on two arms with one controller.

    Attributes:
        first, second: what is compared.
        name: the Outcome's field.
        effect: the second's less the first's, person by person.
    """

    first: Condition
    second: Condition
    name: str
    effect: Effect


def conditions(outcomes: Sequence[Outcome]) -> list[Condition]:
    """Arms and controllers, each pair once, in the order of the trials."""
    return list(dict.fromkeys((o.arm, o.controller) for o in outcomes))


def comparisons(outcomes: Sequence[Outcome]) -> list[Comparison]:
    """Compare controllers in pairs on the same arm, and arms in pairs with the same controller."""
    rows = []
    for a, b in itertools.combinations(conditions(outcomes), 2):
        if (a[0] == b[0]) == (a[1] == b[1]):
            continue
        rows += [
            Comparison(a, b, name, effect(*paired(outcomes, a, b, name).T)) for name in COMPARED
        ]
    return rows


def paired(outcomes: Sequence[Outcome], first: Condition, second: Condition, name: str) -> Array:
    """A measure with two conditions, (n, 2), a row for each person that has both."""
    a, b = (
        {o.operator: o for o in outcomes if (o.arm, o.controller) == condition}
        for condition in (first, second)
    )
    both = [i for i in a if i in b]
    return np.array([[getattr(of[i], name) for of in (a, b)] for i in both]).reshape(-1, 2)


def side_by_side(outcomes: Sequence[Outcome]) -> str:
    """Markdown: a column for each arm and controller; for two of them, what changes."""
    found, compared = conditions(outcomes), comparisons(outcomes)
    if len(found) < 2:
        return ""
    of = [[o for o in outcomes if (o.arm, o.controller) == each] for each in found]
    changes = {c.name: c for c in compared if c.effect.change.count} if len(found) == 2 else {}
    ends = ["mean change", "effect size"] if changes else []
    given = [given_of(each) for each in of]
    rows = [[TRIALS[name].row, *(each[name] for each in given)] for name in given_names(given)]
    for name, kind, style in SIDE_BY_SIDE:
        numbers = (getattr(summary([getattr(o, name) for o in x]), kind) for x in of)
        cells = [TRIALS[name].text(number, style) for number in numbers]
        rows.append(
            [_label(name, kind), *cells, *(_change(changes.get(name), kind) if ends else [])]
        )
    counts = [f"{sum(o.finished for o in x)}; {sum(o.collided for o in x)}" for x in of]
    rows.append(["finished; touched the obstacle", *counts])
    return Table(["", *_short(found), *ends], rows).markdown()


def _label(name: str, kind: str) -> str:
    """The title of a measure over all trials."""
    if kind == "least":
        return "the same, worst trial [mm]"
    return TRIALS[name].row_of("largest") if kind == "largest" else TRIALS[name].row


def given_of(outcomes: Sequence[Outcome]) -> dict[str, str]:
    """What the controller of a condition was given, see given_cells(); from a trial that ran."""
    one = next((o for o in outcomes if not o.failure), outcomes[0])
    return {"period_ms": f"{1e3 * one.period:g}"} | {
        name: getattr(one, name) for name in GIVEN if name != "period_ms"
    }


def comparison_table(outcomes: Sequence[Outcome]) -> str:
    """Markdown: a row for each comparison; empty where there is nothing to compare."""
    compared = comparisons(outcomes)
    if not compared:
        return ""
    rows = []
    for c in compared:
        arm, law = c.first
        if arm == c.second[0]:
            names = [law, c.second[1], title(arm)]
        else:
            names = [title(arm), title(c.second[0]), law]
        numbers = [_with_error(c.effect.change, ".4g"), _size(c.effect)]
        rows.append([*names, TRIALS[c.name].row, str(c.effect.change.count), *numbers])
    heads = ["from", "to", "on / with", "measure", "people", "mean change", "effect size"]
    return f"{Table(heads, rows, words=4).markdown()}\n{CHANGES}\n"


def title(arm: str) -> str:
    """An arm as a reader knows it."""
    return arm_title(arm) if arm in arm_names() else arm


def _short(found: Sequence[Condition]) -> list[str]:
    """The conditions without the arm, or the controller, that is everywhere the same."""
    arms, laws = ({each[i] for each in found} for i in (0, 1))
    if len(arms) == 1:
        return [law for _, law in found]
    return [title(arm) if len(laws) == 1 else f"{title(arm)}, {law}" for arm, law in found]


def _change(found: Comparison | None, kind: str) -> list[str]:
    if found is None or kind != "mean":
        return ["", ""]
    return [_with_error(found.effect.change, ".2g"), _size(found.effect)]


def _with_error(found: Summary, style: str) -> str:
    """Mean and Monte-Carlo error; the mean alone of one person."""
    if found.count < 2:
        return f"{found.mean:{style}}" if found.count else ""
    return f"{found.mean:{style}} ± {found.error:.2g}"


def _size(found: Effect) -> str:
    if math.isnan(found.size) or found.change.count < FEWEST:
        return ""
    error = "" if math.isnan(found.size_error) else f" ± {found.size_error:.2g}"
    return f"{found.size:.2g}{error}"
