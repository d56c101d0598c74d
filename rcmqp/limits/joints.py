"""Position, speed, acceleration and jerk of the joints, in one box."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rcmqp._kernel import Block
from rcmqp.errors import OptionError
from rcmqp.limits.base import CompiledLimit, Constraint
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import at_least, check, positive, share
from rcmqp.references.view import Reference
from rcmqp.world.arm import Arm, ArmState

NEAR_SHARE = 0.8
"""Share of the deceleration behind a speed limit near a position limit that braking counts on."""


BEYOND = 2.0
"""Nobody sent a command above so many times a limit."""

FASTEST = 1e6
"""A speed that no joint has, where no limit is given [rad/s]."""


@dataclass(frozen=True, eq=False)
class JointLimits(CompiledLimit):
    """Keep each joint inside its limits, now and in every cycle to come.

    The last command is v' and changed by a' T; this cycle's is v = v' + a T, held for T. Its
    acceleration a is allowed if |a| <= A, |a - a'| <= j T, and the joint can still do the
    following, cycle by cycle:

    - Speed. The acceleration goes back to zero by e T a cycle, e <= j, before the speed limit V.
      The speed still grows by S(a) - a T with S(a) = T ((m + 1) a - e T m (m + 1) / 2) and
      m = floor(a / (e T)), so a <= braking_speed(V - v', e, T).
    - Position. The joint stops, at rest and without acceleration, before its position limit. In
      cycle k of the stop its deceleration is

          min(k e T - a, B, max(0, end - k e T)),   k = 1, 2, ...,

      which grows by e T a cycle, holds at B <= A and falls by e T a cycle; ``end`` is such that
      the speed v is used up. The speed used up and the way are sums of ramps sum max(0, x - k)
      and of their moments sum k max(0, x - k), both in closed form and piecewise linear in x, so
      the way of a stop is exact, not the limit of short cycles. It grows with a: the largest a
      whose stop ends before the limit is found by a bracketed secant method, and only if the
      largest a that the other limits allow does not stop in time.
      Where a joint slows down so hard that it turns back before its acceleration is zero, the
      limit holds for the point where it turns.

    After one cycle of a stop, the way that is left is the rest of that stop. So a joint that
    obeyed the box can stop, and, as speed and position count on the same e, that stop obeys every
    limit: the box is never empty and no limit is ever exceeded, whatever is chosen inside the
    box. The box is continuous in angle, v' and a'. The profile is that of online trajectory
    generation in continuous time (Kröger and Wahl, IEEE T-RO 2010; Berscheid and Kröger, RSS
    2021); in cycles it is ours.

    Braking counts on B, a part of A, and on e, a part of j, for the other joints' sake: they have
    to slow down along with it if the shaft is to stay on the trocar, and may have to do so harder.

    Near a position limit some arms (Franka's FR3) are to stay below sqrt(2 k d) - o at the
    distance d. With B < k and a stop that ends at the distance
    o^2 / (2 k) + (o / k + T / 2)^2 B k / (2 (k - B)) or more, the braking speed at every d is
    below that after the cycle, too: v^2 / (2 B) + v T / 2 is the shortest way to stop, and the
    distance is the largest excess of (v + o)^2 / (2 k) + v T over it. B is at most 0.8 k.

    Without a limit on the jerk, or with one that lets the acceleration change from -A to A within
    a cycle, the box is that of a joint which may brake at once: |v| <= braking_speed(d, B, T).

    A state that no box of ours has led to (a start beyond a limit, a last command of somebody
    else) may ask for what cannot be. Then acceleration comes first and jerk second, because a
    robot refuses a command that exceeds them; speed is third and position last. An a' beyond A
    counts as A. A speed above V comes back at the pace of the acceleration and jerk limits.
    Numbers above twice a limit were never a command: v' counts as V then, and a' as zero. A joint
    beyond its position limit stops moving outwards and comes back at the pace from which it can
    stop on the limit, or faster. Where the acceleration is not limited, that is as fast as the
    joint can.

    Attributes:
        arm: whose limits they are.
        period: sampling period T [s].
        margin: kept from the position limits [rad] or [m].
        braking: B as a share of the acceleration limit. With 1 the RCM of the camera task gives
            way by 9 mm on the LWA3, whose joints then all are at their limits; with a quarter by
            0.00001 mm.
        easing: e as a share of the jerk limit. Of ten wild runs of the Panda, with jerk limits
            that let a joint reach its acceleration in 50 ms, the second worst is off the trocar
            by 70 mm at a half and by 5 mm at a quarter.
        acceleration: whether to keep the limits of acceleration and jerk; without them a joint
            may stop within one cycle, and state.v and state.a are not looked at.

    Raises:
        OptionError: an option is not allowed, or the arm's limits contradict themselves.
    """

    name: ClassVar[str] = "joints"

    arm: Arm
    period: float = field(metadata=positive("s"))
    margin: float = field(default=0.0, metadata=at_least(0.0))
    acceleration: bool = True
    braking: float = field(default=0.25, metadata=share())
    easing: float = field(default=0.25, metadata=share())

    def __post_init__(self) -> None:
        check(self)
        arm = self.arm
        for i, joint in enumerate(arm.joints):
            lower, upper = arm.lower[i], arm.upper[i]
            if not lower + self.margin < upper - self.margin:
                unit = arm.joint_units[i]
                raise OptionError(
                    f"{joint} has position limits [{lower:.4g}, {upper:.4g}] {unit}, which a "
                    f"margin of {self.margin:.4g} {unit} leaves empty; mend the limits or lower "
                    "the margin"
                )
            for kind in ("velocity", "acceleration", "jerk"):
                value = getattr(arm, kind)[i]
                if not value > 0.0:
                    raise OptionError(
                        f"{joint} has {kind} limit {value:.4g}; it must be positive, inf for none"
                    )
        super().__post_init__()

    @functools.cached_property
    def table(self) -> Array:
        """(7, nv) lowest and highest angle that a stop may end at, V, A, j, B, e."""
        arm, T = self.arm, self.period
        free = np.full(arm.nv, np.inf)
        acceleration, jerk = (arm.acceleration, arm.jerk) if self.acceleration else (free, free)
        lower, upper, B = (
            arm.lower + self.margin,
            arm.upper - self.margin,
            self.braking * acceleration,
        )
        near = getattr(arm, "speed_near_limits", None)
        if near is not None:
            o, k = np.array(near.offset), np.array(near.deceleration)
            B = np.minimum(B, NEAR_SHARE * k)
            room = o**2 / (2 * k) + (o / k + T / 2) ** 2 * B * k / (2 * (k - B))
            lower, upper = (
                np.maximum(lower, near.lower + room),
                np.minimum(upper, near.upper - room),
            )
        table = np.array(
            [lower, upper, arm.velocity, acceleration, jerk, B, self.easing * jerk], dtype=float
        )
        table.setflags(write=False)
        return table

    @functools.cached_property
    def block(self) -> Block:
        """The box."""
        names = ("lowest", "highest", "velocity", "acceleration", "jerk", "braking", "easing")
        return Block("joints", period=self.period, **dict(zip(names, self.table, strict=True)))

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """The box; no rows. An angle that is NaN has no position limits."""
        return Constraint.box(*self.interval(state.angles, state.v, state.a))

    def interval(self, angles: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """The box's lower and upper velocities (nv,), from angles, v' and a' (nv,)."""
        return self.block.interval(angles, v, a)


def believed(arm: Arm, v: Array, a: Array, period: float) -> tuple[Array, Array]:
    """Last command v (nv,) and its last change a (nv,) as JointLimits takes them.

    A speed above twice the limit counts as at the limit, and a as zero then; an acceleration above
    twice the limit counts as zero, and else as at most the limit.
    """
    top = np.minimum(arm.velocity, FASTEST)
    most = np.minimum(arm.acceleration, 2.0 * BEYOND * top / period)
    absurd = np.abs(v) > BEYOND * top
    none = absurd | (np.abs(a) > BEYOND * most)
    v = np.where(absurd, np.copysign(top, v), v)
    return v, np.where(none, 0.0, np.clip(a, -most, most))
