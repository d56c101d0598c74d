"""The loop's process, as the server's process sees it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

from rcmqp.errors import OptionError, RcmqpError

BUFFER = 1 << 16
"""Largest number of bytes that wait on the way to or from the loop; older ones are out of date."""

LEAVING = 20.0
"""How long the loop has to bring the arm to rest and to write the file [s]."""


class LoopEnded(RcmqpError):
    """The process of the loop has ended before its time, or did not begin."""


class LoopProcess:
    """A loop that waits for start(), runs until stop() or by itself, and then has last words.

    Attributes:
        channel: hands go and states come by it; it does not block.
        number: of the process.
    """

    def __init__(self, process: subprocess.Popen[str], channel: socket.socket) -> None:
        """Of a process that was told what to do."""
        self._process, self.channel, self.number = process, channel, process.pid

    def prepare(self) -> None:
        """Wait until the arm can move.

        Raises:
            LoopEnded: the loop cannot begin.
        """
        answer = self._line()
        if "ready" not in answer:
            raise LoopEnded(f"the loop cannot begin: {answer['error']}")

    def start(self) -> None:
        """Begin the first cycle."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # it was killed: its last words say so
            self._process.stdin.write("start\n")
            self._process.stdin.flush()

    def stop(self) -> None:
        """Ask the loop to bring the arm to rest and to end; do not wait for it."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()

    def kill(self) -> None:
        """End the process at once; last_words() then says so."""
        self._process.kill()

    def last_words(self) -> dict[str, Any]:
        """Wait for the loop's end, and return its report."""
        return self._line()

    def _line(self) -> dict[str, Any]:
        """The next line of JSON."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        found: dict[str, Any] = json.loads(line) if line else {}
        return found or {"error": "its process was killed"}


async def at_rest(loop: LoopProcess, last: asyncio.Task[dict[str, Any]]) -> dict[str, Any]:
    """Stop a loop, and kill it if it does not end in time; ``last`` waits for its last words."""
    loop.stop()
    try:
        return await asyncio.wait_for(asyncio.shield(last), LEAVING)
    except TimeoutError:
        loop.kill()  # then its channel ends, and with it the line that is waited for
        await last
        return {"fault": f"the loop did not come to rest in {LEAVING:g} s and was killed"}


def channel_ends() -> tuple[socket.socket, socket.socket]:
    """Both ends of a channel for messages between processes.

    Raises:
        OptionError: the system has no such thing.
    """
    if not hasattr(socket, "AF_UNIX"):
        raise OptionError("a live loop needs sockets of Unix, which this system does not have")
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)


@contextlib.contextmanager
def loop_process(header: dict[str, Any]) -> Iterator[LoopProcess]:
    """A process for a loop, told what to do; see session.run(). Ctrl-C is not for it."""
    with contextlib.ExitStack() as stack:
        ours, theirs = channel_ends()
        stack.enter_context(contextlib.closing(ours))
        ours.setblocking(False)
        with contextlib.closing(theirs):
            for end in (ours, theirs):  # each limits what it sends
                end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
            process = stack.enter_context(_process(theirs.fileno()))
            assert process.stdin is not None
            process.stdin.write(json.dumps(header | {"channel": theirs.fileno()}) + "\n")
            process.stdin.flush()
        yield LoopProcess(process, ours)


@contextlib.contextmanager
def _process(channel: int) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-m", "rcmqp.live.session"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        pass_fds=[channel],
        process_group=0,
        env={"OMP_NUM_THREADS": "1", **os.environ},
    ) as process:
        try:
            yield process
        finally:
            process.kill()
