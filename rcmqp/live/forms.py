"""Pages with the questions of a trial."""

from __future__ import annotations

import html
from collections.abc import Sequence
from string import Template

from rcmqp.experiments.trial.questions import (
    EXPERIENCE,
    LEVELS,
    LONGEST_COMMENT,
    RATINGS,
)
from rcmqp.show.viewer.build import asset, framed
from rcmqp.show.viewer.bundle import bundled

BREAK = '<button type="button" id="break">break off</button>'


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
    return _page("Before you begin", lead, questions)


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
    return _page("What was it like?", lead, questions)


def waiting_page() -> str:
    """What is there until the first page is; it goes on by itself."""
    return _page("One moment, please.", "", [])


def _page(title: str, lead: str, questions: Sequence[str]) -> str:
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
