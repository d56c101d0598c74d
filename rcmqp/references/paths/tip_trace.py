"""A recorded way of the tool's tip."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths.options import options, rule
from rcmqp.references.view import ViewCommand, view_of_tip
from rcmqp.world.instrument import Vector3
from rcmqp.world.motions.sampled import Sampled, sample_positions, sample_times


def _rolls(name: str, values: Iterable[float]) -> tuple[float, ...]:
    rolls = tuple(map(float, values))
    if not all(map(math.isfinite, rolls)):
        raise OptionError(f"{name} must be finite numbers [rad]")
    return rolls


@options
@dataclass(frozen=True)
class TipTrace:
    """Views whose tip goes the way of a recording, from where it is at the start.

    Attributes:
        times: (n,) [s], from 0 on, growing; n >= 2.
        positions: (n, 3) of the tip in the axes of x_d(0), z into the patient [m], counted from
            anywhere: it is the way from the first one that counts.
        rolls: (n,) rotation about the shaft, gamma of ViewCommand [rad], counted likewise; empty
            for none.
    """

    times: tuple[float, ...] = field(metadata=rule(sample_times))
    positions: tuple[Vector3, ...] = field(metadata=rule(sample_positions))
    rolls: tuple[float, ...] = field(default=(), metadata=rule(_rolls))

    def __post_init__(self) -> None:
        """Check that there are as many of each."""
        _ = self.way
        if self.rolls and len(self.rolls) != len(self.times):
            raise OptionError(
                f"{len(self.times)} times and {len(self.rolls)} rolls; one each, or none"
            )

    @functools.cached_property
    def way(self) -> Sampled:
        """The recording's spline, from rest to rest."""
        return Sampled(self.times, self.positions)

    @functools.cached_property
    def _turn(self) -> Sampled:
        """The roll's spline, as the first coordinate."""
        return Sampled(self.times, tuple((roll, 0.0, 0.0) for roll in self.rolls))

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
        view = view_of_tip(start + self.way.position(t), self.way.velocity(t), tip_depth)
        if not self.rolls:
            return view
        gamma, gamma_dot = self._turn.position(t)[0], self._turn.velocity(t)[0]
        return dataclasses.replace(view, gamma=float(gamma), gamma_dot=float(gamma_dot))
