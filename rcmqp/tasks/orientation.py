"""The orientation of the tool in the world."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp._kernel import Block
from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.tasks.base import CompiledTask
from rcmqp.world.insertion import Insertion

UNIT = 1e-6
"""How far the orientation may be from a unit quaternion."""


@dataclass(frozen=True, eq=False)
class OrientationTask(CompiledTask):
    """Hold the tool's orientation in the world, whatever the shaft does.

    With r_t the tool's rotation, r_h the one to hold and s = r_t r_h* = (w, u), of the two signs
    the one with w >= 0,

        e = 2 u = 2 sin(phi / 2) n,   de/dt = (w I - [u]x) omega_t,

    n the axis and phi the angle that the tool is off by, omega_t its angular velocity, all in the
    world's axes. made_for() holds the orientation of the start.

    Attributes:
        orientation: (4,) unit quaternion, w first, from the tool's axes to the world's.

    Raises:
        OptionError: it is no unit quaternion.
    """

    name: ClassVar[str] = "orientation"
    unit: ClassVar[str] = "rad"

    orientation: ArrayLike

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        r = np.array(self.orientation, dtype=float)
        if r.shape != (4,) or not abs(float(np.linalg.norm(r)) - 1.0) <= UNIT:
            raise OptionError(
                f"orientation = {self.orientation!r}; it must be a unit quaternion, w first"
            )
        _ = self.block  # made now: the array that was given may be written to later

    @classmethod
    def made_for(cls, insertion: Insertion, **options: Any) -> Self:
        """The orientation at the start, unless another is given."""
        options.setdefault("orientation", dq.P(insertion.tool_start))
        return cls(**options)

    @functools.cached_property
    def block(self) -> Block:
        """Error (3,) [rad], in the world's axes."""
        return Block("orientation", orientation=np.array(self.orientation, dtype=float))
