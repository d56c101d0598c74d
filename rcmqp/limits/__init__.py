"""Limits: what the joint velocity must never do, as a box and as hard rows.

A new limit is a frozen dataclass derived from Limit (or Damper) with evaluate(), added to
LIMITS. combine() makes the bounds of a hierarchy of any number of them.
"""

from __future__ import annotations

from typing import Any

from rcmqp.limits.base import Constraint, Damper, Limit, check_gain, combine, intersect
from rcmqp.limits.instrument import (
    EntrySphere,
    KeepIn,
    KeepOut,
    SphereLimit,
    TrocarCone,
    TrocarDepth,
)
from rcmqp.limits.joints import JointLimits
from rcmqp.limits.speed import TrocarSpeed
from rcmqp.maths.options import check_name
from rcmqp.maths.smooth import braking_speed
from rcmqp.world.insertion import Insertion

LIMITS: dict[str, type[Limit]] = {
    limit.name: limit
    for limit in (JointLimits, TrocarSpeed, TrocarCone, TrocarDepth, KeepOut, KeepIn, EntrySphere)
}


def make_limit(name: str, insertion: Insertion, period: float, **options: Any) -> Limit:
    """Make a limit by name; what the insertion knows need not be given.

    Raises:
        UnknownName: the limit is not known, or does not have the option.
        OptionError: an option is missing or its value is not allowed, or a damper's gain is too
            high for the period.
    """
    check_name("limit", name, LIMITS, options)
    limit = LIMITS[name].made_for(insertion, period, **options)
    if isinstance(limit, Damper):
        check_gain(limit.gain, period)
    return limit


__all__ = [
    "LIMITS",
    "Constraint",
    "Damper",
    "EntrySphere",
    "JointLimits",
    "KeepIn",
    "KeepOut",
    "Limit",
    "SphereLimit",
    "TrocarCone",
    "TrocarDepth",
    "TrocarSpeed",
    "braking_speed",
    "combine",
    "intersect",
    "make_limit",
]
