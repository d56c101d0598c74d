"""Pages of the console and of a trial: the scene, and the questions."""

from __future__ import annotations

import dataclasses
import html
import json
from collections.abc import Sequence
from string import Template
from typing import Any

from rcmqp.controllers import make_controller
from rcmqp.experiments.trial.questions import (
    EXPERIENCE,
    LEVELS,
    LONGEST_COMMENT,
    RATINGS,
)
from rcmqp.references.paths import Search
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import simulate
from rcmqp.show.viewer.build import asset, framed, library, page_data
from rcmqp.show.viewer.bundle import bundled
from rcmqp.world.insertion import Insertion
from rcmqp.world.loading import arm_title

BREAK = '<button type="button" id="break">break off</button>'


def page(scenario: Scenario, controller: str, options: dict[str, Any]) -> str:
    """The console's page of a scenario whose arm is at its start; it needs no other file.

    Args:
        scenario: arm, trocar, and what there is to be seen.
        controller: its name.
        options: of the controller.
    """
    title = f"{scenario.name} on {arm_title(scenario.arm)}, live"
    return _page(title, controller, start_data(scenario, controller, options), None)


def task_page(data: str, words: dict[str, Any]) -> str:
    """The page of a task or practice.

    Args:
        data: see start_data().
        words: title, instructions, seconds, note, and those of task_words(); see task.js.
    """
    return _page(words["title"], "", data, words)


def start_data(scenario: Scenario, controller: str, options: dict[str, Any]) -> str:
    """The arm at its start and all around it, as a page has it; it takes some seconds to make."""
    short = dataclasses.replace(scenario, duration=scenario.period)
    insertion = short.insertion()
    start = simulate(short, make_controller(controller, insertion, short.period, **options))
    deepest = min(scenario.instrument.length, scenario.trocar.depth_range[1])
    return page_data([start], ["arm"], insertion, deepest=deepest)


def task_words(task: Search, insertion: Insertion) -> dict[str, Any]:
    """What the page of a task needs to know of it."""
    from rcmqp.show.viewer.scene import camera_moves  # meshcat takes long to import

    return {"views": camera_moves(task.places, insertion), "instructions": task.instructions}


def before_page(consent: str) -> str:
    """The questions before the task, under the text of consent if there is one."""
    questions = [
        _choices(name, f"How much experience do you have with {about}?", LEVELS, first=0)
        for name, about in EXPERIENCE.items()
    ]
    lead = "<p>No name is asked for, and all that you answer stays on this computer.</p>"
    if consent:
        lead += f'<div class="consent" tabindex="0">{html.escape(consent)}</div>'
    said = "I have read this and agree to take part." if consent else "I agree to take part."
    questions.append(f'<label><input type="checkbox" name="consent"> {said}</label>')
    return _form("Before you begin", lead, questions)


def after_page(number: int, count: int) -> str:
    """The questions after a task, which was one of ``count``."""
    questions = [
        _choices(name, asked, answers, first=1) for name, (asked, answers) in RATINGS.items()
    ]
    questions.append(
        "<fieldset><legend>Is there anything that you want to say?</legend>"
        f'<textarea name="comment" maxlength="{LONGEST_COMMENT}"></textarea></fieldset>'
    )
    lead = f"<p>About task {number} of {count}, which you have just ended.</p>"
    return _form("What was it like?", lead, questions)


def waiting_page() -> str:
    """What is there until the first page is; it goes on by itself."""
    return _form("One moment, please.", "", [])


def _page(title: str, subtitle: str, data: str, task: dict[str, Any] | None) -> str:
    body = Template(asset("live.html")).substitute(
        title=html.escape(title),
        subtitle=html.escape(subtitle),
        meshcat=library("meshcat", "viewer/dist/main.min.js"),
        data=data,
        task=json.dumps(task).replace("<", "\\u003c"),
        script=bundled("live.js", asset),
    )
    return framed(title, asset("page.css") + asset("live.css") + asset("task.css"), body)


def _form(title: str, lead: str, questions: Sequence[str]) -> str:
    go_on = f'{BREAK}<button type="submit">go on</button>'
    body = Template(asset("form.html")).substitute(
        title=title,
        lead=lead,
        questions="\n    ".join(questions),
        buttons=go_on if questions else "",
        script=bundled("form.js", asset),
    )
    return framed(title, asset("page.css") + asset("task.css"), body)


def _choices(name: str, asked: str, answers: Sequence[str], *, first: int) -> str:
    boxes = "".join(
        f'<label><input type="radio" name="{name}" value="{i}" required> '
        f"{html.escape(text)}</label>"
        for i, text in enumerate(answers, first)
    )
    return f"<fieldset><legend>{html.escape(asked)}</legend>{boxes}</fieldset>"
