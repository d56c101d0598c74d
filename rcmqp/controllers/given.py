"""The inputs and limits that a controller uses, which a reader needs to compare two."""

from __future__ import annotations

import dataclasses
import json
import re
from dataclasses import dataclass
from typing import Self

JOINT_LIMITS = ("position", "speed", "acceleration", "jerk")
"""Limits of an arm's joints that a law may enforce."""

NOT_SAID = "not said"
"""Stands in a table for what a controller, or a run's file of an earlier version, does not say."""

LAW_FILE = re.compile(r"([^/\\\x00-\x1f\x7f]{1,200}\.py:[^\W\d]\w{0,100})?")
"""Given.file; no folder is in it."""

_WORDS = {True: "yes", False: "no", None: NOT_SAID}


@dataclass(frozen=True, slots=True)
class Given:
    """Inputs and limits that a controller uses; period and the arm's limits are the scenario's.

    Attributes:
        feed_forward: whether the law knows the velocities of the reference and of the trocar;
            None if the controller does not say.
        limits: which of JOINT_LIMITS the law enforces; None if the controller does not say.
        way: how it enforces them, if not as bounds of an optimum.
        gain: K [1/s]; None if the controller has no single one.
        roll: whether the law controls the instrument's roll about its shaft; None if the
            controller does not say.
        objective: what its redundant joints are for, if not the arm's own objective: the name of
            one, or "none"; empty for the arm's own.
        file: FILE.py:CLASS of a law in a Python file, without its folder; empty for others.
    """

    feed_forward: bool | None = None
    limits: tuple[str, ...] | None = None
    way: str = ""
    gain: float | None = None
    roll: bool | None = None
    objective: str = ""
    file: str = ""

    @property
    def roll_text(self) -> str:
        """``yes``, ``no`` or NOT_SAID."""
        return _WORDS[self.roll]

    @property
    def feed_forward_text(self) -> str:
        """``yes``, ``no`` or NOT_SAID."""
        return _WORDS[self.feed_forward]

    @property
    def limits_text(self) -> str:
        """``all``, ``none``, NOT_SAID, or the limits' names."""
        if self.limits is None:
            return NOT_SAID
        if set(self.limits) == set(JOINT_LIMITS):
            return "all"
        return " ".join(filter(None, (" and ".join(self.limits) or "none", self.way)))

    @property
    def gain_text(self) -> str:
        """The gain, or NOT_SAID."""
        return NOT_SAID if self.gain is None else f"{self.gain:g}"

    def to_json(self) -> str:
        """As a run's file keeps it."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read what to_json() wrote.

        Raises:
            ValueError: a value is not one that to_json() writes.
        """
        try:
            data = json.loads(text)
            limits = data.pop("limits")
            given = cls(**data, limits=None if limits is None else tuple(limits))
            unknown = set(given.limits or ()) - set(JOINT_LIMITS)
        except (AttributeError, KeyError, TypeError, RecursionError) as error:
            raise ValueError(f"not what to_json() writes: {error}") from error
        for name, value in (("feed_forward", given.feed_forward), ("roll", given.roll)):
            if not (value is None or isinstance(value, bool)):
                raise ValueError(f"{name} = {value!r:.50} must be true or false")
        if unknown:
            raise ValueError(f"limits: {min(unknown, key=str)!r:.50} is not one of {JOINT_LIMITS}")
        for name, text in (("way", given.way), ("objective", given.objective)):
            if not isinstance(text, str) or len(text) > 1000:
                raise ValueError(f"{name} must be a text of 1000 letters at most")
        if not isinstance(given.file, str) or not LAW_FILE.fullmatch(given.file):
            raise ValueError(f"file = {given.file!r:.50} must be FILE.py:CLASS")
        if type(given.gain) not in (int, float, type(None)):
            raise ValueError(f"gain = {given.gain!r:.50} must be a number")
        return given


UNKNOWN = Given()
"""Of a controller, or a run's file, that does not say."""
