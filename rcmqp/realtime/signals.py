"""Signals that would end the program, kept until an arm is at rest."""

from __future__ import annotations

import contextlib
import math
import signal
import threading
from collections.abc import Callable, Iterator
from time import monotonic
from typing import Any, ParamSpec, TypeVar

ENDING = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
"""Ctrl-C, being told to end, and a terminal that is gone."""

P = ParamSpec("P")
R = TypeVar("R")


class KeptSignals:
    """What Ctrl-C, SIGTERM and SIGHUP do while an arm moves: they are noted, and end nothing.

    A handler that raises does so on any line, between a command and the note of it, or in the
    midst of the stop. This one raises out of a call() that hangs, and nowhere else.

    Attributes:
        caught: the number of the first one; 0 for none.
    """

    def __init__(self, patience: float) -> None:
        """Not kept yet; a call() that takes longer than ``patience`` [s] hangs."""
        self.caught = 0
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
            yield
        finally:  # Ctrl-C last: it may come at once
            for number, handler in reversed(before.items()):
                signal.signal(number, handler)

    def call(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """What the function returns.

        Raises:
            KeyboardInterrupt: it hung, and a signal came.
        """
        try:
            self._since = monotonic()
            return function(*args, **kwargs)
        finally:
            self._since = math.inf

    def _note(self, number: int, frame: object) -> None:
        self.caught = self.caught or number
        if monotonic() - self._since > self._patience:
            self._since = math.inf
            raise KeyboardInterrupt
