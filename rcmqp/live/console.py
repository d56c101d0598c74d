"""rcmqp live and rcmqp trial: the server with its pages, until a loop or a sitting is over."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcmqp.errors import OptionError, RcmqpError
from rcmqp.experiments.trial.design import Design
from rcmqp.experiments.trial.people import Folder
from rcmqp.live import LOCAL
from rcmqp.live.loop_process import LoopEnded, LoopProcess, at_rest, channel_ends, loop_process
from rcmqp.live.page import page, waiting_page
from rcmqp.live.server import Console, Server
from rcmqp.live.session import quantiles
from rcmqp.live.sitting import BrokenOff, Sitting
from rcmqp.realtime.system import ENDING
from rcmqp.runs.head import check_own
from rcmqp.runs.scenario import Scenario
from rcmqp.show.table import Table


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
    law_file: str | None = None,
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
        law_file: FILE.py:CLASS of a user's controller. The caller has registered it; the loop's
            process loads it again.
        started: is called with the address of the page, which has the token.

    Raises:
        OptionError: the port is taken, or the interface is not this machine's.
        LoopEnded: the loop cannot begin.
        RcmqpError: the scenario cannot be run.
    """
    if out is not None:
        check_own(out)
    token, text = secrets.token_urlsafe(16), page(scenario, controller, options)
    header = {
        "scenario": scenario.to_json(carry=True),
        "controller": law_file or controller,
        "options": options,
        "hand": {"scale": scale, "viscosity": viscosity},
        "out": None if out is None else str(out),
    }
    with listening(host, port) as listener, loop_process(header) as loop:
        loop.prepare()
        console = Console(text, token, loop.channel, local=host in LOCAL)
        address = f"http://{host}:{listener.getsockname()[1]}/?token={token}"
        ended = asyncio.run(_serve_loop(console, listener, loop, lambda: started(address)))
    return _report(console, ended)


async def _serve_loop(
    console: Console,
    listener: socket.socket,
    loop: LoopProcess,
    started: Callable[[], None],
) -> dict[str, Any]:
    """Serve until the server or the loop ends; the loop's last words."""
    server, serving = await _served(console, listener)
    last = asyncio.create_task(asyncio.to_thread(loop.last_words))
    loop.start()
    started()
    await asyncio.wait({serving, last}, return_when=asyncio.FIRST_COMPLETED)
    if last.done():
        why = last.result().get("fault") or last.result().get("error") or "it was stopped"
        console.end(f"the loop has ended: {why}")
        await asyncio.sleep(0.2)  # the pages are told
        server.leave()
    else:
        loop.stop()
    await serving
    return await at_rest(loop, last)


def _report(console: Console, ended: dict[str, Any]) -> LiveReport:
    if "error" in ended:
        raise LoopEnded(f"the loop has ended: {ended['error']}")
    latencies = {
        "input event to command": ended["latency"]["input"],
        "command to state": ended["latency"]["state"],
        "state to picture": quantiles(console.drawn.latency()),
    }
    rows = [latency_row(name, *values) for name, values in latencies.items()]
    tables = [
        ended["report"],
        Table(("latency", "median", "p95", "p99", "of"), rows).markdown(),
        Table(("pages", ""), [*ended["rows"], *console.desk.counts.rows()]).markdown(),
    ]
    return LiveReport("\n\n".join(text.rstrip() for text in tables), ended["fault"])


def latency_row(name: str, median: float, p95: float, p99: float, count: float) -> tuple[str, ...]:
    """A row of the report: quantiles of a latency [s], a dash where nothing was measured."""
    texts = (f"{1e3 * each:.1f} ms" if count else "-" for each in (median, p95, p99))
    return name, *texts, f"{count:.0f}"


def run_trial(
    design: Design,
    folder: Folder,
    identifier: str,
    *,
    port: int = 0,
    started: Callable[[str], None] = lambda address: None,
) -> str:
    """Serve a participant until all is done; empty then, or why it was broken off.

    Only this machine can reach the page.

    Args:
        design: of the study.
        folder: of the study.
        identifier: of the participant, see checked_id().
        port: to listen at; 0 for any that is free.
        started: is called with the address of the page, which has the token.

    Raises:
        OptionError: the port is taken.
        RcmqpError: a loop cannot begin, or a file cannot be written.
    """
    token = secrets.token_urlsafe(16)
    nowhere, other = channel_ends()  # before the first loop
    nowhere.setblocking(False)
    with nowhere, other, listening(LOCAL[0], port) as listener:
        console = Console(waiting_page(), token, nowhere, local=True)
        sitting = Sitting(design, folder, identifier, console)
        address = f"http://{LOCAL[0]}:{listener.getsockname()[1]}/?token={token}"
        return asyncio.run(_serve_sitting(console, sitting, listener, lambda: started(address)))


async def _serve_sitting(
    console: Console, sitting: Sitting, listener: socket.socket, started: Callable[[], None]
) -> str:
    """Serve until the sitting is over or somebody ends the server."""
    server, serving = await _served(console, listener)
    sit = asyncio.create_task(sitting.run())
    started()
    await asyncio.wait({serving, sit}, return_when=asyncio.FIRST_COMPLETED)
    if not sit.done():
        sit.cancel()
        with contextlib.suppress(asyncio.CancelledError, RcmqpError):
            await sit
        return "the server was ended"
    await asyncio.sleep(0.2)  # the pages are told
    server.leave()
    await serving
    try:
        sit.result()
    except BrokenOff as error:
        return str(error)
    return ""


async def _served(console: Console, listener: socket.socket) -> tuple[Server, asyncio.Task[None]]:
    """Start a server; return it and the task that ends with it. Ctrl-C ends it."""
    server = Server(console.app)
    console.listen()
    for number in ENDING:
        asyncio.get_running_loop().add_signal_handler(number, server.leave)
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    while not server.started and not serving.done():
        await asyncio.sleep(0.01)
    return server, serving


@contextlib.contextmanager
def listening(host: str, port: int) -> Iterator[socket.socket]:
    """A socket that listens; the server serves it.

    Raises:
        OptionError: the port is taken, or the interface is not this machine's.
    """
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
