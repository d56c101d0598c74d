"""What a real-time loop is given, looked at before an arm moves by it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.arm import Arm
from rcmqp.dualquaternion import Array
from rcmqp.errors import InvalidCommand, RcmqpError
from rcmqp.reference import Reference

SLACK = 1e-3
"""Share of a speed limit that a command may be above it: a solver's tolerance, and cut off."""


@dataclass(frozen=True, slots=True, eq=False)
class Stamped:
    """A reference, and when it was made.

    Attributes:
        reference: what the controller is told.
        at: the time that it is for, from the start of the loop [s].
    """

    reference: Reference
    at: float


class LoopFault(RcmqpError):
    """A reference is too old, or a command too late or too fast, to be followed."""


def as_reading(answer: object, arm: Arm) -> tuple[Array, Array]:
    """Configuration (nq,) and joint velocity (nv,) [rad/s] that read() answered.

    Raises:
        InvalidCommand: they are not, or not finite.
    """
    sizes = {"configuration q": arm.nq, "joint velocity v": arm.nv}
    try:
        q, v = (np.array(values, dtype=float) for values in answer)  # type: ignore[attr-defined]
    except (TypeError, ValueError) as error:
        raise InvalidCommand(
            f"read() answered {answer!r}; it must be a pair of arrays, configuration q "
            f"({arm.nq},) and joint velocity v ({arm.nv},), as measured now"
        ) from error
    for (name, size), values in zip(sizes.items(), (q, v), strict=True):
        if values.shape != (size,):
            raise InvalidCommand(
                f"read() answered a {name} of shape {values.shape}, it must be ({size},)"
            )
        if not np.isfinite(values).all():
            raise InvalidCommand(f"{name} is not finite, as it was read: {values}")
    return q, v


def check_stamp(newest: object, now: float, oldest: float, ahead: float) -> Stamped:
    """The newest reference, if it is of ``now`` [s].

    Args:
        newest: what references(now) answered.
        now: from the start of the loop [s].
        oldest: how old it may be [s].
        ahead: how far in the future it may be stamped [s].

    Raises:
        InvalidCommand: it is no Stamped.
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


def as_command(v: ArrayLike, arm: Arm, controller: str) -> Array:
    """Joint velocity (nv,) [rad/s] that a controller answered, read-only, inside speed limits.

    Raises:
        InvalidCommand: it has another size, or is not finite.
        LoopFault: a joint cannot move so fast.
    """
    command = np.array(v, dtype=float)
    if command.shape != (arm.nv,) or not np.isfinite(command).all():
        raise InvalidCommand(f"{controller} answered {command}, not {arm.nv} finite numbers")
    if np.any(np.abs(command) > arm.velocity):
        what = f"was to move by {controller}'s command"
        remedy = (
            "take hierarchical_qp, or velocity_limit=scale where the controller has that option"
        )
        check_speed(command, arm, what, remedy)
        command = np.clip(command, -arm.velocity, arm.velocity)
    command.setflags(write=False)
    return command


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
        raise LoopFault(
            f"{arm.joints[k]} {what} at {v[k]:.4g} rad/s, allowed {arm.velocity[k]:.4g} rad/s; "
            f"{remedy}"
        )
