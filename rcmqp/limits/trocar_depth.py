"""How far the instrument may go in and out of the trocar."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.limits.base import CompiledLimit, Damper
from rcmqp.limits.spheres import bends, shaft_depth
from rcmqp.tasks.base import check_finite
from rcmqp.world.instrument import Trocar, Wrist


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
        tip_depth: from the effector to the tip, along the shaft [m]; with a straight wrist.
        wrist: of the instrument; None without one.
    """

    name: ClassVar[str] = "trocar_depth"

    trocar: Trocar
    tip_depth: float
    wrist: Wrist | None = None

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        check_finite("tip_depth", self.tip_depth, "m")

    @functools.cached_property
    def block(self) -> Block:
        """Two rows [m/s]: the deepest, the shallowest."""
        shallowest, deepest = self.trocar.depth_range
        return Block(
            "trocar_depth",
            **self.rates,
            last=shaft_depth(self.wrist, self.tip_depth),
            **bends(self.wrist),
            shallowest=shallowest,
            deepest=deepest,
        )

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the two rows."""
        return ("trocar depth, deepest", "trocar depth, shallowest")
