"""The server of the console: a page, and sockets between pages and the loop's process."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import math
import socket
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from rcmqp.live import LOCAL
from rcmqp.live.desk import Desk, Visitor
from rcmqp.live.messages import Hand, Ping, Said, Take
from rcmqp.realtime.latency import LatencyCounter

SECURITY = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""Headers of the page: its address has the token, which must not get around."""

REFUSED = 4403
"""Code of a socket that is closed at once."""

HUGE = 1 << 16
"""Bytes of a message beyond which a page is cut off."""


class Server(uvicorn.Server):
    """Leaves signals alone: uvicorn's own would end the program once the server has ended."""

    def __init__(self, app: Starlette) -> None:
        """Serve an application, when serve() is called."""
        config = uvicorn.Config(
            app,
            log_level="error",
            ws="websockets-sansio",
            ws_max_size=HUGE,
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=1,
            lifespan="off",
        )
        super().__init__(config)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture none."""
        yield

    def leave(self) -> None:
        """End soon."""
        self.should_exit = True


class Console:
    """The console's server: it passes hands from pages to the loop, and states back to pages.

    Attributes:
        page: HTML, what a page shows from its next load on.
        said: a function that is called with each answer of a participant of a trial.
        desk: who steers, and what was dropped.
        drawn: latency from sending a state to its picture, as the pages report it.
        devices: those of messages.DEVICES that steered so far; may be cleared.
        ended: why the loop ended; None while it runs.
    """

    def __init__(self, page: str, token: str, channel: socket.socket, *, local: bool) -> None:
        """Serve a page; hands go and states come by ``channel``, which does not block.

        Args:
            page: HTML.
            token: that every request needs.
            channel: to the loop.
            local: whether only names of this machine are ours.
        """
        self.desk, self.drawn = Desk(), LatencyCounter()
        self.devices = set[str]()
        self.ended: str | None = None
        self.page = page
        self.said: Callable[[Said], None] = lambda said: None
        self._token, self._channel, self._local = token, channel, local
        self._pages: dict[Visitor, Latest] = {}
        self.app = Starlette(
            routes=[Route("/", self._show), WebSocketRoute("/hand", self._serve)],
        )

    def listen(self) -> None:
        """Pass on from now on, in the running event loop, what the loop's process says."""
        asyncio.get_running_loop().add_reader(self._channel, self._receive)

    def turn(self, channel: socket.socket) -> socket.socket:
        """Go on with the channel of another loop, which does not block; the one before."""
        asyncio.get_running_loop().remove_reader(self._channel)
        before, self._channel = self._channel, channel
        self.listen()
        return before

    def end(self, why: str) -> None:
        """Tell every page that the loop has ended, and why in a sentence."""
        self.ended = why
        for latest in self._pages.values():
            latest.put(_ended(why))

    def tell(self, words: dict[str, Any]) -> None:
        """Tell every page something."""
        for latest in self._pages.values():
            latest.answer(words)

    def _receive(self) -> None:
        """The newest state goes to every page."""
        newest = None
        with contextlib.suppress(OSError):
            while data := self._channel.recv(65536):
                newest = data
        if newest is not None and self.ended is None:
            text = newest.decode()
            for latest in self._pages.values():
                latest.put(text)

    async def _show(self, request: Request) -> Response:
        """Return the page if the request has the token."""
        if not self._is_ours(request.headers):
            self.desk.counts.foreign += 1
            return PlainTextResponse("this name is not the console's\n", 403)
        if not self._knows(request.query_params):
            self.desk.counts.wrong_token += 1
            return PlainTextResponse(
                "open the address that rcmqp live prints: it ends in a token\n", 403
            )
        return HTMLResponse(self.page, headers=SECURITY)

    async def _serve(self, page: WebSocket) -> None:
        """One page, from its first word to its last."""
        origin = page.headers.get("origin", "")
        if not self._is_ours(page.headers) or origin != f"http://{page.headers['host']}":
            self.desk.counts.foreign += 1
            await page.close(REFUSED)
            return
        if not self._knows(page.query_params):
            self.desk.counts.wrong_token += 1
            await page.close(REFUSED)
            return
        await page.accept()
        visitor, latest = Visitor(), Latest()
        self._pages[visitor] = latest
        if self.ended is not None:
            latest.put(_ended(self.ended))
        telling = asyncio.create_task(latest.pass_on(page.send_text))
        try:
            await self._hear(page, visitor, latest)
        finally:
            telling.cancel()
            del self._pages[visitor]
            self._leave(visitor)

    async def _hear(self, page: WebSocket, visitor: Visitor, latest: Latest) -> None:
        """Messages of a page until it goes."""
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                message = await page.receive()
                if message["type"] == "websocket.disconnect":
                    return
                now = time.monotonic()
                said = self.desk.hear(visitor, message.get("text") or "", now)
                if isinstance(said, Hand):
                    self.devices.update(said.devices)
                    self._pass(said)
                elif isinstance(said, Ping):
                    for age in said.drawn:
                        self.drawn.add(1e-3 * max(0.0, age), now)
                    latest.answer({"kind": "pong", "at": said.at, "now": now})
                elif isinstance(said, Take):
                    latest.answer({"kind": "role", "steers": self.desk.take(visitor)})
                elif isinstance(said, Said):
                    self.said(said)
                else:
                    await asyncio.sleep(0)  # a page that floods does not hold up the others

    def _leave(self, visitor: Visitor) -> None:
        """A page has gone; the hand of the operator lets go at once."""
        was = self.desk.operator is visitor
        self.desk.leave(visitor)
        if was:
            self._pass(Hand(0, 2**53, False, time.monotonic(), math.nan, (0.0, 0.0, 0.0, 0.0)))
            self.tell({"kind": "free"})

    def _pass(self, hand: Hand) -> None:
        try:
            self._channel.send(hand.pack())
        except OSError:  # the loop has ended, or is far behind: then it ends the grip by itself
            self.desk.counts.lost += 1

    def _is_ours(self, headers: Mapping[str, str]) -> bool:
        """Whether the name in the request is one of this machine's."""
        name = headers.get("host", "").rpartition(":")[0]
        return bool(name) and (not self._local or name in LOCAL)

    def _knows(self, query: Mapping[str, str]) -> bool:
        return hmac.compare_digest(query.get("token", "").encode(), self._token.encode())


def _ended(why: str) -> str:
    """The message that the loop has ended."""
    return json.dumps({"kind": "ended", "why": why})


class Latest:
    """What a page is yet to be told: every answer, and of the states only the newest."""

    def __init__(self) -> None:
        self._state: str | None = None
        self._answers: list[str] = []
        self._new = asyncio.Event()

    def put(self, state: str) -> None:
        """A newer state."""
        self._state = state
        self._new.set()

    def answer(self, words: dict[str, Any]) -> None:
        """An answer, kept until it is sent."""
        if len(self._answers) < 100:  # a page that does not listen
            self._answers.append(json.dumps(words))
        self._new.set()

    async def pass_on(self, send: Callable[[str], Awaitable[None]]) -> None:
        """Send what there is, and wait for more, until cancelled or the page is gone."""
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                await self._new.wait()
                self._new.clear()
                answers, self._answers = self._answers, []
                state, self._state = self._state, None
                for text in [*answers, *([state] if state is not None else [])]:
                    await send(text)
