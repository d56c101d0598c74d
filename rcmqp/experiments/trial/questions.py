"""The questions of experiment B: before the task, which decide the group, and after it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rcmqp.errors import OptionError
from rcmqp.references.operators import GROUPS

EXPERIENCE = {
    "laparoscopy": "laparoscopic procedures",
    "simulators": "surgical simulators",
    "haptics": "haptic devices",
    "games": "computer games with a controller",
}
"""What a participant is asked about before the task: how much experience."""

LEVELS = ("none", "once or twice", "now and then", "often")
"""Answers to it, 0 to 3."""

EASE = ("very difficult", "difficult", "easy", "very easy")
FOLLOWED = ("very bad", "bad", "good", "very good")
RATINGS = {
    "ease": ("How easy was the task?", EASE),
    "followed": ("How well did the camera follow the movements of your hand?", FOLLOWED),
}
"""What a participant is asked after the task, and the answers, 1 to 4, as in the paper."""

LONGEST_COMMENT = 500
"""Letters of a comment."""


def group_of(before: Mapping[str, int]) -> str:
    """Novice if every answer about EXPERIENCE is "none", as in the paper; else experienced."""
    return GROUPS[1] if any(before.values()) else GROUPS[0]


def checked_before(values: Mapping[str, Any]) -> dict[str, int]:
    """Check the answers to the questions before the task, and return them.

    Args:
        values: by name, as they came from a page; ``consent`` among them, which is needed.

    Raises:
        OptionError: an answer is missing, unknown or not allowed, or consent was not given.
    """
    _check_names(values, {*EXPERIENCE, "consent"})
    if values["consent"] is not True:
        raise OptionError("nobody takes part without consent: it must be given first")
    return {name: _choice(name, values[name], 0, len(LEVELS) - 1) for name in EXPERIENCE}


def checked_after(values: Mapping[str, Any]) -> dict[str, Any]:
    """Check the answers to the questions after the task, and return them.

    Raises:
        OptionError: an answer is missing, not allowed or unknown.
    """
    _check_names(values, {*RATINGS, "comment"})
    comment = values["comment"]
    if not isinstance(comment, str) or len(comment) > LONGEST_COMMENT:
        raise OptionError(f"the comment must be a text of at most {LONGEST_COMMENT} letters")
    answers: dict[str, Any] = {name: _choice(name, values[name], 1, 4) for name in RATINGS}
    text = comment.encode("utf-8", "replace").decode()  # a lone surrogate is not UTF-8
    return answers | {"comment": text.strip()}


def _check_names(values: Mapping[str, Any], names: set[str]) -> None:
    if values.keys() != names:
        raise OptionError(
            f"there are answers to {sorted(values)}, the questions are {sorted(names)}"
        )


def _choice(name: str, value: Any, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise OptionError(f"{name} = {value!r:.50}, it must be a whole number {least} to {most}")
    return value
