"""What a sitting does when a loop or a file fails; without the process of the loop and pages."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rcmqp.errors import OptionError
from rcmqp.experiments.study.plan import Law
from rcmqp.experiments.trial.design import Design
from rcmqp.experiments.trial.people import Folder
from rcmqp.experiments.trial.questions import EXPERIENCE
from rcmqp.experiments.trial.task import scenarios_task
from rcmqp.live import sitting
from rcmqp.live.loop_process import LoopEnded
from rcmqp.live.messages import Said
from rcmqp.runs.loading import load_scenario

TASK = scenarios_task(load_scenario("camera_task", "panda"))
DESIGN = Design("camera_task", "panda", (Law("hierarchical_qp"),), TASK, practice=0.0)
FEW = dict.fromkeys(EXPERIENCE, 0)
ENDED: dict[str, Any] = {
    "fault": "",
    "recorded": "9 cycles",
    "recorded_whole": True,
    "reached": [1.0] * len(TASK.places),
    "latency": {},
    "priority": "ordinary, as there is one processor only",
    "skipped": 0.25,
}


class Participant:
    """A console whose participant answers all questions and starts whatever can be started."""

    def __init__(self) -> None:
        self.page, self.told = "", list[dict[str, Any]]()
        self.said: Callable[[Said], None] = lambda said: None
        self.drawn: Any = None
        self.devices = {"gamepad"}  # held while reading, before the start

    def turn(self, channel: Any) -> Any:
        return channel

    def tell(self, words: dict[str, Any]) -> None:
        self.told.append(words)
        if words["kind"] == "next":
            after: dict[str, Any] = {"ease": 1, "followed": 1, "comment": ""}
            before: dict[str, Any] = dict.fromkeys(EXPERIENCE, 0) | {"consent": True}
            for said in (Said("start", {}), Said("answers", after), Said("answers", before)):
                asyncio.get_running_loop().call_soon(self.said, said)


class Loop:
    """A loop that ends at once, and writes a run if it is one that is kept."""

    def __init__(self, out: str | None, last: dict[str, Any], devices: set[str]) -> None:
        self.devices, self.out, self.last, self.channel = devices, out and Path(out), last, None

    def stop(self) -> None: ...

    def prepare(self) -> None:
        if "cannot" in self.last:
            raise LoopEnded("the loop cannot begin")

    def start(self) -> None:
        assert not self.devices, "what was held before the start does not count"
        self.devices.update(self.last.get("devices", []))
        if self.out:
            assert not self.out.exists(), "the run of an older attempt is still there"
            self.out.write_text("a run")

    def last_words(self) -> dict[str, Any]:
        return self.last


def sit(monkeypatch: pytest.MonkeyPatch, path: Path, *ends: dict[str, Any]) -> Participant:
    """A whole sitting of P01, whose loops end one after the other as given."""
    left, page = list(ends), Participant()

    @contextlib.contextmanager
    def process(header: dict[str, Any]) -> Iterator[Loop]:
        yield Loop(header["out"], left.pop(0), page.devices)

    monkeypatch.setattr(sitting, "loop_process", process)
    monkeypatch.setattr(sitting, "start_data", lambda *given: "")
    monkeypatch.setattr(sitting, "task_page", lambda data, words: words["note"])
    monkeypatch.setattr(sitting, "quantiles", lambda latency: [])
    monkeypatch.setattr(sitting, "READING", 0.0)
    console: Any = page
    with contextlib.suppress(LoopEnded, OptionError, sitting.BrokenOff):
        asyncio.run(sitting.Sitting(DESIGN, Folder(path), "P01", console).run())
    assert left == []
    return page


def test_a_task_that_was_not_recorded_whole_is_done_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = ENDED | {"recorded_whole": False, "recorded": "nothing: the disk is full"}
    page = sit(monkeypatch, tmp_path, lost, ENDED)
    notes = Folder(tmp_path).notes("P01", 1)
    assert notes is not None
    assert (notes["attempts"], notes["finished"]) == (2, True)
    assert notes["faults"] == ["not recorded whole: nothing: the disk is full"]
    assert page.told[-1]["last"]


def test_the_notes_say_which_devices_and_which_loop_steered_the_attempt_that_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = ENDED | {"recorded_whole": False, "recorded": "nothing", "devices": ["touch"]}
    last = {"devices": ["haply", "mouse"], "priority": "real-time", "skipped": 0.125}
    sit(monkeypatch, tmp_path, lost, ENDED | last)
    notes = Folder(tmp_path).notes("P01", 1)
    assert notes is not None
    assert notes["device"] == ["mouse", "haply"]
    assert notes["loop"] == {"priority": "real-time", "skipped": 0.125}


def test_only_an_attempt_that_began_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def leaves(self: Participant, words: dict[str, Any]) -> None:
        self.told.append(words)
        if words["kind"] == "next":
            asyncio.get_running_loop().call_soon(self.said, Said("break", {}))

    Folder(tmp_path).add("P01", FEW, DESIGN)
    with monkeypatch.context() as leaving:
        leaving.setattr(Participant, "tell", leaves)
        sit(leaving, tmp_path, ENDED)
    assert Folder(tmp_path).notes("P01", 1) is None
    sit(monkeypatch, tmp_path, ENDED)
    notes = Folder(tmp_path).notes("P01", 1)
    assert notes is not None
    assert notes["attempts"] == 1


@pytest.mark.parametrize(
    ("games", "practice", "practised"), [(0, 5.0, True), (0, 0.0, False), (3, 5.0, False)]
)
def test_a_novice_practises_and_nobody_else_is_said_to_have(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    games: int,
    practice: float,
    practised: bool,
) -> None:
    monkeypatch.setattr(sitting, "checked_before", lambda values: {**FEW, "games": games})
    monkeypatch.setattr(
        "test_sitting.DESIGN", dataclasses.replace(DESIGN, practice=practice), raising=True
    )
    sit(monkeypatch, tmp_path, *([ENDED] * (1 + practised)))
    person = Folder(tmp_path).person("P01")
    assert person is not None
    assert person.practised == practised


def test_a_participant_is_told_when_the_sitting_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = sit(monkeypatch, tmp_path, {"cannot": "begin"})
    assert page.told[-1] == {
        "kind": "over",
        "title": "Something went wrong.",
        "text": "Please tell the experimenter.",
        "last": True,
    }
    assert [words.get("last") for words in page.told].count(True) == 1


def test_a_participant_of_an_order_that_the_study_has_not_is_refused_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Folder(tmp_path)
    person = folder.add("P01", dict.fromkeys(EXPERIENCE, 0), DESIGN)
    folder.keep_person(dataclasses.replace(person, row=1))
    assert sit(monkeypatch, tmp_path).told[-1]["title"] == "Something went wrong."
