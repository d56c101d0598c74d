"""A path of somebody's own, where only its numbers are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rcmqp.errors import OptionError
from rcmqp.references.view import ViewCommand


@dataclass(frozen=True, slots=True)
class Foreign:
    """What a file says of a path whose class this process does not have.

    A run along it can be looked at; it cannot be run again before its class is in PATHS, by this
    program or by a plug-in.

    Attributes:
        kind: its name in PATHS, where the run was made.
        numbers: its fields.
    """

    kind: str
    numbers: Mapping[str, Any]

    @property
    def duration(self) -> float:
        """How long the path takes [s], as far as is known."""
        return float(self.numbers.get("duration", 0.0))

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """Nothing can be asked.

        Raises:
            OptionError: always.
        """
        raise OptionError(
            f"this process does not know the path {self.kind!r}, so it cannot be run; add its "
            "class to rcmqp.references.paths.PATHS, or install the plug-in that has it, as where "
            "the scenario was made"
        )
