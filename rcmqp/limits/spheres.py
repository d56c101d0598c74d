"""What limits with a sphere have in common."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rcmqp.errors import OptionError, UnknownName
from rcmqp.limits.base import Damper
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.view import Reference
from rcmqp.tasks.base import check_finite, check_positive
from rcmqp.world.arm import ArmState
from rcmqp.world.instrument import Instrument, Vector3, vector3

PARTS = ("tip", "shaft")
CENTRE = 1e-9
"""Distance [m] below which a point is at the centre, and away from it in no direction."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SphereLimit(Damper):
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
            object.__setattr__(self, name, vector3(name, getattr(self, name)))

    @property
    def mount_depth(self) -> float:
        """Where the shaft begins, from the effector along the shaft [m]; negative."""
        return self.tip_depth - self.instrument.length

    def seen(self, state: ArmState, reference: Reference) -> tuple[Array, Array, Array]:
        """The centre in the effector's axes.

        Returns:
            b (3,) [m]; db/dv (3, nv) and db/dt with the joints still (3,) [m/s].
        """
        centre, velocity = np.array(self.centre), np.array(self.velocity)
        if self.on_trocar:
            centre, velocity = centre + reference.pivot, velocity + reference.pivot_dot
        b = state.oMe.actInv(centre)
        jacobian = pin.skew(b) @ state.J_local[3:] - state.J_local[:3]
        return b, jacobian, state.oMe.rotation.T @ velocity

    def nearest(self, b: Array) -> float:
        """The point s of the shaft, from mount to tip, that is nearest to b (3,) [m]."""
        return min(max(float(b[2]), self.mount_depth), self.tip_depth)

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


def direction(b: Array, s: float) -> tuple[float, Array]:
    """Distance delta of b (3,) from s e_z and the unit vector u (3,) there, zero at the centre."""
    seen = np.array([b[0], b[1], b[2] - s])
    delta = math.sqrt(float(seen @ seen))
    return delta, seen / delta if delta > CENTRE else np.zeros(3)


def check_part(part: str) -> None:
    """Check which part of the instrument a limit is for.

    Raises:
        UnknownName: it is none of PARTS.
    """
    if part not in PARTS:
        raise UnknownName("part of the instrument", part, PARTS)
