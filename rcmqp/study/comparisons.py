"""What differs between controllers, and between arms: the same people with each."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from rcmqp.labels import GIVEN
from rcmqp.loading import arm_names, arm_title
from rcmqp.study.outcome import Outcome
from rcmqp.study.statistics import Paired, holm, least_rank_p, paired, summary

COMPARED = ("rcm_rms_mm", "tip_rms_mm", "effector_rms_mm", "obstacle_shaft_mm", "completion_s")
"""What controllers, and arms, are compared by."""

SIDE_BY_SIDE = (
    ("RCM error, rms [mm]", "rcm_rms_mm", "mean", ".2g"),
    ("tip error, rms [mm]", "tip_rms_mm", "mean", ".2g"),
    ("tip error, largest [mm]", "tip_max_mm", "largest", ".3g"),
    ("effector error, rms [mm]", "effector_rms_mm", "mean", ".2g"),
    ("least distance, shaft to obstacle [mm]", "obstacle_shaft_mm", "mean", ".2g"),
    ("the same, worst trial [mm]", "obstacle_shaft_mm", "least", ".2g"),
    ("completion time [s]", "completion_s", "mean", ".0f"),
    ("joint speed over its limit, largest", "speed_ratio_max", "largest", ".2g"),
)
"""Label, Outcome's field, which number of its Summary, and how that is written."""

SIGNIFICANT = 0.05

Condition = tuple[str, str]
"""Arm and controller, as an Outcome names them."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One measure, with two controllers on one arm or on two arms with one controller.

    Attributes:
        first, second: what is compared.
        name: the Outcome's field.
        found: the second's less the first's, person by person.
        p: of the signed-rank test, by Holm corrected for the number of comparisons.
    """

    first: Condition
    second: Condition
    name: str
    found: Paired
    p: float


def conditions(outcomes: Sequence[Outcome]) -> list[Condition]:
    """Arms and controllers, each pair once, in the order of the trials."""
    return list(dict.fromkeys((o.arm, o.controller) for o in outcomes))


def comparisons(outcomes: Sequence[Outcome]) -> list[Comparison]:
    """Each controller against each on an arm, and each arm against each with a controller."""
    rows = []
    for a, b in itertools.combinations(conditions(outcomes), 2):
        if (a[0] == b[0]) == (a[1] == b[1]):
            continue
        first, second = (_by_operator(outcomes, condition) for condition in (a, b))
        people = sorted(first.keys() & second.keys())
        for name in COMPARED:
            found = paired(*([getattr(of[i], name) for i in people] for of in (first, second)))
            rows.append((a, b, name, found))
    corrected = holm([row[3].p_signed_rank for row in rows])
    return [Comparison(*row, p) for row, p in zip(rows, corrected, strict=True)]


def side_by_side(outcomes: Sequence[Outcome]) -> str:
    """Markdown: a column for each arm and controller; for two of them, what changes."""
    found, compared = conditions(outcomes), comparisons(outcomes)
    if len(found) < 2:
        return ""
    of = [[o for o in outcomes if (o.arm, o.controller) == each] for each in found]
    changes = {c.name: c for c in compared} if len(found) == 2 else {}
    ends = ["mean change [95 %]", "p, rank (Holm)"] if changes else []
    heads = ["", *_short(found), *ends]
    lines = [row(heads), row(["---", *["---:"] * (len(heads) - 1)])]
    given = [given_of(each) for each in of]
    for name, label in GIVEN.items():
        lines.append(row([label, *(each[name] for each in given), *[""] * len(ends)]))
    for label, name, kind, style in SIDE_BY_SIDE:
        cells = [format(getattr(summary([getattr(o, name) for o in x]), kind), style) for x in of]
        lines.append(row([label, *cells, *(_change(changes.get(name), kind) if ends else [])]))
    counts = [f"{sum(o.finished for o in x)}; {sum(o.collided for o in x)}" for x in of]
    lines.append(row(["finished; touched the obstacle", *counts, *[""] * len(ends)]))
    return "\n".join(lines) + "\n"


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
    heads = ["from", "to", "on / with", "measure", "people", "mean change", "95 %"]
    lines = [row([*heads, "p, t", "p, rank", "Holm"]), row(["---"] * 4 + ["---:"] * 6)]
    for c in compared:
        d, (arm, law) = c.found.difference, c.first
        if arm == c.second[0]:
            names = [law, c.second[1], title(arm)]
        else:
            names = [title(arm), title(c.second[0]), law]
        numbers = [f"{d.mean:.4g}", f"[{d.low:.4g}, {d.high:.4g}]", f"{c.found.p_t:.2g}"]
        p_values = [f"{c.found.p_signed_rank:.2g}", f"{c.p:.2g}"]
        if d.count < 2:  # one person, or none: neither intervals nor tests
            numbers, p_values = [numbers[0] if d.count else "", "", ""], ["", ""]
        lines.append(row([*names, c.name, str(d.count), *numbers, *p_values]))
    tests = "Paired t test and Wilcoxon's signed-rank test; Holm's correction is of the latter."
    lines += ["", tests]
    people = max(c.found.difference.count for c in compared)
    least = least_rank_p(people)
    if people and least * len(compared) > SIGNIFICANT:
        lines.append(
            f"With {people} people p, rank is {least:.2g} at the least, however alike their "
            f"changes are, and {min(1.0, least * len(compared)):.2g} corrected for "
            f"{len(compared)} comparisons: too few people to find anything at {SIGNIFICANT:g}."
        )
    return "\n".join(lines) + "\n"


def row(cells: Sequence[str]) -> str:
    """A line of a Markdown table."""
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


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
    d = found.found.difference
    if d.count < 2:
        return [f"{d.mean:.2g}" if d.count else "", ""]
    return [f"{d.mean:.2g} [{d.low:.2g}, {d.high:.2g}]", f"{found.p:.2g}"]


def _by_operator(outcomes: Sequence[Outcome], condition: Condition) -> dict[int, Outcome]:
    return {o.operator: o for o in outcomes if (o.arm, o.controller) == condition}
