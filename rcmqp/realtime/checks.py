"""Checks of readings, references and commands before an arm moves by them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.controllers.braking import NOTHING, Brake, all_zero
from rcmqp.errors import InvalidCommand, RcmqpError
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.smooth import braking_speed
from rcmqp.references.view import Stamped
from rcmqp.world.arm import Arm, ArmState
from rcmqp.world.insertion import Insertion, rcm_error

SLACK = 1e-3
"""Share of a limit that a command may be above it: a solver's tolerance, and cut off."""

ON_TROCAR = 1e-3
"""How far the shaft may be off the trocar when a loop starts [m]; or the insertion's tolerance."""

OUTSIDE = 0.05, 0.005
"""How far a reading may be outside its joint's position limits, revolute [rad], prismatic [m]."""

JUMP = 2.0
"""How many times faster than its limit a joint may seem to move between two readings."""

FAST = "take hierarchical_qp, or velocity_limit=scale where the controller has that option"
"""What to do about a command that is too fast."""

ABRUPT = "take hierarchical_qp, which keeps the joints' limits, or give a smoother reference"
"""What to do about a command that changes too much."""


class Robot(Protocol):
    """The robot that a loop reads and commands; each call must return well within a period."""

    def read(self) -> tuple[ArrayLike, ArrayLike]:
        """Configuration q (nq,) and joint velocity v (nv,) [rad/s] as measured now."""
        ...

    def send(self, v: Array) -> None:
        """Command a joint velocity v (nv,) [rad/s], read-only, until the next one."""
        ...


@runtime_checkable
class Halting(Protocol):
    """A robot that can be halted from another thread, even while read() or send() hangs.

    The joints come to rest by the robot's own means, and no command that comes later moves them.
    halt() may be called more than once.
    """

    def halt(self) -> None:
        """Bring the joints to rest, and return."""
        ...


@runtime_checkable
class Watching(Protocol):
    """References that depend on what the arm does, such as rcmqp.references.governor.Governed."""

    def see(self, state: ArmState) -> None:
        """Take the state that was measured when the last reference was asked for."""
        ...


class LoopFault(RcmqpError):
    """The real-time loop cannot go on.

    A reference is too old, a reading is impossible, the robot does not stand with the shaft in the
    trocar, or a command is too late or beyond the limits.
    """


def as_reading(answer: object, arm: Arm) -> tuple[Array, Array]:
    """Configuration (nq,) and joint velocity (nv,) [rad/s] that read() answered.

    Both may also be given by the joints' names, in any order: angles, and velocities.

    Raises:
        InvalidCommand: they are not, or not finite.
    """
    try:
        pair: Any = answer
        read, rate = pair
        if isinstance(read, Mapping):
            read, rate = arm.configuration(read), [rate[joint] for joint in arm.joints]
        q, v = np.array(read, dtype=float), np.array(rate, dtype=float)
    except InvalidCommand:
        raise
    except (TypeError, ValueError, LookupError) as error:
        raise InvalidCommand(
            f"read() answered {answer!r}; it must be a pair of arrays, configuration q "
            f"({arm.nq},) and joint velocity v ({arm.nv},), as measured now"
        ) from error
    _check_vector("configuration q", q, arm.nq, angles=q.shape == (arm.nv,))
    _check_vector("joint velocity v", v, arm.nv)
    return q, v


def _check_vector(name: str, values: Array, size: int, *, angles: bool = False) -> None:
    """Raise InvalidCommand for a reading of a wrong shape, or one that is not finite."""
    if values.shape != (size,):
        hint = "; arm.configuration(angles) makes one of joint angles" if angles else ""
        raise InvalidCommand(
            f"read() answered a {name} of shape {values.shape}, it must be ({size},){hint}"
        )
    if not np.isfinite(values).all():
        raise InvalidCommand(f"{name} is not finite, as it was read: {values}")


def check_stamp(newest: object, now: float, oldest: float, ahead: float) -> Stamped:
    """The newest reference, if it is of ``now`` [s].

    Args:
        newest: what references(now) answered.
        now: from the start of the loop [s].
        oldest: how old it may be [s].
        ahead: how far in the future it may be stamped [s].

    Raises:
        InvalidCommand: it is not a Stamped.
        LoopFault: it is older, or stamped further ahead.
    """
    if not isinstance(newest, Stamped):
        raise InvalidCommand(
            f"references({now:.4g}) answered a {type(newest).__name__}; it must be "
            "Stamped(reference, at)"
        )
    if not now - newest.at <= oldest:
        raise LoopFault(
            f"the newest reference is {now - newest.at:.4g} s old, allowed {oldest:.4g} s"
        )
    if newest.at - now > ahead:
        raise LoopFault(
            f"the newest reference is stamped {newest.at - now:.4g} s in the future; stamp "
            "references with the time that the loop asks with, counted from its start"
        )
    return newest


class ReadingCheck:
    """Checks that a reading can be that of the arm which the insertion describes.

    They find readings in degrees, in another order of the joints, or of an arm that stands
    elsewhere: a controller would draw the shaft to the trocar at full speed.

    Attributes:
        off_trocar: distance of the shaft from the trocar at the first reading [m].
    """

    def __init__(self, insertion: Insertion, period: float) -> None:
        self.off_trocar = np.nan
        arm = insertion.arm
        self._insertion, self._most = insertion, max(ON_TROCAR, insertion.tolerance)
        self._outside = np.where(arm.turns, *OUTSIDE)
        self._lowest, self._highest = arm.lower - self._outside, arm.upper + self._outside
        self._fastest = JUMP * arm.velocity
        self._endless = arm.turns & np.isinf(arm.upper) & np.isinf(arm.lower)
        self._any_endless = bool(self._endless.any())
        self._period, self._last = period, (np.nan * arm.lower, 0.0)

    def start(self, state: ArmState, pivot: Array) -> None:
        """Check that the shaft is on the trocar.

        Raises:
            LoopFault: it is not.
        """
        self.off_trocar = float(rcm_error(state.x, pivot))
        if self.off_trocar > self._most:
            raise LoopFault(
                f"the shaft is {1e3 * self.off_trocar:.3g} mm off the trocar where the robot "
                f"stands, allowed {1e3 * self._most:.3g} mm; make the insertion from a reading, "
                "Insertion.on_shaft(arm, instrument, q, depth=...), or give the trocar that was "
                "measured and a tolerance, Insertion(arm, instrument, trocar, q, tolerance=...)"
            )

    def passed(self, angles: Array, at: float) -> None:
        """Check the angles (nv,) that were read at a time [s].

        Raises:
            LoopFault: one is outside its position limits, or farther from the last reading than
                the joint can have moved.
        """
        arm, (last, before) = self._insertion.arm, self._last
        if True in ((angles < self._lowest) | (angles > self._highest)).tolist():
            k = int(np.argmax(np.maximum(angles - self._highest, self._lowest - angles)))
            raise LoopFault(
                f"{arm.joints[k]} was read at {angles[k]:.4g} {arm.joint_units[k]}, its limits "
                f"are {arm.lower[k]:.4g} and {arm.upper[k]:.4g}; check the order of the joints, "
                "and that read() gives rad and m"
            )
        way = np.abs(angles - last)
        if self._any_endless:
            way = np.where(self._endless, np.minimum(way, np.abs(2.0 * np.pi - way)), way)
        can = self._fastest * max(self._period, at - before) + self._outside
        if True in (way > can).tolist():
            k = int(np.argmax(way / can))
            raise LoopFault(
                f"{arm.joints[k]} was read {way[k]:.4g} {arm.joint_units[k]} from the reading "
                f"{at - before:.4g} s before, and can move {arm.velocity[k]:.4g} "
                f"{arm.joint_units[k]}/s; check that every reading is of this arm, and new"
            )
        self._last = angles, at


class CommandCheck:
    """Checks before a command is sent that the joints can follow it, and can still stop then.

    A command may be what lies in the hard box of Brake at the last reading, from the last command
    and its last change: the joint's limits of speed, acceleration and jerk, and a stop that ends
    before its position limit. What is outside by less than SLACK of the change that a cycle
    allows is cut off.

    Attributes:
        arm: whose limits.
        controller: its name, for messages.
    """

    def __init__(self, brake: Brake, controller: str) -> None:
        self.arm, self.controller, self._brake = brake.insertion.arm, controller, brake

    def passed(self, v: ArrayLike, angles: Array, before: Array, a: Array) -> Array:
        """The command (nv,) [rad/s], read-only.

        Args:
            v: what the controller answered.
            angles: (nv,) as read [rad].
            before: (nv,) the last command [rad/s].
            a: (nv,) its last change, over the period [rad/s^2].

        Raises:
            InvalidCommand: it has another size, or is not finite.
            LoopFault: a joint cannot do that, or not stop in time any more.
        """
        arm, T = self.arm, self._brake.period
        command = np.array(v, dtype=float)
        if command.shape != (arm.nv,) or not np.isfinite(command).all():
            raise InvalidCommand(
                f"{self.controller} answered {command}, not {arm.nv} finite numbers"
            )
        command.setflags(write=False)
        if all_zero(command, before, a):
            return command
        lower, upper = self._brake.box(angles, before, a)
        if True in ((command < lower) | (command > upper)).tolist():
            check_speed(command, arm, f"was to move by {self.controller}'s command", FAST)
            most = np.minimum(np.minimum(arm.acceleration, T * arm.jerk) * T, arm.velocity)
            inside = np.clip(command, -arm.velocity, arm.velocity)
            excess = np.maximum(inside - upper, lower - inside) - SLACK * most
            if np.any(excess > 0.0):
                k = int(np.argmax(excess / most))
                raise LoopFault(self._words(k, inside[k], angles[k], before[k], a[k]))
            cut_off = np.clip(command, lower, upper)
            command = np.where(np.abs(cut_off - command) > NOTHING, cut_off, command)
            command.setflags(write=False)
        return command

    def _words(self, k: int, v: float, angle: float, before: float, a: float) -> str:
        """Say why joint k cannot follow a command."""
        arm, T, unit = self.arm, self._brake.period, self.arm.joint_units[k]
        change, room = (v - before) / T, arm.velocity[k] - abs(before)
        jerk, who = (change - a) / T, f"{arm.joints[k]} was to"
        by = f"by {self.controller}'s command"
        if abs(change) > (1.0 + SLACK) * arm.acceleration[k]:
            what, given, allowed = "accelerate", f"{change:.4g} {unit}/s^2", arm.acceleration[k]
            return f"{who} {what} {by} at {given}, allowed {allowed:.4g} {unit}/s^2; {ABRUPT}"
        if abs(jerk) > (1.0 + SLACK) * arm.jerk[k]:
            given, allowed = f"{jerk:.4g} {unit}/s^3", arm.jerk[k]
            return (
                f"{who} move {by} with a jerk of {given}, allowed {allowed:.4g} {unit}/s^3; "
                f"{ABRUPT}"
            )
        if abs(change) > float(braking_speed(room, arm.jerk[k], T)) and change * v > 0.0:
            return (
                f"{who} accelerate {by} at {change:.4g} {unit}/s^2 and {v:.4g} {unit}/s, too much "
                f"to stay below {arm.velocity[k]:.4g} {unit}/s; {ABRUPT}"
            )
        side, limit = ("upper", arm.upper[k]) if v > 0.0 else ("lower", arm.lower[k])
        return (
            f"{who} move {by} at {v:.4g} {unit}/s, at {angle:.4g} {unit}, from where it cannot "
            f"stop before its {side} position limit, {limit:.4g} {unit}; {ABRUPT}"
        )


def check_speed(v: Array, arm: Arm, what: str, remedy: str) -> None:
    """Look for a joint above its speed limit.

    Args:
        v: (nv,) joint velocity [rad/s].
        arm: whose limits.
        what: the joint did, in words.
        remedy: what to do.

    Raises:
        LoopFault: there is one; the farthest above its limit is named.
    """
    if np.any(np.abs(v) > (1.0 + SLACK) * arm.velocity):
        k = int(np.argmax(np.abs(v) - arm.velocity))
        unit = arm.joint_units[k]
        raise LoopFault(
            f"{arm.joints[k]} {what} at {v[k]:.4g} {unit}/s, allowed {arm.velocity[k]:.4g} "
            f"{unit}/s; {remedy}"
        )
