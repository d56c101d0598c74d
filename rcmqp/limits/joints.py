"""Position, speed and acceleration of the joints, in one box."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.arm import Arm, ArmState
from rcmqp.dualquaternion import Array
from rcmqp.errors import OptionError
from rcmqp.limits.base import Constraint, Limit, intersect
from rcmqp.reference import Reference
from rcmqp.tasks.base import check_positive


@dataclass(frozen=True, eq=False)
class JointLimits(Limit):
    """Keep each joint inside its limits, now and in every cycle to come.

    The velocity v of a cycle holds for T; the next may differ by a T. v is allowed if
    |v| <= velocity, |v - v_before| <= a T, and a joint that goes on at v for this cycle and
    then brakes stops short of its position limit: |v| <= braking_speed(distance, braking a, T).
    The box of a cycle that obeyed its own is never empty, for braking stays possible by
    construction. That it begins early, at a part of the acceleration limit, is for the other
    joints' sake: they have to slow down along with it if the shaft is to stay on the trocar, and
    may have to do so harder.

    A state that no box of ours has led to (a push, a plant that lags, a start beyond a limit)
    may ask for what cannot be. Then speed comes first, acceleration second, position third: the
    joint brakes as hard as it may, and comes back from beyond the limit at the pace from which
    it can stop on the limit, or faster. Where the acceleration is not limited, that is as fast
    as the joint can.

    Attributes:
        arm: whose limits they are.
        period: sampling period T [s].
        margin: kept from the position limits [rad] or [m].
        braking: share of the acceleration limit that braking before a position limit counts on.
            With 1 the RCM of the camera task gives way by 9 mm on the LWA3, whose joints then
            all are at their limits; with a quarter by 0.00001 mm.
        acceleration: whether to keep the acceleration limits; without them a joint may stop
            within one cycle, and state.v is not looked at.

    Raises:
        OptionError: an option is not allowed, or the arm's limits contradict themselves.
    """

    name: ClassVar[str] = "joints"

    arm: Arm
    period: float
    margin: float = 0.0
    acceleration: bool = True
    braking: float = 0.25

    def __post_init__(self) -> None:
        """Check the options and the arm's limits."""
        check_positive("period", self.period, "s")
        if not 0.0 <= self.margin < np.inf:
            raise OptionError(f"margin = {self.margin} rad, it must be 0 or more, and finite")
        if not 0.0 < self.braking <= 1.0:
            raise OptionError(f"braking = {self.braking}, it must be above 0 and at most 1")
        arm = self.arm
        for i, joint in enumerate(arm.joints):
            lower, upper = arm.lower[i], arm.upper[i]
            if not lower + self.margin < upper - self.margin:
                raise OptionError(
                    f"{joint} has position limits [{lower:.4g}, {upper:.4g}] rad, which a margin "
                    f"of {self.margin:.4g} rad leaves empty; mend the limits or lower the margin"
                )
            for kind in ("velocity", "acceleration"):
                value = getattr(arm, kind)[i]
                if not value > 0.0:
                    raise OptionError(
                        f"{joint} has {kind} limit {value:.4g}; it must be positive, inf for none"
                    )

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """The box; no rows."""
        arm, T = self.arm, self.period
        lower, upper = -arm.velocity, arm.velocity
        a = np.full(arm.nv, np.inf)
        if self.acceleration:
            a = arm.acceleration
            lower, upper = intersect(lower, upper, state.v - T * a, state.v + T * a)
        below = state.angles - (arm.lower + self.margin)
        above = (arm.upper - self.margin) - state.angles
        towards = (braking_speed(distance, self.braking * a, T) for distance in (below, above))
        low, up = towards
        return Constraint.box(*intersect(lower, upper, -low, up))

    def program(self) -> tuple[float, ...]:
        """For compiled code."""
        return (_kernel.JOINTS, self.period, self.margin, float(self.acceleration), self.braking)


def braking_speed(distance: ArrayLike, deceleration: ArrayLike, period: float) -> Array:
    """Largest speed towards a limit from which a joint sampled with T can still brake.

    Gone for this cycle at v, and then slowed down by a T a cycle, the joint goes

        S(v) = v T + sum_{j >= 1} max(0, v - j a T) T = T ((m + 1) v - a T m (m + 1) / 2),

    with m = floor(v / (a T)) braking cycles. S grows, and S(m a T) = a T^2 m (m + 1) / 2, so
    S(v) = d is solved by

        v = d / ((m + 1) T) + m a T / 2,   m = floor((sqrt(1 + 8 d / (a T^2)) - 1) / 2),

    continuous and piecewise linear in d. Without a limit on the deceleration m = 0, v = d / T;
    for small T it is sqrt(2 a d).

    Args:
        distance: (...) d to the limit [rad] or [m]; beyond the limit, negative, the answer is
            -v(|d|): the slowest way back that keeps the pace to stop on the limit.
        deceleration: (...) a [rad/s^2], inf for none.
        period: T [s].

    Returns:
        (...) v, inf for an infinite distance.
    """
    d = np.abs(np.asarray(distance, dtype=float))
    step = np.asarray(deceleration, dtype=float) * period
    with np.errstate(invalid="ignore"):  # inf / inf, both without limit
        m = np.floor((np.sqrt(1.0 + 8.0 * d / (step * period)) - 1.0) / 2.0)
    m = np.where(np.isfinite(m), m, 0.0)
    speed = d / ((m + 1.0) * period) + m * np.where(m > 0.0, step, 0.0) / 2.0
    return np.asarray(np.copysign(speed, distance))
