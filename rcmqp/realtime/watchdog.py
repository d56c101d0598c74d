"""A thread that halts a robot where the loop that commands it hangs."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from time import monotonic

from rcmqp.errors import RcmqpError


class LoopHung(RcmqpError):
    """A cycle did not end in time, and the robot was halted from outside the loop's thread."""


class Watchdog:
    """Calls a robot's halt() where no cycle has ended for some time.

    The thread wakes once per ``patience``, so it costs a cycle nothing but the note that it has
    ended. It needs Python's lock: a read() or send() written in C that hangs must have released
    it, as every blocking call should.

    Attributes:
        hung: set once no cycle has ended in time; the robot ignores later commands.
        halted: a call of halt() returned.
        failure: what the last halt() raised, in words.
    """

    def __init__(
        self,
        halt: Callable[[], object],
        patience: float,
        where: Callable[[], str],
        leave: Callable[[], None],
    ) -> None:
        """Not started yet.

        Args:
            halt: brings the robot to rest, from any thread, however often it is called.
            patience: how long after the last cycle's end the next one may end [s].
            where: says, for the error, what the loop is in.
            leave: gets the loop out of the call that hangs, if that is possible.
        """
        self.hung: LoopHung | None = None
        self.halted, self.failure = False, ""
        self._halt, self._patience, self._where, self._leave = halt, patience, where, leave
        self._seen = math.inf
        self._closed, self._tried = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._watch, name="rcmqp watch-dog", daemon=True)
        self._started = False

    def beat(self) -> None:
        """Note that a cycle has ended; the first time, begin to watch."""
        self._seen = monotonic()
        if not self._started:
            self._started = True
            self._thread.start()

    def settled(self) -> bool:
        """Wait for the first halt() to return or raise; whether the robot was halted."""
        self._tried.wait(self._patience)
        self._tried.set()  # a halt() that hangs, too, is waited for only once
        return self.halted

    def close(self) -> None:
        """End the thread. If the loop hung, halt() is called once more, after all it has sent."""
        self._closed.set()
        if self._started and threading.current_thread() is not self._thread:
            self._thread.join(2.0 * self._patience)

    def _watch(self) -> None:
        left = self._patience
        while not self._closed.wait(left):
            left = self._seen + self._patience - monotonic()
            if left <= 0.0:
                break
        else:
            return
        self.hung = LoopHung(
            f"{self._where()}: no cycle has ended for {self._patience:.4g} s, so the robot's "
            "halt() was called"
        )
        self._call_halt()
        self._tried.set()
        self._leave()
        while not self.halted and not self._closed.wait(self._patience):
            self._call_halt()
        self._closed.wait()
        self._call_halt()

    def _call_halt(self) -> None:
        try:
            self._halt()
        except Exception as error:  # noqa: BLE001  (the next may get through)
            self.failure = f"{type(error).__name__}: {error}"
        else:
            self.halted = True
