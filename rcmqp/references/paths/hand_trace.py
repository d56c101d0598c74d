"""A hand's recorded movement on a haptic device."""

from __future__ import annotations

import csv
import functools
import os
from collections.abc import Iterable
from dataclasses import dataclass, field

from rcmqp.errors import OptionError
from rcmqp.maths.options import options, part, rule
from rcmqp.references.hand.clutch import Clutch
from rcmqp.references.hand.mapping import HandMapping
from rcmqp.references.view import ViewCommand
from rcmqp.world.instrument import Vector3
from rcmqp.world.motions.sampled import Sampled, sample_positions, sample_times


def _engaged(name: str, values: Iterable[bool]) -> tuple[bool, ...]:
    values = tuple(values)
    if wrong := [value for value in values if value not in (0, 1)]:
        raise OptionError(f"{name}: {wrong[0]!r}, each must be true or false")
    return tuple(map(bool, values))


@options
@dataclass(frozen=True)
class HandTrace:
    """Views as a hand asked for them, whatever the camera showed.

    Between its samples the way that counts is Sampled's spline, from rest to rest.

    Attributes:
        times: (n,) [s], from 0 on, growing; n >= 2.
        positions: (n, 3) of the handle [m], see DeviceState.
        engaged: (n,) whether the handle drove the camera; empty for always.
        mapping: from the hand's way to the view.
    """

    times: tuple[float, ...] = field(metadata=rule(sample_times))
    positions: tuple[Vector3, ...] = field(metadata=rule(sample_positions))
    engaged: tuple[bool, ...] = field(default=(), metadata=rule(_engaged))
    mapping: HandMapping = field(default_factory=HandMapping, metadata=part(HandMapping))

    def __post_init__(self) -> None:
        """Check that there are as many of each."""
        samples = Sampled(self.times, self.positions)
        if self.engaged and len(self.engaged) != len(samples.times):
            raise OptionError(
                f"engaged: {len(self.engaged)} for {len(samples.times)} samples; one each, or none"
            )

    @classmethod
    def read_csv(cls, path: str | os.PathLike[str], *, scale: float = 1.0) -> HandTrace:
        """A recording of positions over time.

        The file has a head with the columns ``t`` (or ``time``) [s], ``x``, ``y``, ``z`` [m],
        in any order, and may have ``engaged`` (0 or 1); other columns, and lines that begin
        with #, are left out. Times count from the first one.

        Args:
            path: the file.
            scale: metres in its unit of length; 1e-3 for a file in mm.

        Raises:
            OptionError: the file cannot be read, a column is missing or a number is none.
        """
        try:
            with open(path, encoding="utf-8-sig", newline="") as stream:
                rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise OptionError(f"{path} cannot be read: {error}") from error
        table = [{str(k).strip().lower(): v for k, v in each.items()} for each in rows]
        names = set(table[0]) if table else set()
        clock = "time" if "time" in names else "t"
        if missing := {clock, "x", "y", "z"} - names:
            raise OptionError(
                f"{path} has no {', '.join(sorted(missing))}; the first line must name the "
                "columns t, x, y, z, and one sample follow on each line"
            )
        try:
            times = [float(each[clock]) for each in table]
            points = [tuple(scale * float(each[axis]) for axis in "xyz") for each in table]
            engaged = [bool(float(each["engaged"])) for each in table if "engaged" in each]
        except (TypeError, ValueError) as error:
            raise OptionError(f"{path} has a line that is not numbers: {error}") from error
        return cls(tuple(t - times[0] for t in times), tuple(points), tuple(engaged))  # type: ignore[arg-type]

    @functools.cached_property
    def way(self) -> Sampled:
        """What counts of the handle's way."""
        clutch, engaged = Clutch(), self.engaged or (True,) * len(self.times)
        return Sampled(self.times, tuple(map(clutch.step, self.positions, engaged)))

    @property
    def duration(self) -> float:
        """When the trace ends [s]."""
        return self.times[-1]

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view that the hand asked for at ``t`` [s]."""
        x, y, z = map(float, self.way.position(t))
        u, v, w = map(float, self.way.velocity(t))
        return self.mapping.view((x, y, z), (u, v, w), tip_depth)
