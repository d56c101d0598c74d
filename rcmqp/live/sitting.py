"""One participant at the console: questions, practice, tasks, one after the other."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

from rcmqp.errors import OptionError, RcmqpError
from rcmqp.experiments.study.plan import Law
from rcmqp.experiments.trial.design import Design, orders
from rcmqp.experiments.trial.people import Folder, Person
from rcmqp.experiments.trial.questions import checked_after, checked_before
from rcmqp.live.loop_process import LoopProcess, at_rest, loop_process
from rcmqp.live.messages import DEVICES, Said
from rcmqp.live.page import after_page, before_page, start_data, task_page, task_words
from rcmqp.live.server import Console
from rcmqp.live.session import quantiles
from rcmqp.realtime.latency import LatencyCounter
from rcmqp.references.operators import GROUPS
from rcmqp.references.paths import Search

PRACTICE = (
    "Move the camera as you like, to get used to it. It moves only while you hold a mouse button, "
    "a finger or a key down."
)
"""What a novice reads during the practice."""

AGAIN = "The arm has stopped by itself. Please begin this part again."
"""What a participant reads whose loop ended before its time."""

LOST = (
    "What you did could not be kept. Please tell the experimenter, and then begin this part again."
)
"""What a participant reads whose run was not recorded whole."""

READING = 1.5
"""How long a participant reads that a task is over, and lets go of the picture [s]."""

WAITING = 20
"""What a participant says, and nobody has heard yet, at most."""

T = TypeVar("T")


class BrokenOff(RcmqpError):
    """The participant breaks off, and can go on later."""


class Sitting:
    """Leads a participant through what is left of the study.

    Each step ends with files, so a sitting that is broken off goes on with the next one. A task
    that is broken off is done again from its beginning; ``attempts`` counts those that began.
    """

    def __init__(self, design: Design, folder: Folder, identifier: str, console: Console) -> None:
        """For one participant; ``console`` serves the pages."""
        self._design, self._folder, self._id, self._console = design, folder, identifier, console
        self._heard: asyncio.Queue[Said] = asyncio.Queue(WAITING)
        self._data: asyncio.Task[str] | None = None  # of the pages, the same for all tasks
        console.said = self._hear

    def _hear(self, said: Said) -> None:
        with contextlib.suppress(asyncio.QueueFull):
            self._heard.put_nowait(said)

    async def run(self) -> None:
        """All that is left.

        Raises:
            BrokenOff: the participant breaks off.
            RcmqpError: a loop cannot begin, or a file is damaged or cannot be written.
        """
        try:
            await self._lead()
        except BrokenOff:
            again = "Please tell the experimenter. You can go on later."
            self._over("You have broken off.", again, last=True)
            raise
        except RcmqpError:
            self._over("Something went wrong.", "Please tell the experimenter.", last=True)
            raise
        self._over("Thank you!", "This was all. Please tell the experimenter.", last=True)

    async def _lead(self) -> None:
        """All that is left, one after the other."""
        laws = self._design.laws
        law, scenario = laws[0], self._design.made(laws[0])
        self._data = asyncio.create_task(
            asyncio.to_thread(start_data, scenario, law.name, dict(law.options))
        )
        person = await self._before()
        rows = orders(len(laws))
        if person.row >= len(rows):
            raise OptionError(
                f"{self._id} has the order number {person.row} of the controllers, there are only "
                f"{len(rows)}, from 0; delete the participant with rcmqp trial --delete"
            )
        order = rows[person.row]
        novice = person.group == GROUPS[0]
        if novice and self._design.practice and not person.practised:
            await self._practise(person, laws[order[0]])
        for number, k in enumerate(order, 1):
            await self._do(number, laws[k])
            await self._after(number)

    def _over(self, title: str, text: str = "One moment, please.", *, last: bool = False) -> None:
        """Tell the participant that a part is over; after the last one the server may go."""
        self._console.tell({"kind": "over", "title": title, "text": text, "last": last})

    def _show(self, text: str) -> None:
        """Let the pages go on with another one."""
        while not self._heard.empty():
            self._heard.get_nowait()
        self._console.page = text
        self._console.tell({"kind": "next"})

    async def _ask(self, text: str, check: Callable[[dict[str, Any]], T]) -> T:
        """Show questions until the answers pass a check."""
        self._show(text)
        while True:
            said = await self._heard.get()
            if said.kind == "break":
                raise BrokenOff(f"{self._id} breaks off at the questions")
            if said.kind != "answers":
                continue
            try:
                answers = check(dict(said.values))
            except OptionError as error:
                self._console.tell({"kind": "refused", "why": str(error)})
                continue
            self._over("Thank you.")
            return answers

    async def _before(self) -> Person:
        """The participant, who answers the questions before, if that was not done."""
        person = self._folder.person(self._id)
        if person is not None:
            return person
        answers = await self._ask(before_page(self._design.consent), checked_before)
        return self._folder.add(self._id, answers, self._design)

    async def _practise(self, person: Person, law: Law) -> None:
        """Practice of a novice, with the controller that comes first."""
        seconds = self._design.practice
        words = {"title": "Practice", "instructions": PRACTICE, "seconds": seconds}
        while True:
            last = await self._steer(law, words, practice=True, duration=seconds, out=None)
            if not _fault(last):
                self._over("The practice is over.")
                break
            words["note"] = AGAIN
        self._folder.keep_person(dataclasses.replace(person, practised=True))

    async def _do(self, number: int, law: Law) -> None:
        """A task, again and again until it has not been broken off."""
        task, count = self._design.task, len(self._design.laws)
        notes = self._folder.notes(self._id, number) or {
            "condition": str(law),
            "law": law.to_json(),
            "number": number,
            "attempts": 0,
            "faults": [],
            "finished": None,
            "answers": None,
        }
        title = f"Task {number} of {count}" if count > 1 else "The task"
        words = {"title": title, "instructions": task.instructions, "seconds": 0.0}

        def begins() -> None:
            notes["attempts"] += 1
            self._folder.keep_notes(self._id, number, notes)
            self._folder.forget_run(self._id, number)

        while notes["finished"] is None:
            self._console.drawn = LatencyCounter()
            out = str(self._folder.run_file(self._id, number))
            last = await self._steer(law, words, begins, duration=task.duration, out=out)
            if fault := _fault(last):
                notes["faults"].append(fault)
                words["note"] = LOST if last.get("recorded_whole") is False else AGAIN
                continue
            notes["finished"] = len(last["reached"]) == len(task.places)
            self._over("All pictures are found." if notes["finished"] else "The time is over.")
            notes["device"] = [name for name in DEVICES if name in self._console.devices]
            notes["reached_s"] = last["reached"]
            notes["latency_s"] = last["latency"] | {
                "picture": quantiles(self._console.drawn.latency())
            }
            notes["loop"] = {name: last[name] for name in ("priority", "skipped")}
            self._folder.keep_notes(self._id, number, notes)
            await asyncio.sleep(READING)

    async def _after(self, number: int) -> None:
        """The questions after a task, if they are not answered."""
        notes = self._folder.notes(self._id, number)
        assert notes is not None
        if notes["answers"] is None:
            text = after_page(number, len(self._design.laws))
            notes["answers"] = await self._ask(text, checked_after)
            self._folder.keep_notes(self._id, number, notes)

    async def _steer(
        self,
        law: Law,
        words: dict[str, Any],
        begins: Callable[[], None] = lambda: None,
        *,
        practice: bool = False,
        **header: Any,
    ) -> dict[str, Any]:
        """A loop, from its start by the participant to its end; its last words.

        ``begins`` is called when the participant has said start.

        Raises:
            BrokenOff: the participant breaks off; the arm is at rest.
            LoopEnded: it cannot begin.
            RcmqpError: the page cannot be made.
        """
        assert self._data is not None
        design, scenario = self._design, self._design.made(law)
        task = scenario.path
        assert isinstance(task, Search)
        words = {"note": "", **task_words(task, scenario.insertion()), **words}
        header |= {
            "scenario": scenario.to_json(carry=True),
            "controller": design.setting(law),
            "options": dict(law.options),
            "hand": {"scale": design.scale, "viscosity": design.viscosity},
            "practice": practice,
        }
        with loop_process(header) as loop:
            text, _ = await asyncio.gather(self._data, asyncio.to_thread(loop.prepare))
            before = self._console.turn(loop.channel)
            try:
                self._show(task_page(text, words))
                while (said := await self._heard.get()).kind != "start":
                    if said.kind == "break":
                        raise BrokenOff(f"{self._id} breaks off before a start")
                begins()
                self._console.devices.clear()
                loop.start()
                return await self._until_the_end(loop)
            finally:
                self._console.turn(before)

    async def _until_the_end(self, loop: LoopProcess) -> dict[str, Any]:
        """Wait for a loop's last words, or until the participant breaks off."""
        last = asyncio.create_task(asyncio.to_thread(loop.last_words))
        leaving = asyncio.create_task(self._leaves())
        try:
            await asyncio.wait({last, leaving}, return_when=asyncio.FIRST_COMPLETED)
        finally:  # also when the server ends: the arm comes to rest, and the file is whole
            leaving.cancel()
            words = await at_rest(loop, last)
        if leaving.done() and not leaving.cancelled():
            raise BrokenOff(f"{self._id} breaks off in a task or practice")
        return words

    async def _leaves(self) -> None:
        """Wait until the participant breaks off."""
        while (await self._heard.get()).kind != "break":
            pass


def _fault(last: dict[str, Any]) -> str:
    """Why a loop ended before its time, or was not recorded whole; empty if all is well."""
    if found := last.get("error") or last["fault"]:
        return str(found)
    return "" if last["recorded_whole"] else f"not recorded whole: {last['recorded']}"
