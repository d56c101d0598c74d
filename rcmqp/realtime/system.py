"""What a loop asks of the system: priority, signals kept until the arm rests, a watch-dog."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import threading
from collections.abc import Callable, Iterator
from time import monotonic
from typing import Any, ParamSpec, TypeVar

from rcmqp.errors import OptionError, RcmqpError

PRIORITY = 80
"""Of SCHED_FIFO's 1 to 99: above all that is ordinary, below what the kernel needs itself."""


class Priority:
    """The priority of a process.

    Attributes:
        words: a description of it.
    """

    def __init__(self, words: str, *, taken: bool = False) -> None:
        """``taken``: the process was an ordinary one before."""
        self.words, self._taken = words, taken

    def give_up(self, why: str) -> None:
        """Make all threads ordinary, for good; nothing if the priority was not taken here."""
        if not self._taken:
            return
        self._taken = False
        for thread in threads():
            with contextlib.suppress(OSError):  # it has ended
                make_ordinary(thread)
        self.words += f", then ordinary, as {why}"


@contextlib.contextmanager
def real_time_priority() -> Iterator[Priority]:
    """Run before every ordinary process (SCHED_FIFO).

    Threads and processes that this thread starts inherit it. A thread that is real-time already
    stays as it is. Linux lets root do so, and whom ``rtprio`` in /etc/security/limits.conf names.

    Raises:
        OptionError: the system has no such thing, or does not permit it.
    """
    if not hasattr(os, "sched_setscheduler"):
        raise OptionError("this system has no real-time priorities; run without")
    if words := _started():
        yield Priority(words)
        return
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError as error:
        raise OptionError(
            "real-time priority is not permitted; become root, raise rtprio in "
            "/etc/security/limits.conf, or run without"
        ) from error
    except OSError as error:
        raise OptionError(
            f"this system gives no real-time priority ({error.strerror}); run without"
        ) from error
    try:
        yield Priority(f"real-time (SCHED_FIFO {PRIORITY})", taken=True)
    finally:
        os.sched_setscheduler(0, *before)


@contextlib.contextmanager
def priority_if_permitted() -> Iterator[Priority]:
    """Run at real-time priority where the system permits it; yield a description of the priority.

    On a machine with one processor it is not asked for: a loop that cannot keep its period would
    leave nothing to the others.
    """
    with contextlib.ExitStack() as stack:
        try:
            if processors() > 1 or _started():
                priority = stack.enter_context(real_time_priority())
            else:
                priority = Priority("ordinary, as there is one processor only")
        except OptionError as error:
            reason = str(error).partition(";")[0]
            priority = Priority(f"ordinary, as {reason}; rcmqp doctor says what to do")
        yield priority


def _started() -> str:
    """A description of the real-time priority that this thread has; empty if it has none."""
    try:
        name = _real_time(os.sched_getscheduler(0))
        level = os.sched_getparam(0).sched_priority
    except (AttributeError, OSError):
        return ""
    return f"real-time ({name} {level}), as it was started" if name else ""


def _real_time(policy: int) -> str:
    """The name of a real-time policy; empty for another one."""
    policy &= ~getattr(os, "SCHED_RESET_ON_FORK", 0)
    return {os.SCHED_FIFO: "SCHED_FIFO", os.SCHED_RR: "SCHED_RR"}.get(policy, "")


def make_ordinary(thread: int = 0) -> None:
    """Give a thread the ordinary priority if it has a real-time one; 0 for the calling thread."""
    if hasattr(os, "sched_setscheduler") and _real_time(os.sched_getscheduler(thread)):
        os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))


def threads() -> list[int]:
    """The numbers of this process' threads, also of those that Python did not start."""
    try:
        return [int(name) for name in os.listdir("/proc/self/task")]
    except OSError:
        return [each.native_id for each in threading.enumerate() if each.native_id is not None]


def processors() -> int:
    """How many processors this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def time_waited(path: str = "/proc/thread-self/schedstat") -> float:
    """Time in which this thread was ready to run and waited for a processor [s].

    Linux counts it; NaN where the system does not.
    """
    try:
        with open(path, encoding="ascii") as file:
            _, waited, slices = (int(number) for number in file.read().split())
    except (OSError, ValueError):
        return math.nan
    return 1e-9 * waited if slices else math.nan


ENDING = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
"""Ctrl-C, being told to end, and a terminal that is gone."""

LEAVE = getattr(signal, "SIGURG", None)
"""Gets the main thread out of a call that hangs; without a handler, it does nothing."""

P = ParamSpec("P")
R = TypeVar("R")


class KeptSignals:
    """Notes Ctrl-C, SIGTERM and SIGHUP while an arm moves; they do not end the program.

    A handler that raises does so on any line, between a command and the note of it, or in the
    midst of the stop. This one raises out of a call() that hangs, and nowhere else.

    Attributes:
        caught: the number of the first one; 0 for none.
    """

    def __init__(self, patience: float) -> None:
        """Not kept yet; a call() that takes longer than ``patience`` [s] hangs."""
        self.caught = 0
        self._function: Callable[..., object] | None = None
        self._left: BaseException | None = None
        self._leaves = False
        self._patience, self._since = patience, math.inf

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """Keep them in here. Only the main thread gets any, and one that is ignored stays so."""
        before: dict[int, Any] = {}
        try:
            if threading.current_thread() is threading.main_thread():
                for number in ENDING:
                    handler = signal.getsignal(number)
                    if handler not in (signal.SIG_IGN, None):  # None: not Python's own
                        before[number] = handler
                        signal.signal(number, self._note)
                if LEAVE is not None and (handler := signal.getsignal(LEAVE)) is not None:
                    before[LEAVE] = handler
                    signal.signal(LEAVE, self._raise)
                    self._leaves = True
            yield
        finally:  # Ctrl-C last: it may come at once
            self._leaves = False
            for number, handler in reversed(before.items()):
                signal.signal(number, handler)

    def call(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the function and return its result.

        Raises:
            KeyboardInterrupt: it hung, and a signal came.
            BaseException: what leave() was given while it hung.
        """
        try:
            self._function = function
            self._since = monotonic()
            return function(*args, **kwargs)
        finally:
            self._since = math.inf

    def where(self) -> str:
        """The name of the function that a call() is in; empty where it is in none."""
        function = self._function if self._since < math.inf else None
        return "" if function is None else getattr(function, "__name__", repr(function))

    def leave(self, error: BaseException) -> None:
        """Raise this error out of a call() that hangs in the main thread, from another thread."""
        if self._leaves and LEAVE is not None:
            self._left = error
            signal.pthread_kill(threading.main_thread().ident or 0, LEAVE)

    def _raise(self, number: int, frame: object) -> None:
        error, self._left = self._left, None
        if error is not None and self._since < math.inf:
            self._since = math.inf
            raise error

    def _note(self, number: int, frame: object) -> None:
        self.caught = self.caught or number
        if monotonic() - self._since > self._patience:
            self._since = math.inf
            raise KeyboardInterrupt


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
