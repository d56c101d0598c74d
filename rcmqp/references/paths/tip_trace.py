"""A recorded way of the tool's tip."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import numpy as np

from rcmqp.maths.options import options, rule
from rcmqp.references.view import ViewCommand, view_of_tip
from rcmqp.world.instrument import Vector3
from rcmqp.world.motions.sampled import Sampled, sample_positions, sample_times


@options
@dataclass(frozen=True)
class TipTrace:
    """Views whose tip goes the way of a recording, from where it is at the start; without roll.

    Attributes:
        times: (n,) [s], from 0 on, growing; n >= 2.
        positions: (n, 3) of the tip in the axes of x_d(0), z into the patient [m], counted from
            anywhere: it is the way from the first one that counts.
    """

    times: tuple[float, ...] = field(metadata=rule(sample_times))
    positions: tuple[Vector3, ...] = field(metadata=rule(sample_positions))

    def __post_init__(self) -> None:
        """Check that there are as many times as positions."""
        _ = self.way

    @functools.cached_property
    def way(self) -> Sampled:
        """The recording's spline, from rest to rest."""
        return Sampled(self.times, self.positions)

    @property
    def duration(self) -> float:
        """When the recording ends [s]."""
        return self.times[-1]

    def command(self, t: float, tip_depth: float) -> ViewCommand:
        """The view whose tip is on the way at ``t`` [s].

        Raises:
            InvalidCommand: the way leaves the trocar.
        """
        start = np.array([0.0, 0.0, tip_depth])
        return view_of_tip(start + self.way.position(t), self.way.velocity(t), tip_depth)
