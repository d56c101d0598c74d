"""A hand's recorded movement on a haptic device."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterable
from dataclasses import dataclass, field

from rcmqp.errors import OptionError
from rcmqp.maths.options import options, part, rule
from rcmqp.references.hand.clutch import Clutch
from rcmqp.references.hand.mapping import HandMapping
from rcmqp.references.recorded import Recorded
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
        """A recording of a hand; see Recorded.read() for the file.

        Args:
            path: of a CSV file with the columns t, x, y, z, and ``engaged`` if there is a clutch.
            scale: metres in the file's unit of length, if its head does not name one.

        Raises:
            OptionError: the file cannot be read, or a column, unit or number is not allowed.
        """
        found = Recorded.read(path, scale=scale)
        return cls(found.times, found.positions, found.engaged)

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
