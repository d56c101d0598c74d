"""Spheres that the instrument stays out of, stays in, or passes through."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

from rcmqp._kernel import Block
from rcmqp.errors import OptionError
from rcmqp.limits.base import CompiledLimit, Damper
from rcmqp.maths.options import finite, one_of, positive, rule
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Instrument, Vector3, vector3

PARTS = ("tip", "shaft")
PART = one_of("part of the instrument", PARTS)


@dataclass(frozen=True, eq=False, kw_only=True)
class SphereLimit(CompiledLimit, Damper):
    """A ball in the world, and the distance of the instrument's axis from its centre.

    A point of the axis, s in front of the effector, sees the centre c at b - s e_z with
    b = R^T (c - p); its distance delta = |b - s e_z| changes by

        delta' = u . ([b]x omega - nu + R^T c_dot),   u = (b - s e_z) / delta,

    which also holds for the nearest point of a segment, though that slides along the shaft: at
    the nearest point sliding changes nothing.

    Attributes:
        centre: (3,) of the sphere in the world, now [m].
        radius: [m].
        instrument: a capsule: its axis reaches from mount to tip, and its radius counts.
        tip_depth: from the effector to the tip, along the shaft [m].
        velocity: (3,) of the centre [m/s]. The limit knows no time: for a sphere that moves,
            make a new one each cycle (``dataclasses.replace``), or see ``on_trocar``.
        on_trocar: centre and velocity are counted from the trocar's, in the world's axes: the
            sphere moves with the patient.
        label: what to call it in messages.

    Raises:
        OptionError: a value is not allowed.
    """

    centre: Vector3 = field(metadata=rule(vector3))
    radius: float = field(metadata=positive("m"))
    instrument: Instrument
    tip_depth: float = field(metadata=finite("m"))
    velocity: Vector3 = field(default=(0.0, 0.0, 0.0), metadata=rule(vector3))
    on_trocar: bool = False
    label: str = "sphere"

    @property
    def mount_depth(self) -> float:
        """Where the shaft begins, from the effector along the shaft [m]; negative."""
        return self.tip_depth - (self.instrument.tip - self.instrument.mount_offset)

    def ball(self, kind: str, reach: float, first: float) -> Block:
        """Rows for the axis from ``first`` to the tip, ``reach`` from the centre or less [m]."""
        return Block(
            kind,
            **self.rates,
            centre=vector3("centre", self.centre),
            velocity=vector3("velocity", self.velocity),
            on_trocar=float(self.on_trocar),
            reach=reach,
            first=first,
            last=self.tip_depth,
        )

    @property
    def room(self) -> float:
        """How far the axis may be from the centre to stay inside [m].

        Raises:
            OptionError: the sphere is too small for the shaft.
        """
        room = self.radius - self.instrument.radius
        if not room > 0.0:
            raise OptionError(
                f"radius = {self.radius} m leaves no room for a shaft of radius "
                f"{self.instrument.radius} m; make the sphere larger"
            )
        return room


@dataclass(frozen=True, eq=False, kw_only=True)
class KeepOut(SphereLimit):
    """Keep the tip, or the whole shaft, out of a sphere.

    delta >= radius + instrument.radius for the tip or for the nearest point of the shaft. With
    the centre right on the axis every direction is a way out, and the effector's x is taken.

    Attributes:
        part: ``"shaft"``, from mount to tip, or ``"tip"``.
    """

    name: ClassVar[str] = "keep_out"

    part: str = field(default="shaft", metadata=PART)

    @classmethod
    def obstacles(cls, insertion: Insertion, **options: Any) -> tuple[Self, ...]:
        """One limit for each obstacle of an insertion, for tip and shaft."""
        return tuple(
            cls(
                centre=sphere.centre,
                radius=sphere.radius,
                instrument=insertion.instrument,
                tip_depth=insertion.tip_depth,
                label=f"obstacle {i}",
                **options,
            )
            for i, sphere in enumerate(insertion.obstacles, start=1)
        )

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s]."""
        first = self.mount_depth if self.part == "shaft" else self.tip_depth
        return self.ball("keep_out", self.radius + self.instrument.radius, first)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the one row."""
        return (f"{self.label}, {self.part} out",)


@dataclass(frozen=True, eq=False, kw_only=True)
class KeepIn(SphereLimit):
    """Keep the tip, or the whole shaft, in a sphere.

    delta <= radius - instrument.radius for the tip, or for both ends of the shaft: the farthest
    point of a segment is an end.

    Attributes:
        part: ``"tip"``, or ``"shaft"``, from mount to tip.
    """

    name: ClassVar[str] = "keep_in"

    part: str = field(default="tip", metadata=PART)

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s] for the tip, a second one for the mount."""
        first = self.mount_depth if self.part == "shaft" else self.tip_depth
        return self.ball("keep_in", self.room, first)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the tip, and of the mount."""
        ends = ("tip", "mount") if self.part == "shaft" else ("tip",)
        return tuple(f"{self.label}, {end} in" for end in ends)


@dataclass(frozen=True, eq=False, kw_only=True)
class EntrySphere(SphereLimit):
    """Make the shaft pass through a sphere: the trocar as a tube, not as a point.

    delta <= radius - instrument.radius for the nearest point of the shaft. The entry sphere of
    Marinho et al. 2019.

    Departures: the paper damps the squared distance of the shaft's whole line, without the
    shaft's radius; here it is the distance itself of the segment from mount to tip.
    """

    name: ClassVar[str] = "entry_sphere"

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s]."""
        return self.ball("entry_sphere", self.room, self.mount_depth)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the one row."""
        return (f"{self.label}, shaft through",)
