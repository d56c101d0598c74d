"""Limits on where the instrument is: the trocar's cone and depth range, and spheres."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from rcmqp._kernel import Block
from rcmqp.errors import OptionError
from rcmqp.limits.base import CompiledLimit, Damper
from rcmqp.maths.options import one_of, positive, rule
from rcmqp.world.insertion import Insertion, filled_in
from rcmqp.world.instrument import MOST_JOINTS, Instrument, Trocar, Vector3, Wrist, vector3

PARTS = ("tip", "shaft")
PART = one_of("part of the instrument", PARTS)


@dataclass(frozen=True, eq=False, kw_only=True)
class SphereLimit(CompiledLimit, Damper):
    """A ball in the world, and the distance of the instrument's axis from its centre.

    A point of the axis, s in front of the effector, sees the centre c at b - s e_z with
    b = R^T (c - p); its distance delta = |b - s e_z| changes by

        delta' = u . ([b]x omega - nu + R^T c_dot),   u = (b - s e_z) / delta,

    which also holds for the nearest point of a segment, though that slides along the shaft: at
    the nearest point sliding changes nothing. To go about the centre leads away from it: this part
    of the bend counts for a sphere to stay in, and not for one to keep out of, since it ends when
    the shaft slows down. Of a wrist's pieces each has a row of its own, for its nearest point q in
    the effector's axes: u = (b - q) / delta, and its joints add - u . q'.

    Attributes:
        centre: (3,) of the sphere in the world, now [m].
        radius: [m].
        instrument: a capsule: its axis reaches from mount to tip, along the shaft and then the
            pieces of the wrist, as bent as it is; its radius counts.
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
    velocity: Vector3 = field(default=(0.0, 0.0, 0.0), metadata=rule(vector3))
    on_trocar: bool = False
    label: str = "sphere"

    @property
    def mount(self) -> float:
        """Where the shaft begins, from the tip of a straight instrument [m]; negative."""
        return self.instrument.mount_offset - self.instrument.tip

    def ball(self, kind: str, reach: float, *, whole: bool) -> Block:
        """Rows for the tip or the ``whole`` axis, ``reach`` from the centre or less [m]."""
        wrist = bends(self.instrument.wrist)
        return Block(
            kind,
            **self.rates,
            centre=vector3("centre", self.centre),
            velocity=vector3("velocity", self.velocity),
            on_trocar=float(self.on_trocar),
            reach=reach,
            first=self.mount if whole else wrist["last"],
            **wrist,
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


def pieces(wrist: Wrist | None) -> tuple[str, ...]:
    """The joint that each piece of a wrist begins at; pieces without length are none."""
    if wrist is None:
        return ()
    pairs = zip(wrist.joints, wrist.pieces, strict=True)
    return tuple(joint.name for joint, length in pairs if length > 0.0)


def bends(wrist: Wrist | None) -> dict[str, Any]:
    """The options of a Block that knows a wrist: how many joints, and the numbers of each.

    ``last`` is where the shaft ends, from the straight tip.
    """
    table = np.zeros((MOST_JOINTS, 4))
    if wrist is None:
        return {"last": 0.0, "wrist": table.ravel(), "bends": 0.0}
    for row, joint, length in zip(table, wrist.joints, wrist.pieces, strict=False):
        row[:] = *joint.axis, length
    return {
        "last": -sum(wrist.pieces),
        "wrist": table.ravel(),
        "bends": float(len(wrist.joints)),
    }


@dataclass(frozen=True, eq=False, kw_only=True)
class KeepOut(SphereLimit):
    """Keep the tip, or the whole instrument, out of a sphere.

    delta >= radius + instrument.radius for the tip, or for the nearest point of the shaft and of
    each piece of a wrist. With the centre right on the axis every direction is a way out, and the
    effector's x is taken.

    Attributes:
        part: ``"shaft"``, from mount to tip, with a wrist's pieces; or ``"tip"``.
    """

    name: ClassVar[str] = "keep_out"

    part: str = field(default="shaft", metadata=PART)

    @classmethod
    def obstacles(cls, insertion: Insertion, **options: Any) -> tuple[Self, ...]:
        """One limit for each obstacle of an insertion, for tip and shaft."""
        limits = []
        for i, sphere in enumerate(insertion.obstacles, start=1):
            given = {"centre": sphere.centre, "radius": sphere.radius, "label": f"obstacle {i}"}
            limits.append(cls(**filled_in(cls, insertion, given | options)))
        return tuple(limits)

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s]; with a wrist, one more for each of its pieces."""
        reach = self.radius + self.instrument.radius
        return self.ball("keep_out", reach, whole=self.part == "shaft")

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names for the tip, or for the shaft and each piece of a wrist, by its first joint."""
        beyond = pieces(self.instrument.wrist) if self.part == "shaft" else ()
        return tuple(f"{self.label}, {part} out" for part in (self.part, *beyond))


@dataclass(frozen=True, eq=False, kw_only=True)
class KeepIn(SphereLimit):
    """Keep the tip, or the whole instrument, in a sphere.

    delta <= radius - instrument.radius for the tip, or for both ends of the shaft and of each
    piece of a wrist: the farthest point of a segment is an end.

    Attributes:
        part: ``"tip"``, or ``"shaft"``, from mount to tip, with a wrist's pieces.
    """

    name: ClassVar[str] = "keep_in"

    part: str = field(default="tip", metadata=PART)

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s] for the tip; others for where the pieces of a wrist begin, the mount."""
        return self.ball("keep_in", self.room, whole=self.part == "shaft")

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names for the tip, for the joints of a wrist, and for the mount."""
        wrist = pieces(self.instrument.wrist)
        ends = ("tip", *wrist, "mount") if self.part == "shaft" else ("tip",)
        return tuple(f"{self.label}, {end} in" for end in ends)


@dataclass(frozen=True, eq=False, kw_only=True)
class EntrySphere(SphereLimit):
    """Make the shaft pass through a sphere: the trocar as a tube, not as a point.

    delta <= radius - instrument.radius for the nearest point of the shaft, which ends at the first
    joint of a wrist. The entry sphere of Marinho et al. 2019.

    Departures: the paper damps the squared distance of the shaft's whole line, without the
    shaft's radius; here it is the distance itself of the segment from mount to the shaft's end.
    """

    name: ClassVar[str] = "entry_sphere"

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s]."""
        return self.ball("entry_sphere", self.room, whole=True)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of the one row."""
        return (f"{self.label}, shaft through",)


@dataclass(frozen=True, eq=False)
class TrocarCone(CompiledLimit, Damper):
    """Keep the angle between the shaft and the trocar's axis below the cone's half angle.

    The trocar's axis seen from the effector, n = R^T axis, moves by n' = [n]x omega; the angle
    theta between n and e_z has

        theta' = (n_y omega_x - n_x omega_y) / sin theta <= pace(cone_half_angle - theta).

    Only the shaft is in the trocar, so a wrist, beyond it, does not count.

    On the axis the direction of a tilt is not defined and the row is zero: the first cycle away
    from there is free. Opposite to it, every direction is a way back, and x is taken.

    A shaft that comes over the axis leans to the other side next, and may be too fast to be
    stopped there. So with a ``deceleration`` there are six more rows. Side k is a direction a_k of
    the world, square to the axis and 60 degrees from the next; the shaft's direction z leans
    towards it by asin(a_k . z), which is theta at most, and stays below the half angle as well:

        asin(a_k . z)' <= pace(cone_half_angle - asin(a_k . z)),

    with jerk about so: near the cone the first row is exact. The six are free for a cone of 90
    degrees or more, and while the shaft is as far as that from the axis, on its way back.

    Attributes:
        trocar: its axis and half angle; the axis stays as it is when the trocar moves.
        lever: what the rows are multiplied by [m], so that rows in m/s and these, where they
            cannot all hold, give way alike at this distance from the trocar; 1 leaves them in
            rad/s.
    """

    name: ClassVar[str] = "trocar_cone"

    trocar: Trocar
    lever: float = field(default=1.0, metadata=positive("m"))

    @functools.cached_property
    def block(self) -> Block:
        """One row [rad/s], and those of the sides; times the lever."""
        return Block(
            "trocar_cone",
            **self.rates,
            half_angle=self.trocar.cone_half_angle,
            axis=self.trocar.axis,
            lever=self.lever,
        )

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the row, and of the sides."""
        sides = tuple(f"trocar cone, side {k}" for k in range(1, 7))
        return ("trocar cone", *(sides if self.deceleration < math.inf else ()))


@dataclass(frozen=True, eq=False)
class TrocarDepth(CompiledLimit, Damper):
    """Keep the insertion depth in the trocar's range.

    With the trocar seen from the effector, r = R^T (pivot - p), and the tip q likewise,
    depth = q_z - r_z, and

        depth' = (q' + nu - [r]x omega - R^T pivot_dot)_z,
        depth' <= pace(deepest - depth),   -depth' <= pace(depth - shallowest).

    q' is zero except for a wrist: then q is the tool's point where it is, and a wrist that bends
    brings it out. If the wrist bends far, its joints are deeper than the tool's point: the end of
    the shaft, and the start of each further piece, have a row for their own greatest depth.

    Attributes:
        trocar: its depth range.
        wrist: of the instrument; None without one.
    """

    name: ClassVar[str] = "trocar_depth"

    trocar: Trocar
    wrist: Wrist | None = None

    @functools.cached_property
    def block(self) -> Block:
        """Rows [m/s]: deepest and shallowest of the tip; deepest of a wrist's joints."""
        shallowest, deepest = self.trocar.depth_range
        return Block(
            "trocar_depth",
            **self.rates,
            **bends(self.wrist),
            shallowest=shallowest,
            deepest=deepest,
        )

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names for the tip's two rows, and for each piece of a wrist."""
        joints = (f"trocar depth, {joint} deepest" for joint in pieces(self.wrist))
        return ("trocar depth, deepest", "trocar depth, shallowest", *joints)
