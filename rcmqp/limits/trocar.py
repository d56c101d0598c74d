"""How far the shaft may tilt in the trocar, and how far it may go in and out."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.limits.base import CompiledLimit, Damper
from rcmqp.limits.spheres import bends
from rcmqp.world.instrument import Trocar, Wrist


@dataclass(frozen=True, eq=False)
class TrocarCone(CompiledLimit, Damper):
    """Keep the angle between the shaft and the trocar's axis below the cone's half angle.

    The trocar's axis seen from the effector, n = R^T axis, moves by n' = [n]x omega; the angle
    theta between n and e_z has

        theta' = (n_y omega_x - n_x omega_y) / sin theta <= pace(cone_half_angle - theta).

    Only the shaft is in the trocar, so a wrist, beyond it, does not count.

    On the axis the direction of a tilt is not defined and the row is zero: the first cycle away
    from there is free. Opposite to it, every direction is a way back, and x is taken.

    Attributes:
        trocar: its axis and half angle; the axis stays as it is when the trocar moves.
    """

    name: ClassVar[str] = "trocar_cone"

    trocar: Trocar

    @functools.cached_property
    def block(self) -> Block:
        """One row [rad/s]."""
        return Block(
            "trocar_cone",
            **self.rates,
            half_angle=self.trocar.cone_half_angle,
            axis=self.trocar.axis,
        )

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the one row."""
        return ("trocar cone",)


@dataclass(frozen=True, eq=False)
class TrocarDepth(CompiledLimit, Damper):
    """Keep the insertion depth in the trocar's range.

    With the trocar seen from the effector, r = R^T (pivot - p), and the tip q likewise,
    depth = q_z - r_z, and

        depth' = (q' + nu - [r]x omega - R^T pivot_dot)_z,
        depth' <= pace(deepest - depth),   -depth' <= pace(depth - shallowest).

    q' is zero but for a wrist: then q is the tool's point where it is, and a wrist that bends
    brings it out.

    Attributes:
        trocar: its depth range.
        wrist: of the instrument; None without one.
    """

    name: ClassVar[str] = "trocar_depth"

    trocar: Trocar
    wrist: Wrist | None = None

    @functools.cached_property
    def block(self) -> Block:
        """Two rows [m/s]: the deepest, the shallowest."""
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
        """Of the two rows."""
        return ("trocar depth, deepest", "trocar depth, shallowest")
