"""How far the instrument is inside."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.tasks.base import CompiledTask


@dataclass(frozen=True, eq=False)
class DepthTask(CompiledTask):
    """Bring the insertion depth to that of the desired effector.

    Both are measured along a shaft, its own each, from the trocar: depth = tip_depth - r_z with
    r = R^T (pivot - p), see RcmTask. The depth of the tip below the effector is the same for
    both and drops out:

        e = r_d,z - r_z,   de/dt = ([r_d]x omega_d - nu_d + R_d^T pivot_dot)_z
                                 - ([r]x omega - nu + R^T pivot_dot)_z.
    """

    name: ClassVar[str] = "depth"
    unit: ClassVar[str] = "m"

    @functools.cached_property
    def block(self) -> Block:
        """Error (1,) [m], positive when too deep."""
        return Block("depth")
