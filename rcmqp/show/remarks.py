"""Why rows of one table differ: the sentences below it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rcmqp.controllers import CONTROLLERS
from rcmqp.errors import PluginError

if TYPE_CHECKING:
    from rcmqp.show.tables import Row

FEED_FORWARD = (
    "feed-forward: without it a law does not know how fast reference and trocar move, and stays "
    "behind by about their speed / K. With it, and no limit in the way, what is left is about "
    "their acceleration * T / (2 K)."
)
ROLL = (
    "roll held: a law that does not hold it lets the instrument turn about its shaft, and its "
    "orientation error is mostly that turn."
)
LIMITS = (
    "joint limits: a law keeps those that are named as enforced. It does not count the others, "
    "and may break them."
)


def remarks(rows: Sequence[Row]) -> list[str]:
    """What a reader of these rows has to know of their laws to see why they differ."""
    made = [row for row in rows if not row.failure]
    found = []
    if {"yes", "no"} <= {row.feed_forward for row in made}:
        found.append(FEED_FORWARD)
    if {"yes", "no"} <= {row.roll for row in made}:
        found.append(ROLL)
    uncounted = any(not row.limits_kept and row.limits_enforced != "all" for row in made)
    if uncounted or len({row.limits_enforced for row in made}) > 1:
        found.append(LIMITS)
    laws = dict.fromkeys(row.controller.partition(",")[0] for row in made)
    return found + [f"{law}: {remark}" for law in laws if (remark := _remark(law))]


def _remark(law: str) -> str:
    """What a law says of itself; nothing if this machine does not have it."""
    try:
        return CONTROLLERS[law].remark if law in CONTROLLERS else ""
    except PluginError:
        return ""
