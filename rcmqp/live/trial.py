"""rcmqp trial: a participant's sitting, served like the live console."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
from collections.abc import Callable

from rcmqp.errors import RcmqpError
from rcmqp.experiments.trial.design import Design
from rcmqp.experiments.trial.people import Folder
from rcmqp.live import LOCAL
from rcmqp.live.console import listening
from rcmqp.live.forms import waiting_page
from rcmqp.live.loop_process import channel_ends
from rcmqp.live.server import Console, Server
from rcmqp.live.sitting import BrokenOff, Sitting
from rcmqp.realtime.system import ENDING


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
        return asyncio.run(_serve(console, sitting, listener, lambda: started(address)))


async def _serve(
    console: Console, sitting: Sitting, listener: socket.socket, started: Callable[[], None]
) -> str:
    """Serve until the sitting is over or somebody ends the server."""
    server = Server(console.app)
    console.listen()
    for number in ENDING:
        asyncio.get_running_loop().add_signal_handler(number, server.leave)
    sit = asyncio.create_task(sitting.run())
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    while not server.started and not serving.done():
        await asyncio.sleep(0.01)
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
