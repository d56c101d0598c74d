"""Real-time priority for a loop that must not wait for other processes, and how long it did."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator

from rcmqp.errors import OptionError

PRIORITY = 80
"""Of SCHED_FIFO's 1 to 99: above all that is ordinary, below what the kernel needs itself."""


@contextlib.contextmanager
def real_time_priority() -> Iterator[None]:
    """Run before every ordinary process (SCHED_FIFO), and so do processes that this one starts.

    Linux lets root do so, and whom ``rtprio`` in /etc/security/limits.conf names.

    Raises:
        OptionError: the system has no such thing, or does not permit it.
    """
    if not hasattr(os, "sched_setscheduler"):
        raise OptionError("this system has no real-time priorities; run without")
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError as error:
        raise OptionError(
            "real-time priority is not permitted; become root, raise rtprio in "
            "/etc/security/limits.conf, or run without"
        ) from error
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def time_waited(path: str = "/proc/thread-self/schedstat") -> float:
    """How long this thread could have run so far and waited for a processor [s].

    Linux counts it; NaN where the system does not.
    """
    try:
        with open(path, encoding="ascii") as file:
            _, waited, slices = (int(number) for number in file.read().split())
    except (OSError, ValueError):
        return math.nan
    return 1e-9 * waited if slices else math.nan
