"""How far the instrument may go in and out of the trocar."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.limits.base import CompiledLimit, Damper
from rcmqp.tasks.base import check_finite
from rcmqp.world.instrument import Trocar


@dataclass(frozen=True, eq=False)
class TrocarDepth(CompiledLimit, Damper):
    """Keep the insertion depth in the trocar's range.

    With the trocar seen from the effector, r = R^T (pivot - p), depth = tip_depth - r_z, and

        depth' = (nu - [r]x omega - R^T pivot_dot)_z,
        depth' <= pace(deepest - depth),   -depth' <= pace(depth - shallowest).

    Attributes:
        trocar: its depth range.
        tip_depth: from the effector to the tip, along the shaft [m].
    """

    name: ClassVar[str] = "trocar_depth"

    trocar: Trocar
    tip_depth: float

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
            tip_depth=self.tip_depth,
            shallowest=shallowest,
            deepest=deepest,
        )

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the two rows."""
        return ("trocar depth, deepest", "trocar depth, shallowest")
