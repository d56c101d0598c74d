"""What is kept of each participant: an identifier, answers and trials; no name, no date."""

from __future__ import annotations

import itertools
import json
import math
import re
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rcmqp.errors import OptionError, RcmqpError, RunFileError
from rcmqp.experiments.study.plan import Law
from rcmqp.experiments.trial.design import Design, orders
from rcmqp.experiments.trial.questions import EXPERIENCE, LEVELS, checked_after, group_of
from rcmqp.files import held, make_folder, remove, write_text
from rcmqp.references.operators import GROUPS

PEOPLE, TRIALS = "people", "trials"
"""Folders of a study: answers before the task, and trials with the answers after it."""

HIGHEST = "highest_number.txt"
"""File of the highest number of P01, P02 and so on when a participant was deleted last."""

FIGURES, SUMMARIES = "figures", ("table.md", "trials.csv", "answers.csv")
OF_ALL = ("groups_*", "hands*")
"""What ``rcmqp study`` makes of them all: a folder and files, and figures in the folder."""

DAMAGED = "is damaged; delete the participant with rcmqp trial --delete"
"""What is said of a file of a participant that is not as it was written."""

IDENTIFIER = re.compile(r"[A-Z]{0,3}[0-9]{1,6}", re.ASCII)


@dataclass(frozen=True, slots=True)
class Person:
    """A participant who has answered the questions before the task.

    Attributes:
        identifier: see checked_id().
        before: answers, see questions.EXPERIENCE.
        group: novice or experienced.
        row: of orders(), in which the conditions come.
        practised: whether the person has practised; who is experienced does not.
    """

    identifier: str
    before: Mapping[str, int]
    group: str
    row: int
    practised: bool


def checked_id(text: str) -> str:
    """An identifier: up to three capital letters, then one to six digits; a name is not one.

    Raises:
        OptionError: it is not one.
    """
    if not IDENTIFIER.fullmatch(text):
        raise OptionError(
            f"identifier {text!r:.50}, it must be at most three capital letters and then one to "
            "six digits, such as P07; a study keeps no names"
        )
    return text


class Folder:
    """The files of a study with people."""

    def __init__(self, path: Path) -> None:
        """Of the study in a folder; nothing is written yet."""
        self.path = path

    def identifiers(self) -> list[str]:
        """Who takes part, sorted."""
        found = (file.stem for file in (self.path / PEOPLE).glob("*.json"))
        return sorted(name for name in found if IDENTIFIER.fullmatch(name))

    @contextmanager
    def sitting(self, identifier: str | None = None) -> Iterator[str]:
        """Hold a participant until the block ends, so that no other process leads the same one.

        Without an identifier it is the one of P01, P02 and so on that follows all there ever were.

        Raises:
            OptionError: the participant is held already, or the identifier is none.
            RunFileError: the folder cannot be written.
        """
        names: Iterable[str] = (f"P{n:02d}" for n in itertools.count(1 + self._highest()))
        if identifier is not None:
            names = [checked_id(identifier)]
        make_folder(self.path / PEOPLE)
        for name in names:
            with held(self._lock(name)) as free:
                if free:
                    yield name
                    return
        raise OptionError(
            f"{identifier} is with another rcmqp trial in {self.path} now; wait until that has "
            "ended, or end it with Ctrl-C"
        )

    def _highest(self, *more: str) -> int:
        """The highest number of P01, P02 and so on that there ever was; 0 without any."""
        file = self.path / HIGHEST
        try:
            before = int(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            before = 0
        except (OSError, ValueError) as error:
            raise RunFileError(
                file, "is damaged; write the highest number of a participant so far into it"
            ) from error
        names = (*self.identifiers(), *more)
        return max([before, *(int(name[1:]) for name in names if re.fullmatch("P[0-9]+", name))])

    def person(self, identifier: str) -> Person | None:
        """A participant; None before the questions are answered.

        Raises:
            RunFileError: the file is damaged.
        """
        data = self._read(self._person_file(identifier))
        if data is None:
            return None
        try:
            found = Person(**data)
            known = (
                found.group in GROUPS
                and found.identifier == identifier
                and _is_whole(found.row, 0)
                and isinstance(found.practised, bool)
                and isinstance(found.before, dict)
                and found.before.keys() == EXPERIENCE.keys()
                and all(_is_whole(level, 0, len(LEVELS) - 1) for level in found.before.values())
            )
        except TypeError:
            known = False
        if not known:
            raise RunFileError(self._person_file(identifier), DAMAGED)
        return found

    def add(self, identifier: str, before: Mapping[str, int], design: Design) -> Person:
        """Take a new participant, in the order that fewest of the same group have had so far.

        Of several such orders it is the one that fewest people in all have had. Two processes
        take one after the other, so two people who answer at once do not count as one.

        Raises:
            RunFileError: a file cannot be read or written.
        """
        make_folder(self.path / PEOPLE)
        make_folder(self.path / TRIALS)
        group = group_of(before)
        with self._alone():
            others = [each for each in map(self.person, self.identifiers()) if each is not None]
            alike = [each.row for each in others if each.group == group]
            rows = [each.row for each in others]
            count = len(orders(len(design.laws)))
            row = min(range(count), key=lambda k: (alike.count(k), rows.count(k)))
            person = Person(identifier, before, group, row, practised=False)
            self.keep_person(person)
        return person

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Hold the study's orders; wait for another process that holds them."""
        file = self.path / ".orders.lock"
        for _ in range(500):
            with held(file) as free:
                if free:
                    yield
                    return
            time.sleep(0.02)
        raise RunFileError(file, "has been held by another rcmqp trial for 10 s; end that one")

    def keep_person(self, person: Person) -> None:
        """Write a participant's answers."""
        write_text(self._person_file(person.identifier), _json(asdict(person)))

    def run_file(self, identifier: str, number: int) -> Path:
        """The run of a participant's trial; the first has number 1."""
        return self.path / TRIALS / f"{checked_id(identifier)}-{number}.h5"

    def forget_run(self, identifier: str, number: int) -> None:
        """Remove the run of an older attempt, which must not stand for the one that begins.

        Raises:
            RunFileError: it cannot be removed.
        """
        remove(self.run_file(identifier, number))

    def notes(self, identifier: str, number: int) -> dict[str, Any] | None:
        """What is kept beside a run: condition, latencies, answers; None before its first attempt.

        Raises:
            RunFileError: the file is damaged.
        """
        file = self.run_file(identifier, number).with_suffix(".json")
        if (data := self._read(file)) is None:
            return None
        try:
            Law.from_json(data["law"])
            if data["answers"] is not None:
                data["answers"] = checked_after(data["answers"])
            known = (
                data["number"] == number
                and _is_whole(data["attempts"], 0)
                and isinstance(data["faults"], list)
                and isinstance(data.get("device", []), list)
                and all(isinstance(device, str) for device in data.get("device", []))
                and (data["finished"] is None or isinstance(data["finished"], bool))
            )
        except (ValueError, TypeError, KeyError, AttributeError, RcmqpError):
            known = False
        if not known:
            raise RunFileError(file, DAMAGED)
        return data

    def keep_notes(self, identifier: str, number: int, notes: Mapping[str, Any]) -> None:
        """Write what is kept beside a run."""
        write_text(self.run_file(identifier, number).with_suffix(".json"), _json(notes))

    def delete(self, identifier: str) -> int:
        """Remove all of a participant, and what sums up all people; how many files there were.

        Raises:
            OptionError: nobody has this identifier, or this participant is held, see sitting().
            RunFileError: a file cannot be removed.
        """
        there = [
            file  # names that begin with a point are those of files that a kill left unfinished
            for folder in (PEOPLE, TRIALS, FIGURES)
            for file in (self.path / folder).glob("*")
            if re.fullmatch(rf"\.?{checked_id(identifier)}[.@-].*", file.name) and file.is_file()
        ]
        if not there:
            known = ", ".join(self.identifiers()) or "nobody"
            raise OptionError(f"{self.path} has no participant {identifier}; it has {known}")
        there += filter(Path.is_file, [self.path / name for name in SUMMARIES])
        there += [file for name in OF_ALL for file in (self.path / FIGURES).glob(name)]
        with self.sitting(identifier):
            write_text(self.path / HIGHEST, f"{self._highest(identifier)}\n")
            for file in {*there, self._lock(identifier)}:
                remove(file)
        return len(there)

    def _lock(self, identifier: str) -> Path:
        return self.path / PEOPLE / f".{checked_id(identifier)}.lock"

    def _person_file(self, identifier: str) -> Path:
        return self.path / PEOPLE / f"{checked_id(identifier)}.json"

    def _read(self, file: Path) -> dict[str, Any] | None:
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise RunFileError(file, f"cannot be read: {error}") from error
        if not isinstance(data, dict):
            raise RunFileError(file, DAMAGED)
        return data


def _is_whole(value: Any, least: int, most: float = math.inf) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and least <= value <= most


def _json(data: Mapping[str, Any]) -> str:
    return json.dumps(data, indent=1, sort_keys=True) + "\n"
