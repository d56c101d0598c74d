"""A measure that is shown: its name, titles, unit, meaning and format."""

from __future__ import annotations

import math
from dataclasses import dataclass

SMALL = 1e-4
"""Below it, decimal places say too little of a number."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A measure of a run, a trial or a hand, or what a controller was given.

    Attributes:
        name: its field in Metrics, Row, Outcome or HandMeasures; it ends in the unit.
        head: a short title, for a column.
        meaning: one or two sentences.
        long: a longer title, for a row or a sentence; the short one if empty.
        unit: empty for a number without a unit.
        how: which number over the time of a run: rms, max or least; empty where the label says it.
        style: format of a number where several measures stand beside each other.
        fixed: format where one measure of several runs is compared, down a row.
        nan: what a missing number is shown as.
        inf: what an infinite number is shown as.
        floor: a number below it is shown as 0.
    """

    name: str
    head: str
    meaning: str
    long: str = ""
    unit: str = ""
    how: str = ""
    style: str = ".3g"
    fixed: str = ".3g"
    nan: str = ""
    inf: str = "none"
    floor: float = -math.inf

    @property
    def label(self) -> str:
        """The long title, or the short one if there is no other."""
        return self.long or self.head

    @property
    def column(self) -> str:
        """The short title with the unit."""
        return self._with_unit(self.head)

    @property
    def row(self) -> str:
        """The long title with the unit."""
        return self.row_of(self.how)

    def row_of(self, how: str) -> str:
        """The long title with the unit, with this ``how`` in place of the measure's own."""
        return self._with_unit(f"{self.label}, {how}" if how else self.label)

    def text(self, value: float | str | None, style: str = "") -> str:
        """A value for people: a number in ``style``, or in the measure's own; yes or no."""
        if value is None or isinstance(value, str):
            return value or ""
        if isinstance(value, bool):
            return "yes" if value else "no"
        if math.isnan(value):
            return self.nan
        if math.isinf(value):
            return self.inf
        return readable(value if value >= self.floor else 0.0, style or self.style)

    def _with_unit(self, title: str) -> str:
        return f"{title} [{self.unit}]" if self.unit else title


def readable(value: float, style: str) -> str:
    """A number for people.

    One too small for decimal places has three significant digits, and one above 1000 no power.
    """
    if 1000.0 <= abs(value) < math.inf:
        return f"{value:.0f}"
    return format(value, ".3g" if 0.0 < abs(value) < SMALL else style)


def until(errors_until_s: float, duration_s: float) -> str:
    """Until when the errors count [s], for people: of how long, if the run goes on after that."""
    rest = "" if errors_until_s == duration_s else f" of {duration_s:g}"
    return f"{errors_until_s:g}{rest}"
