"""Recorded paths: of a hand on a haptic device, of the tool's tip."""

from __future__ import annotations

import dataclasses
import functools
import math
import os
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths.options import options, part, rule
from rcmqp.references.hand import Clutch, HandMapping
from rcmqp.references.view import ViewCommand, view_of_tip
from rcmqp.world.instrument import Vector3
from rcmqp.world.motions import Sampled, sample_positions, sample_times
from rcmqp.world.recorded import Recorded


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
        recording = Recorded.read(path, scale=scale)
        return cls(recording.times, recording.positions, recording.engaged)

    @functools.cached_property
    def way(self) -> Sampled:
        """The part of the handle's motion that counts."""
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
