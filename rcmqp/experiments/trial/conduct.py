"""How a study with people was carried out: who is counted, and in which orders."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from rcmqp.experiments.trial.design import orders
from rcmqp.experiments.trial.people import Person
from rcmqp.experiments.trial.results import Results
from rcmqp.references.operators import GROUPS
from rcmqp.show.table import Table


def who_counts(results: Results) -> str:
    """Markdown: how many people of each group, by which devices, and which tasks do not count."""
    done = _done(results)
    began = {each.outcome.operator for each in results.ended}
    kinds = {
        "answered the questions before": results.people,
        "ended a task": [p for p in results.people if p.identifier in began],
        "ended all tasks": done,
        "practised before": [p for p in results.people if p.practised],
    }
    for devices in sorted({each.devices for each in results.ended} - {""}):
        users = {each.outcome.operator for each in results.ended if each.devices == devices}
        kinds[f"steered by {devices}"] = [p for p in results.people if p.identifier in users]
    rows = [[kind, *map(str, _by_group(people))] for kind, people in kinds.items()]
    again = [
        f"{each.outcome.operator} needed {each.notes['attempts']} attempts at task {each.number}; "
        "the last one counts, and those before it were practice"
        for each in results.ended
        if each.notes["attempts"] > 1
    ]
    said = "".join(f"- {remark}\n" for remark in (*results.remarks, *again))
    return Table(["people", "all", *GROUPS], rows).markdown() + (f"\n{said}" if said else "")


def order_table(results: Results) -> str:
    """Markdown: how many of those who ended all tasks had each order; a warning if uneven.

    The warning counts, for each comparison, the people that are in it: who ended both its tasks.
    """
    done, laws = _done(results), results.design.laws
    rows, possible = [], orders(len(laws))
    for number, order in enumerate(possible):
        mine = [p for p in done if p.row == number]
        rows.append([", then ".join(str(laws[k]) for k in order), *map(str, _by_group(mine))])
    text = Table(["order, of people who ended all tasks", "all", *GROUPS], rows).markdown()
    ended = {(each.outcome.operator, each.outcome.controller) for each in results.ended}
    uneven, somebody = list[str](), False
    for a, b in itertools.combinations(map(str, laws), 2):
        both = [p for p in results.people if {(p.identifier, a), (p.identifier, b)} <= ended]
        somebody |= bool(both)
        for group in GROUPS:
            had = [p.row for p in both if p.group == group]
            counts = [had.count(number) for number in range(len(possible))]
            if min(counts) < max(counts):
                which = f"{a} and {b}, " if len(laws) > 2 else ""
                uneven.append(f"{which}{group}: {min(counts)} to {max(counts)} people an order")
    if not somebody:
        return text
    if not uneven:
        return f"{text}\nThe orders are balanced in each group.\n"
    return (
        f"{text}\n**Unbalanced** ({'; '.join(uneven)}). What people learn from task to task "
        "favours the conditions that more of them had later: a change between conditions is "
        "partly learning. Let more people take part, until in each group each of the "
        f"{len(possible)} orders was ended equally often.\n"
    )


def _done(results: Results) -> list[Person]:
    """Who has ended all tasks."""
    ended = [each.outcome.operator for each in results.ended]
    count = len(results.design.laws)
    return [p for p in results.people if ended.count(p.identifier) == count]


def _by_group(people: Sequence[Person]) -> list[int]:
    """How many, and of each group."""
    return [len(people), *(sum(p.group == group for p in people) for group in GROUPS)]
