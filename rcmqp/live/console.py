"""rcmqp live: starts the loop's process and the server, and reports at the end."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import secrets
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcmqp.errors import OptionError, RcmqpError
from rcmqp.live import LOCAL
from rcmqp.live.page import page
from rcmqp.live.server import Console, Server
from rcmqp.live.session import quantiles
from rcmqp.realtime.signals import ENDING
from rcmqp.runs.head import check_own
from rcmqp.runs.scenario import Scenario
from rcmqp.show.table import Table

BUFFER = 1 << 16
"""Largest number of bytes that wait on the way to or from the loop; older ones are out of date."""


LEAVING = 20.0
"""How long the loop has to bring the arm to rest and to write the file [s]."""


class LoopEnded(RcmqpError):
    """The process of the loop has ended before its time, or did not begin."""


@dataclass(frozen=True)
class LiveReport:
    """The result of a session.

    Attributes:
        text: tables in Markdown: the loop, its latencies, what the server dropped.
        fault: why the loop stopped by itself; empty if it did not.
    """

    text: str
    fault: str


def run_live(
    scenario: Scenario,
    controller: str,
    options: dict[str, Any],
    *,
    scale: float = 1.0,
    viscosity: float = 15.0,
    host: str = LOCAL[0],
    port: int = 0,
    out: Path | None = None,
    started: Callable[[str], None] = lambda address: None,
) -> LiveReport:
    """Serve the console until Ctrl-C, or until the loop stops by itself.

    Args:
        scenario: where the arm and the camera are; its path is not followed.
        controller: its name.
        options: of the controller.
        scale: tip over hand.
        viscosity: of the device [N s/m].
        host: the interface to listen on.
        port: to listen at; 0 for any that is free.
        out: file to record the session into.
        started: is called with the address of the page, which has the token.

    Raises:
        OptionError: the port is taken, or the interface is not this machine's.
        LoopEnded: the loop cannot begin.
        RcmqpError: the scenario cannot be run.
    """
    if out is not None:
        check_own(out)
    token, text = secrets.token_urlsafe(16), page(scenario, controller, options)
    with _listening(host, port) as listener, contextlib.ExitStack() as stack:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        stack.enter_context(contextlib.closing(ours))
        ours.setblocking(False)
        header = {
            "scenario": scenario.to_json(carry=True),
            "controller": controller,
            "options": options,
            "hand": {"scale": scale, "viscosity": viscosity},
            "out": None if out is None else str(out),
            "channel": theirs.fileno(),
        }
        with contextlib.closing(theirs):
            for end in (ours, theirs):  # each limits what it sends
                end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
            process = stack.enter_context(_session(theirs.fileno()))
        _begin(process, header)
        console = Console(text, token, ours, local=host in LOCAL)
        address = f"http://{host}:{listener.getsockname()[1]}/?token={token}"
        ended = asyncio.run(_serve(console, listener, process, lambda: started(address)))
    return _report(console, ended)


async def _serve(
    console: Console,
    listener: socket.socket,
    process: subprocess.Popen[str],
    started: Callable[[], None],
) -> dict[str, Any]:
    """Serve until the server or the loop ends; the loop's last words."""
    server = Server(console.app)
    console.listen()
    for number in ENDING:
        asyncio.get_running_loop().add_signal_handler(number, server.leave)
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    last = asyncio.create_task(asyncio.to_thread(_line, process))
    while not server.started and not serving.done():
        await asyncio.sleep(0.01)
    started()
    await asyncio.wait({serving, last}, return_when=asyncio.FIRST_COMPLETED)
    if last.done():
        console.end(last.result().get("fault") or last.result().get("error") or "it was stopped")
        await asyncio.sleep(0.2)  # the pages are told
        server.should_exit = True
    else:
        assert process.stdin is not None
        process.stdin.close()  # the arm comes to rest
    await serving
    try:
        return await asyncio.wait_for(asyncio.shield(last), LEAVING)
    except TimeoutError:
        process.kill()  # then its channel ends, and with it the line that is waited for
        await last
        return {"fault": f"the loop did not come to rest in {LEAVING:g} s and was killed"}


@contextlib.contextmanager
def _listening(host: str, port: int) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((host, port))
        except (OSError, OverflowError) as error:
            raise OptionError(
                f"cannot listen at {host}:{port}: {error}; choose another --port, or leave it "
                "out for any that is free"
            ) from error
        yield listener


@contextlib.contextmanager
def _session(channel: int) -> Iterator[subprocess.Popen[str]]:
    """The loop's process; Ctrl-C is for this one alone."""
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


def _begin(process: subprocess.Popen[str], header: dict[str, Any]) -> None:
    """Tell the loop's process what to do, and wait until the arm can move."""
    assert process.stdin is not None
    process.stdin.write(json.dumps(header) + "\n")
    process.stdin.flush()
    answer = _line(process)
    if "ready" not in answer:
        raise LoopEnded(f"the loop cannot begin: {answer['error']}")


def _line(process: subprocess.Popen[str]) -> dict[str, Any]:
    """The next line of JSON of the loop's process."""
    assert process.stdout is not None
    line = process.stdout.readline()
    found: dict[str, Any] = json.loads(line) if line else {}
    return found or {"error": "its process was killed"}


def _report(console: Console, ended: dict[str, Any]) -> LiveReport:
    if "error" in ended:
        raise LoopEnded(f"the loop has ended: {ended['error']}")
    latencies = {
        "input event to command": ended["latency"]["input"],
        "command to state": ended["latency"]["state"],
        "state to picture": quantiles(console.drawn.latency()),
    }
    rows = [
        (name, *(f"{1e3 * value:.1f} ms" for value in values[:3]), str(values[3]))
        for name, values in latencies.items()
    ]
    tables = [
        ended["report"],
        Table(("latency", "median", "p95", "p99", "of"), rows).markdown(),
        Table(("pages", ""), [*ended["rows"], *console.desk.counts.rows()]).markdown(),
    ]
    return LiveReport("\n\n".join(text.rstrip() for text in tables), ended["fault"])
