"""Where the camera looks."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.tasks.base import CompiledTask


@dataclass(frozen=True, eq=False)
class DirectionTask(CompiledTask):
    """Point the shaft as the desired effector points its own.

    The desired shaft axis z_d, seen from the effector, is u = R^T z_d; on target it is e_z. The
    error is u's first two coordinates, its norm the sine of the angle between the shafts:

        du/dt = [u]x omega + R^T R_d (omega_d x e_z).

    Two rows of rank 2, but where the angle is 90 degrees; beyond it the error shrinks again and
    is zero, unstably, at 180. No camera in a trocar turns that far.
    """

    name: ClassVar[str] = "direction"
    unit: ClassVar[str] = "rad"

    @functools.cached_property
    def block(self) -> Block:
        """Error (2,), no unit, in the effector's axes, x and y."""
        return Block("direction")
