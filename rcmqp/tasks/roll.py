"""The roll of the camera about the shaft."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.tasks.base import CompiledTask


@dataclass(frozen=True, eq=False)
class RollTask(CompiledTask):
    """Take the twist about the shaft out of the rotation from the desired effector to the own.

    With s = r_d* r = [w, x, y, z], of the two signs the one with w >= 0, the twist (of the
    swing-twist split) is phi = 2 atan2(z, w), in [-pi, pi]: the short way. From
    s' = (1/2) (s omega - omega_d s),

        phi' = 2 (w z' - z w') / (w^2 + z^2)
             = omega_z + ((x z - w y) omega_x + (w x + y z) omega_y) / (w^2 + z^2)
             - omega_d,z - ((x z + w y) omega_d,x + (y z - w x) omega_d,y) / (w^2 + z^2).

    Where the shafts point apart, w = z = 0, no roll is defined and nothing is asked.
    """

    name: ClassVar[str] = "roll"
    unit: ClassVar[str] = "rad"

    @functools.cached_property
    def block(self) -> Block:
        """Error (1,) [rad]; positive when turned too far about the shaft's z."""
        return Block("roll")
