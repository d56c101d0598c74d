"""What several controllers check: their options, and the reference of a cycle."""

from __future__ import annotations

import math

import numpy as np

from rcmqp import dualquaternion as dq
from rcmqp.errors import InvalidCommand, OptionError
from rcmqp.reference import Reference

UNIT_TOLERANCE = 1e-6
"""How far x_d may be from a unit dual quaternion."""


def check_gain(name: str, gain: float, period: float) -> None:
    """Refuse a gain [1/s] that is unstable at a sampling period [s].

    Raises:
        OptionError: with the numbers.
    """
    if not 0.0 < gain * period < 2.0:
        raise OptionError(
            f"{name} * period = {gain} 1/s * {period} s = {gain * period:.3g}; the law is stable "
            "only inside (0, 2), and without overshoot up to 1: give a positive gain, lower, or "
            "sample faster"
        )


def check_not_negative(name: str, value: float) -> None:
    """Refuse what is not a finite number of at least 0.

    Raises:
        OptionError: with the name and the value.
    """
    if not 0.0 <= value < math.inf:
        raise OptionError(f"{name} = {value}, it must be 0 or more, and finite")


def check_between(name: str, value: float, low: float, high: float) -> None:
    """Refuse what is not strictly between two numbers.

    Raises:
        OptionError: with the name and the value.
    """
    if not low < value < high:
        raise OptionError(f"{name} = {value}, it must lie between {low:g} and {high:g}")


def checked_reference(reference: Reference, rates: bool) -> Reference:
    """The reference as a law may see it: with its rates, or standing still.

    Args:
        reference: of this cycle.
        rates: whether the law knows how fast the reference and the trocar move.

    Raises:
        InvalidCommand: x_d is not a pose, or a number that the law uses is not finite.
    """
    dq.check_unit(reference.x_d, "x_d", UNIT_TOLERANCE)
    names = ("pivot", "x_d_dot", "pivot_dot") if rates else ("pivot",)
    for name in names:
        values = getattr(reference, name)
        if not np.isfinite(values).all():
            raise InvalidCommand(f"{name} is not finite: {values}")
    if rates:
        return reference
    return Reference(reference.x_d, np.zeros(8), reference.pivot, np.zeros(3))
