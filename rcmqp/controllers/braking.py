"""From motion to rest, inside every joint's limits: what each safe stop does."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.limits.joints import JointLimits, believed
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.smooth import braking_speed
from rcmqp.qp import Hierarchy
from rcmqp.qp.levels import Bounds, Level
from rcmqp.references.view import STILL, Reference
from rcmqp.tasks.base import Residual
from rcmqp.tasks.placement import RcmTask
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion

GAIN = 60.0
"""How fast the shaft goes back to where it was when the stop began [1/s]."""

PULL = 0.001
"""At most so fast, per joint speed [m]: a shaft that is far off does not keep joints moving."""

NOTHING = 1e-12
"""A velocity that is rounding [rad/s]."""

PATIENCE = 1.5
"""How often the time that the slowest joint needs by itself; then each joint stops by itself."""


def braking(
    insertion: Insertion,
    angles: Array,
    v: Array,
    period: float,
    pivot: Array,
    a: Array | None = None,
) -> Iterator[Array]:
    """Joint velocities (nv,) [rad/s], one for each cycle, from ``v`` to rest, the last one zero.

    Each is that of Brake at the angles to which the joints have gone meanwhile. The shaft goes on
    through the place where it is nearest to the trocar now: the RCM error does not grow, however
    well the trocar is known. Where the angles are not known, or that takes more than twice as long
    as the slowest joint needs by itself, the trocar is given up, and each joint stops by itself.

    Args:
        insertion: whose arm, and its limits.
        angles: (nv,) joint angles now [rad]; NaN or infinite where they are not known.
        v: (nv,) joint velocity, until the first of these [rad/s].
        period: [s].
        pivot: (3,) the trocar in the world, as last known [m].
        a: (nv,) the last change of the joint velocity, over the period [rad/s^2]; zero if not
            given.
    """
    brake, arm = Brake(insertion, period), insertion.arm
    v, a = believed(arm, known(v), known(np.zeros(arm.nv) if a is None else a), period)
    q = arm.configuration(angles) if np.isfinite(angles).all() else None
    patience = PATIENCE * brake.cycles(v, a)
    held: Array | None = None
    cycle = 0
    while True:
        state = None
        if q is not None:  # v holds until the next one
            q = arm.integrate(q, v, period)
            state, angles = insertion.state(q), arm.angles(q)
            held = nearest(state, pivot) if held is None else held
        shaft = state if cycle < patience else None
        before, v = v, brake.velocity(angles, v, a, shaft, held, alone=cycle >= patience)
        a, cycle = (v - before) / period, cycle + 1
        v.setflags(write=False)
        yield v
        if not v.any():
            return


class Brake:
    """The safe stop of an arm: joints slow down together, the shaft staying on the trocar.

    Above all levels is the box of the joints' limits. In it the shaft's point at the trocar does
    not move, see RcmTask; the rows are of second order in the period, so where a first answer
    leads is looked at, and a second one makes up for what they lack. Below that, all joints slow
    down in proportion, v = s v', with s as small as every joint's limits of acceleration and jerk
    allow: the rate of the common slowing down is chosen like the acceleration of a joint, with
    the least of A_i / |v_i| and of j_i / |v_i| as its limits, such that it is zero again at rest.
    No joint is sent through zero by this, and a joint that has to stop faster, or cannot follow,
    does what its own limits allow.

    The box is that of JointLimits with all of the acceleration and the jerk, joined with that of
    its usual shares: both let a joint stop before its position limit, and what one of them has
    led to the other need not know. A joint that is beyond its limits is not moved back: to stop
    comes first. So a position limit that a joint can keep by itself it keeps, whatever becomes of
    the trocar.

    Once each joint may be at rest in this cycle, and without acceleration in the next, all are.

    A motion that leaves the shaft's point where it is does so at s v', too, to first order. So
    in proportion the joints take no longer than the slowest one alone, apart from earlier
    accelerations and from what the trocar's curvature asks of the joints.
    benchmarks/safe_stops.py measures how long it takes and how far the shaft goes.

    Attributes:
        insertion: whose arm.
        period: [s].
    """

    def __init__(self, insertion: Insertion, period: float) -> None:
        self.insertion, self.period = insertion, period
        arm = insertion.arm
        self._boxes = (
            JointLimits(arm, period, braking=1.0, easing=1.0),
            JointLimits(arm, period),
        )
        self._ranges = [box.table[:2] for box in self._boxes]
        self._one_range = np.array_equal(self._ranges[0], self._ranges[1])
        self._rcm = RcmTask(gain=min(GAIN, 0.5 / period), period=period)
        self._hierarchy = Hierarchy("active_set")

    def reset(self) -> None:
        """Forget the solver's warm start."""
        self._hierarchy.reset()

    def velocity(
        self,
        angles: Array,
        v: Array,
        a: Array,
        shaft: ArmState | None = None,
        held: Array | None = None,
        *,
        alone: bool = False,
    ) -> Array:
        """The joint velocity (nv,) of the next cycle [rad/s]; zero once that is possible.

        Args:
            angles: (nv,) joint angles [rad]; NaN where they are not known: such a joint has no
                position limits to leave.
            v: (nv,) joint velocity until now [rad/s]; a joint whose velocity is not finite is
                stopped, for what is not known cannot be slowed down.
            a: (nv,) its last change, over the period [rad/s^2].
            shaft: the state at these angles; None: the shaft does not matter.
            held: (3,) the point of the world that the shaft goes through; where it is nearest to
                the insertion's trocar, if not given.
            alone: each joint stops as fast as it can, not in proportion with the others.
        """
        arm, T = self.insertion.arm, self.period
        if all_zero(v, a):
            return np.zeros(arm.nv)
        v, a = believed(arm, known(v), known(a), T)
        lower, upper = self.box(angles, v, a)
        at_rest = (lower <= NOTHING) & (upper >= -NOTHING) & (np.abs(v) <= arm.jerk * T**2)
        if at_rest.all():
            return np.zeros(arm.nv)
        if alone:
            wanted = v - np.sign(v) * T * braking_speed(np.abs(v), arm.jerk, T)
        else:
            wanted = self._together(v, a)
        if shaft is None or not np.isfinite(shaft.J_local).all():
            return np.clip(wanted, lower, upper)
        state = dataclasses.replace(shaft, v=v, a=a)
        pivot = nearest(state, np.array(self.insertion.trocar.pivot)) if held is None else held
        rcm = self._off(state, pivot)
        off, fastest = float(np.linalg.norm(rcm.error)), PULL * float(np.abs(v).max())
        gain = self._rcm.gain if self._rcm.gain * off <= fastest else fastest / off
        rate = -gain * rcm.error - rcm.drift
        slower, box = Level(np.eye(arm.nv), wanted, "slower"), Bounds(lower, upper)
        found = self._hierarchy.solve([Level(rcm.jacobian, rate, "rcm"), slower], box).v
        rate = rate - self._unseen(state, rcm, pivot, found)
        return self._hierarchy.solve([Level(rcm.jacobian, rate, "rcm"), slower], box).v.copy()

    def _off(self, state: ArmState, pivot: Array) -> Residual:
        """The RCM's rows, and how far the shaft is off a point (3,) that stands still."""
        return self._rcm.evaluate(state, Reference(state.x, np.zeros(8), pivot, STILL))

    def _unseen(self, state: ArmState, rcm: Residual, pivot: Array, v: Array) -> Array:
        """What the RCM's rows do not see of d(error)/dt (2,) in the next cycle, at ``v`` [m/s]."""
        ahead = self.insertion.state(self.insertion.arm.integrate(state.q, v, self.period))
        then = self._off(ahead, pivot).error
        axes, axes_then = state.oMe.rotation[:, :2], ahead.oMe.rotation[:, :2]
        change = (axes.T @ axes_then @ then - rcm.error) / self.period
        return np.asarray(change - rcm.jacobian @ v - rcm.drift)

    def cycles(self, v: Array, a: Array) -> int:
        """Cycles that the slowest joint needs to stop by itself, at most."""
        arm, T = self.insertion.arm, self.period
        v, a = believed(arm, known(v), known(a), T)
        A, j = arm.acceleration, np.minimum(arm.jerk, 1e12)
        fastest = np.abs(v) + a**2 / (2.0 * j)
        ramps = 2.0 * np.sqrt(fastest / j)  # up and down at once, A is not met
        stops = np.where(fastest * j < A**2, ramps, fastest / A + A / j) + np.abs(a) / j
        return math.ceil(float(np.max(stops)) / T) + 3

    def box(self, angles: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Lower and upper velocities (nv,) from which each joint can stop inside its limits.

        Angles, v and a are those of velocity().
        """
        angles = np.where(np.isfinite(angles), angles, np.nan)
        (one, other), (first, second) = self._boxes, self._ranges
        inside = _clipped(angles, first)
        lower, upper = one.interval(inside, v, a)
        low, up = other.interval(inside if self._one_range else _clipped(angles, second), v, a)
        return np.minimum(lower, low), np.maximum(upper, up)

    def _together(self, v: Array, a: Array) -> Array:
        """All joints slowed down in proportion, as fast as acceleration and jerk allow."""
        arm, T = self.insertion.arm, self.period
        moves = np.abs(v) > NOTHING
        if not moves.any():
            return v
        speed = np.abs(v[moves])
        A, j = (
            float(np.min(arm.acceleration[moves] / speed)),
            float(np.min(arm.jerk[moves] / speed)),
        )
        rate = float(a[moves] @ v[moves]) / float(speed @ speed)
        fastest = -min(A, float(braking_speed(1.0, j, T)))
        rate = min(max(rate - j * T, fastest), rate + j * T)
        return np.asarray(max(0.0, 1.0 + rate * T) * v)


def nearest(state: ArmState, pivot: Array) -> Array:
    """Where (3,) in the world the shaft is nearest to the trocar (3,) [m]."""
    depth = state.oMe.actInv(np.asarray(pivot, dtype=float))[2]
    return np.asarray(state.oMe.act(np.array([0.0, 0.0, depth])))


def _clipped(angles: Array, ends: Array) -> Array:
    """Angles (nv,) between both ``ends`` (2, nv); NaN stays. np.clip() takes longer."""
    return np.asarray(np.minimum(np.maximum(angles, ends[0]), ends[1]))


def all_zero(*vectors: ArrayLike) -> bool:
    """Whether all numbers are zero: joints at rest may always stay at rest."""
    return not any(any(np.asarray(vector).tolist()) for vector in vectors)


def known(numbers: Array) -> Array:
    """Zero where a number is not finite."""
    return np.where(np.isfinite(numbers), numbers, 0.0)
