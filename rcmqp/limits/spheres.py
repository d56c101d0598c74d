"""What limits with a sphere have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rcmqp._kernel import Block
from rcmqp.errors import OptionError, UnknownName
from rcmqp.limits.base import CompiledLimit, Damper
from rcmqp.tasks.base import check_finite, check_positive
from rcmqp.world.instrument import MOST_JOINTS, Instrument, Vector3, Wrist, vector3

PARTS = ("tip", "shaft")


@dataclass(frozen=True, eq=False, kw_only=True)
class SphereLimit(CompiledLimit, Damper):
    """A ball in the world, and the distance of the instrument's axis from its centre.

    A point of the axis, s in front of the effector, sees the centre c at b - s e_z with
    b = R^T (c - p); its distance delta = |b - s e_z| changes by

        delta' = u . ([b]x omega - nu + R^T c_dot),   u = (b - s e_z) / delta,

    which also holds for the nearest point of a segment, though that slides along the shaft: at
    the nearest point sliding changes nothing. Of a wrist's pieces each has a row of its own, for
    its nearest point q in the effector's axes: u = (b - q) / delta, and its joints add - u . q'.

    Attributes:
        centre: (3,) of the sphere in the world, now [m].
        radius: [m].
        instrument: a capsule: its axis reaches from mount to tip, along the shaft and then the
            pieces of the wrist, as bent as it is; its radius counts.
        tip_depth: from the effector to the tip, along the shaft [m]; with a straight wrist.
        velocity: (3,) of the centre [m/s]. The limit knows no time: for a sphere that moves,
            make a new one each cycle (``dataclasses.replace``), or see ``on_trocar``.
        on_trocar: centre and velocity are counted from the trocar's, in the world's axes: the
            sphere moves with the patient.
        label: what to call it in messages.

    Raises:
        OptionError: a value is not allowed.
    """

    centre: Vector3
    radius: float
    instrument: Instrument
    tip_depth: float
    velocity: Vector3 = (0.0, 0.0, 0.0)
    on_trocar: bool = False
    label: str = "sphere"

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        check_positive("radius", self.radius, "m")
        check_finite("tip_depth", self.tip_depth, "m")
        for name in ("centre", "velocity"):
            vector3(name, getattr(self, name))

    @property
    def mount_depth(self) -> float:
        """Where the shaft begins, from the effector along the shaft [m]; negative."""
        return self.tip_depth - (self.instrument.tip - self.instrument.mount_offset)

    @property
    def shaft_depth(self) -> float:
        """Where the shaft ends, from the effector [m]; the tip, or the first joint of a wrist."""
        return shaft_depth(self.instrument.wrist, self.tip_depth)

    def pieces(self) -> tuple[str, ...]:
        """The joint that each piece of the wrist begins at; pieces without length are none."""
        wrist = self.instrument.wrist
        if wrist is None:
            return ()
        pairs = zip(wrist.joints, wrist.pieces, strict=True)
        return tuple(joint.name for joint, length in pairs if length > 0.0)

    def ball(self, kind: str, reach: float, first: float, **wrist: Any) -> Block:
        """Rows for the axis from ``first`` on, ``reach`` from the centre or less [m]."""
        return Block(
            kind,
            **self.rates,
            centre=vector3("centre", self.centre),
            velocity=vector3("velocity", self.velocity),
            on_trocar=float(self.on_trocar),
            reach=reach,
            first=first,
            last=self.shaft_depth,
            **wrist,
        )

    @property
    def room(self) -> float:
        """How far the axis may be from the centre to stay inside [m]."""
        return self.radius - self.instrument.radius

    def check_room(self) -> None:
        """Check that the shaft fits in.

        Raises:
            OptionError: the sphere is too small for it.
        """
        if not self.room > 0.0:
            raise OptionError(
                f"radius = {self.radius} m leaves no room for a shaft of radius "
                f"{self.instrument.radius} m; make the sphere larger"
            )


def shaft_depth(wrist: Wrist | None, tip_depth: float) -> float:
    """From the effector to the first joint of a wrist, or to the tip without one [m]."""
    return tip_depth if wrist is None else tip_depth - sum(wrist.pieces)


def bends(wrist: Wrist | None) -> dict[str, Any]:
    """The options of a Block that knows a wrist: how many joints, and the numbers of each."""
    table = np.zeros((MOST_JOINTS, 4))
    if wrist is None:
        return {"wrist": table.ravel(), "bends": 0.0}
    for row, joint, length in zip(table, wrist.joints, wrist.pieces, strict=False):
        row[:] = *joint.axis, length
    return {"wrist": table.ravel(), "bends": float(len(wrist.joints))}


def check_part(part: str) -> None:
    """Check which part of the instrument a limit is for.

    Raises:
        UnknownName: it is none of PARTS.
    """
    if part not in PARTS:
        raise UnknownName("part of the instrument", part, PARTS)
