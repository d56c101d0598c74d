"""What the cycles of a loop leave, for who keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan
from typing import NamedTuple, Protocol

import numpy as np

from rcmqp.controllers.base import Command
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.deadlines import Deadlines
from rcmqp.references.view import Stamped
from rcmqp.world.arm import Arm


class Recording(Protocol):
    """Keeps a loop's cycles; rcmqp.runs.loop_record has one that writes a run's file."""

    def start(self) -> None:
        """Get ready, before anything moves; an error that this raises is the caller's."""
        ...

    def add(
        self,
        due: float,
        began: float,
        sent: float,
        reading: tuple[Array, Array],
        asked: tuple[object, Array, float],
        v: Array,
        diagnostics: Mapping[str, float],
        stop: str,
        solve_time: float,
    ) -> None:
        """Take a cycle whose command was sent; return at once and raise nothing.

        Args:
            due: when the cycle was due, from the start of the loop [s].
            began: when it began [s]; NaN in the safe stop.
            sent: when its command had been sent [s].
            reading: q (nq,) and v (nv,) [rad/s] as read; NaN where nothing could be read.
            asked: the last pose asked for, x_d (8,), as the reference has it; the trocar (3,)
                [m]; the time of the reference [s].
            v: (nv,) the velocity sent [rad/s].
            diagnostics: of the controller's answer.
            stop: why the joints braked instead of following; empty where they did not.
            solve_time: how long the controller took [s]; NaN if it was not asked.
        """
        ...

    def close(self, fault: str) -> str:
        """Finish, once the arm is at rest; return what was kept, in words for the report.

        Args:
            fault: why the loop ended before its time; empty where it did not.
        """
        ...


class Asked(NamedTuple):
    """What a cycle asked for, and the controller's answer.

    Attributes:
        newest: the reference.
        pivot: (3,) the trocar, where it was last seen [m].
        answer: of the controller.
        solve_time: how long that took [s].
    """

    newest: Stamped
    pivot: Array
    answer: Command
    solve_time: float


class Notes:
    """Holds what a loop's cycle read and asked until its command is sent, then gives it away.

    Attributes:
        asked: by the last cycle; None before the first.
        reading: q (nq,) and v (nv,) of a cycle of the safe stop; None if it could not read.
    """

    def __init__(self, record: Recording | None, arm: Arm) -> None:
        """Give it to ``record``, or to nobody."""
        self.asked: Asked | None = None
        self.reading: tuple[Array, Array] | None = None
        self._record = record
        self._nothing = np.full(arm.nq, nan), np.full(arm.nv, nan)

    def start(self) -> None:
        """Nothing has been asked; the record may raise."""
        if self._record is not None:
            self._record.start()

    def sent(
        self, due: float, began: float, sent: float, reading: tuple[Array, Array], v: Array
    ) -> None:
        """The loop sent ``v`` (nv,); times in [s]."""
        if self._record is not None and self.asked is not None:
            newest, pivot, answer, solve_time = self.asked
            asked = newest.reference.x_d, pivot, newest.at
            self._record.add(
                due, began, sent, reading, asked, v, answer.diagnostics, answer.stop, solve_time
            )

    def braked(self, due: float, timing: Deadlines, v: Array, fault: str) -> None:
        """The safe stop sent ``v`` (nv,)."""
        if self._record is not None and self.asked is not None:
            newest, pivot = self.asked[:2]
            asked, reading = (newest.reference.x_d, pivot, newest.at), self.reading
            why = f": {fault}" if fault else ", as it ends every run"
            self._record.add(
                due,
                nan,
                timing.now(),
                reading or self._nothing,
                asked,
                v,
                {"safe_stop": 1.0},
                f"the real-time loop brought the arm to rest{why}",
                nan,
            )

    def close(self, fault: str) -> str:
        """What the record kept, in words; empty without one."""
        record, self._record = self._record, None
        return "" if record is None else record.close(fault)
