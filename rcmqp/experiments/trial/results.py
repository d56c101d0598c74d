"""What people did in a study, read from its folder, and how many of them in which orders.

Simulated operators do the same task, and recorded hands are replayed, if they are asked for.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcmqp.errors import OptionError, RcmqpError
from rcmqp.experiments.batch import Progress
from rcmqp.experiments.study.outcome import Outcome, sum_up, task_of
from rcmqp.experiments.study.perform import Performed, perform
from rcmqp.experiments.study.plan import Law, Study
from rcmqp.experiments.study.replay import read_hands, replay
from rcmqp.experiments.study.trial_file import TrialFile
from rcmqp.experiments.trial.design import Design, orders
from rcmqp.experiments.trial.people import Folder, Person
from rcmqp.references.operators import GROUPS
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.run import Run
from rcmqp.show.table import Table

SIMULATED = "simulated"
"""Folder of the simulated operators' trials, in the study's."""


@dataclass(frozen=True, eq=False)
class Ended:
    """A task that a participant has ended.

    Attributes:
        number: of the task; the participant's first is 1.
        notes: see sitting.Sitting: condition, answers and so on.
        record: numbers and traces; the operator is the identifier.
    """

    number: int
    notes: Mapping[str, Any]
    record: TrialFile

    @property
    def outcome(self) -> Outcome:
        """The numbers."""
        return self.record.outcome

    @property
    def answers(self) -> Mapping[str, Any]:
        """To the questions after the task; empty if they are not answered yet."""
        return self.notes["answers"] or {}

    @property
    def devices(self) -> str:
        """What held the hand, such as "mouse, keys"; empty if that was not kept."""
        return ", ".join(self.notes.get("device", []))


@dataclass(frozen=True, eq=False)
class Results:
    """A study with people, as far as it has come.

    Attributes:
        design: of the study.
        folder: of the study.
        people: who has answered the questions before.
        ended: tasks that people have ended, one participant after the other.
        simulated: operators of the model at the same task; None without any.
        recorded: replays of recorded hands.
        remarks: which tasks do not count, and why.
    """

    design: Design
    folder: Path
    people: list[Person]
    ended: list[Ended]
    simulated: Performed | None
    recorded: list[TrialFile]
    remarks: list[str]

    @property
    def outcomes(self) -> list[Outcome]:
        """Of the people."""
        return [each.outcome for each in self.ended]


def read_results(
    folder: Path,
    *,
    operators: int = 0,
    hands: Sequence[Path] = (),
    seed: int = 0,
    jobs: int = 1,
    progress: Progress | None = None,
    scenario: str | None = None,
    controllers: Sequence[str] = (),
) -> Results:
    """Read what people did; let simulated operators do the same, and recorded hands be replayed.

    Args:
        folder: that ``rcmqp trial`` filled.
        operators: how many simulated people, with the same controllers.
        hands: CSV files of recorded hands, see read_hands().
        seed: of the simulated people.
        jobs: processes for them.
        progress: see perform().
        scenario: the study's Python file, see Design.with_files(); only for operators and hands.
        controllers: the study's own ones likewise. To sum up people, no file is run.

    Raises:
        OptionError: the folder has no study, nobody has ended a task, simulated operators
            cannot do this task, or a file is missing, see Design.with_files().
        RunFileError: a participant's file is damaged.
    """
    design, kept = Design.load(folder), Folder(folder)
    if operators or hands:
        design = design.with_files(scenario, controllers)
        design.check_unchanged()
    traces = read_hands(hands)
    ended, remarks, people = [], [], []
    for name in kept.identifiers():
        person = kept.person(name)
        assert person is not None
        people.append(person)
        for number in range(1, 1 + len(design.laws)):
            notes = kept.notes(name, number)
            if notes is None or notes.get("finished") is None:
                remarks.append(f"{name} has not ended task {number}; it does not count")
                continue
            try:
                ended.append(_ended(kept.run_file(name, number), name, person.group, notes))
            except RcmqpError as error:
                remarks.append(f"task {number} of {name} does not count: {error}")
    if not ended:
        why = f": {remarks[0]}" if remarks else ""
        raise OptionError(
            f"{folder} has no task that counts yet{why}; rcmqp trial --out {folder} goes on"
        )
    simulated = _simulate(design, folder, operators, seed, jobs, progress)
    recorded = []
    if traces:
        base = (
            (law, load_scenario(design.scenario, design.arm or None, period=law.period))
            for law in design.laws
        )
        recorded = replay(traces, list(base), folder, scale=design.scale)
    return Results(design, folder, people, ended, simulated, recorded, remarks)


def _ended(file: Path, name: str, group: str, notes: Mapping[str, Any]) -> Ended:
    """Raise RcmqpError if the run cannot be read."""
    run, law = Run.load(file), Law.from_json(notes["law"])
    outcome, traces = sum_up(run, name, group, law)
    record = TrialFile(outcome, run.scenario.to_json(), law.to_json(), "", traces)
    return Ended(notes["number"], notes, record)


def _simulate(
    design: Design,
    folder: Path,
    operators: int,
    seed: int,
    jobs: int,
    progress: Progress | None,
) -> Performed | None:
    if not operators:
        return None
    own = task_of(load_scenario(design.scenario, design.arm or None))
    for name in ("places", "spheres", "obstacle", "tolerance"):
        if getattr(own, name) != getattr(design.task, name):
            raise OptionError(
                f"the {name} of this study's task are not those of {design.scenario}, which "
                "simulated operators do; leave --operators out"
            )
    study = Study(design.scenario, operators, seed, (design.arm,), design.laws)
    return perform(study, folder / SIMULATED, jobs=jobs, progress=progress)


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
