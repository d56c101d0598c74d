"""Which priority the threads of other processes have, and which they may have."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rcmqp.errors import OptionError
from rcmqp.realtime.system import processors, real_time_priority

shows_priorities = pytest.mark.skipif(
    not Path("/proc/self/task").is_dir(),
    reason="this system does not show the priority of another process's threads",
)
"""For tests that look at the loop's process from outside: elsewhere there is nothing to read."""


def policies(pid: int) -> set[int]:
    """Scheduling policies of a process's threads."""
    return {os.sched_getscheduler(int(task.name)) for task in Path(f"/proc/{pid}/task").iterdir()}


def may_be_real_time() -> bool:
    """Whether a loop that is started now gets real-time priority."""
    try:
        with real_time_priority() as priority:
            return processors() > 1 and not priority.words.endswith("started")
    except OptionError:
        return False
