"""The limit on how fast joints may move while the shaft goes through the trocar."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rcmqp._kernel import Block
from rcmqp.limits.base import CompiledLimit, check_gain
from rcmqp.maths.options import positive, share
from rcmqp.world.arm import Arm

MOST_ACCELERATION = 1e6
"""Of a joint without a limit [rad/s^2] or [m/s^2]."""


@dataclass(frozen=True, eq=False)
class TrocarSpeed(CompiledLimit):
    """Keep joints slow enough that their acceleration can hold the shaft on the trocar.

    Joints that go on at v take the shaft off the trocar by r'' = b(v), in axes that do not spin
    about the shaft; about a trocar at rest b grows with the square of v (kernel/bend.c; how a
    moving trocar accelerates is not known). To hold the shaft there, the joints have to
    accelerate by a with J a = -b, where J is the Jacobian of the RCM's rows. With A the
    acceleration limits, the least of |a / A| is

        s(v) = sqrt(b . (J A^2 J^T)^-1 b),

    so up to s = 1 no joint needs more than its limit; beyond, the trocar may be lost, however the
    arm brakes. The limit keeps s up to ``share``: from one cycle to the next,

        ds/dv . (v_next - v) <= gain T (share - s),

    which slows the arm down where s is above the share.

    The rest of A is for the tip, for braking, and for joints whose position, speed or jerk limits
    keep them from their part. How s changes as the arm moves on is not in the row.

    The row is in m/s, times T |b| / s: what its excess would take the shaft off by in a cycle.

    Attributes:
        arm: whose acceleration limits they are.
        period: sampling period T [s].
        share: of the joints' acceleration.
        gain: how fast s may approach it [1/s]; gain T is at most 1.

    Raises:
        OptionError: an option is not allowed.
    """

    name: ClassVar[str] = "trocar_speed"

    arm: Arm
    period: float = field(metadata=positive("s"))
    share: float = field(default=0.5, metadata=share())
    gain: float = field(default=20.0, metadata=positive("1/s"))

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        check_gain(self.gain, self.period)

    @functools.cached_property
    def block(self) -> Block:
        """One row [m/s]."""
        acceleration = np.minimum(self.arm.acceleration, MOST_ACCELERATION)
        options = {"gain": self.gain, "share": self.share, "period": self.period}
        return Block("trocar_speed", acceleration=acceleration, **options)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of the one row."""
        return ("trocar speed",)
