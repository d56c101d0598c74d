"""Checks of a controller's options, and of the state and the reference of a cycle."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rcmqp._kernel import all_finite, usable
from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import Metadata, at_least, declared, positive
from rcmqp.references.view import STILL, Reference
from rcmqp.world.arm import ArmState

UNIT_TOLERANCE = 1e-6
"""How far x_d may be from a unit dual quaternion."""


TIMES_PERIOD = "times period"


def bounded_gain(
    *, below: float = 2.0, up_to: float = math.inf, or_zero: bool = False
) -> Metadata:
    """A gain [1/s] whose product with the sampling period is bounded, see check_gains().

    Args:
        below: bound of the product that it must not reach; from 2 on a law is unstable, and
            above 1 it overshoots.
        up_to: bound of the product that it may reach.
        or_zero: whether the gain may be 0.
    """
    own = at_least(0.0, "1/s") if or_zero else positive("1/s")
    return {**own, TIMES_PERIOD: (below, up_to)}


def check_gains(law: object, period: float) -> None:
    """Refuse a gain of a law that is too high for a sampling period [s].

    Raises:
        OptionError: with the numbers.
    """
    for name, (below, up_to) in declared(type(law), TIMES_PERIOD).items():
        value = getattr(law, name)
        product = value * period
        if not (product < below and product <= up_to):
            most = f"below {below:g}" if below <= up_to else f"at most {up_to:g}"
            wrong = "the law is unstable" if min(below, up_to) > 1.0 else "its limit is overrun"
            raise OptionError(
                f"{name} * period = {value} 1/s * {period} s = {product:.3g}, it must be {most}, "
                f"or {wrong}: give a lower {name}, or sample faster"
            )


def is_usable(state: ArmState, reference: Reference) -> bool:
    """Whether fault() would find nothing, and every array is one that compiled code can read."""
    return usable(
        state.J_local,
        state.x,
        state.angles,
        state.q,
        state.v,
        state.a,
        reference.x_d,
        reference.x_d_dot,
        reference.pivot,
        reference.pivot_dot,
        UNIT_TOLERANCE,
    )


def as_numbers(state: ArmState, reference: Reference) -> tuple[ArmState, Reference]:
    """The same two in contiguous arrays of float64; NaN where there are no numbers."""
    vectors: dict[str, Any] = {
        name: _numbers(getattr(state, name)) for name in ("q", "angles", "x", "v", "a")
    }
    state = dataclasses.replace(
        state, J_local=np.ascontiguousarray(state.J_local, dtype=float), **vectors
    )
    return state, Reference(*(_numbers(getattr(reference, name)) for name in _SIZES))


def _numbers(values: ArrayLike) -> Array:
    try:
        return np.array(values, dtype=float, order="C")
    except (TypeError, ValueError, OverflowError):  # an int beyond 1e308 overflows
        return np.array([np.nan])


def fault(state: ArmState, reference: Reference) -> str:
    """Why a controller cannot follow, in words; empty if nothing does.

    A rate that the law does not use counts too: a sender of NaN is not to be relied on.
    """
    if not all_finite(state.q):
        return "the joint reading q is not finite"
    if not all_finite(state.v):
        return "the joint velocity v is not finite"
    if not all_finite(state.a):
        return "the joint acceleration a is not finite"
    for name, size in _SIZES.items():
        values = getattr(reference, name)
        if values.shape != (size,):
            return f"{name} of the reference has not {size} numbers"
        if not all_finite(values):
            return f"{name} of the reference is not finite"
    if not dq.is_unit(reference.x_d, UNIT_TOLERANCE):
        return (
            "x_d of the reference is not a unit dual quaternion to "
            f"{UNIT_TOLERANCE:g}: give it to normalized()"
        )
    return ""


_SIZES = {"x_d": 8, "x_d_dot": 8, "pivot": 3, "pivot_dot": 3}


_POSE_AT_REST: Array = np.zeros(8)
_POSE_AT_REST.setflags(write=False)


def at_rest(reference: Reference) -> Reference:
    """The reference as a law sees it that knows no rates."""
    return Reference(reference.x_d, _POSE_AT_REST, reference.pivot, STILL)
