"""The console's server: who is let in, who steers, and what is dropped; no browser."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

import numpy as np
import pytest
import websockets

from rcmqp.live.desk import MOST, STALE, Desk, Visitor
from rcmqp.live.messages import LONGEST, Hand, Malformed, Ping, Take, parse
from rcmqp.live.server import Console, Server

TOKEN = "a-token"
PATIENCE = 20.0
"""How long anything may take on a busy machine [s]."""


def words(number: Any = 1, at: Any = 10.0, **changes: Any) -> dict[str, Any]:
    """A page's message of a hand."""
    return {
        "kind": "hand",
        "number": number,
        "grip": 1,
        "held": True,
        "at": at,
        "event": None,
        "way": [0.01, 0.0, 0.0, 0.0],
        "felt": False,
        "devices": ["mouse"],
    } | changes


# Messages ------------------------------------------------------------------------------------


def test_messages_are_read_as_they_were_meant() -> None:
    hand = parse(json.dumps(words(event=9.5)))
    assert hand == Hand(1, 1, True, 10.0, 9.5, (0.01, 0.0, 0.0, 0.0), devices=("mouse",))
    hand = hand._replace(devices=())  # the loop does not need them
    assert Hand.unpack(hand.pack()) == hand
    felt = hand._replace(operator=2, felt=True)
    assert Hand.unpack(felt.pack()) == felt
    assert parse('{"kind": "take"}') == Take()
    assert parse('{"kind": "ping", "at": 3, "drawn": [1.5]}') == Ping(3.0, (1.5,))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "[]",
        "{}",
        "[" * 900,
        '{"kind": "hand"}',
        '{"kind": ["hand"]}',
        '{"kind": "take", "more": 1}',
        '{"kind": "ping", "at": 1, "drawn": [NaN]}',
        json.dumps(words(way=[0.0, 0.0, 0.0])),
        json.dumps(words(way=[0.0, 0.0, 0.0, 1e9])),
        json.dumps(words(way=[0.0, 0.0, 0.0, math.inf])),
        json.dumps(words(way=[0.0, 0.0, 0.0, None])),
        json.dumps(words(held=1)),
        json.dumps(words(felt=None)),
        json.dumps(words(devices="mouse")),
        json.dumps(words(devices=["scalpel"])),
        json.dumps(words(devices=[["mouse"]])),
        json.dumps(words(devices=["mouse"] * 9)),
        json.dumps(words(number=1.5)),
        json.dumps(words(number=-1)),
        json.dumps(words(number=True)),
        json.dumps(words(grip=2**60)),
        json.dumps(words(at="now")),
        json.dumps(words(at=math.nan)),
        json.dumps(words(more=1)),
        json.dumps(words()).replace("10.0", "1" * 400),
    ],
)
def test_what_is_no_message_is_refused(text: str) -> None:
    with pytest.raises(Malformed):
        parse(text)


# The desk ------------------------------------------------------------------------------------


def steering(desk: Desk) -> Visitor:
    visitor = Visitor()
    assert desk.take(visitor)
    return visitor


def test_one_steers_and_the_others_watch() -> None:
    desk, other = Desk(), Visitor()
    first = steering(desk)
    assert not desk.take(other)
    assert desk.hear(other, json.dumps(words()), 10.0) is None
    assert isinstance(desk.hear(first, json.dumps(words()), 10.0), Hand)
    desk.leave(other)
    assert not desk.take(other)
    desk.leave(first)
    assert desk.take(other)
    hand = desk.hear(other, json.dumps(words()), 10.0)
    assert isinstance(hand, Hand)
    assert hand.operator == 2
    assert (desk.counts.watching, desk.counts.hands) == (1, 2)


@pytest.mark.parametrize(
    ("age", "passes"), [(-1.0, False), (0.0, True), (0.09, True), (0.11, False)]
)
def test_a_message_that_took_too_long_is_dropped(age: float, passes: bool) -> None:
    desk = Desk()
    found = desk.hear(steering(desk), json.dumps(words(at=10.0 - age)), 10.0)
    assert (found is not None) == passes
    assert desk.counts.stale == (not passes)
    assert STALE == 0.1


def test_messages_out_of_order_are_dropped() -> None:
    desk = Desk()
    visitor = steering(desk)
    taken = [desk.hear(visitor, json.dumps(words(n)), 10.0) is not None for n in (1, 3, 2, 3, 4)]
    assert taken == [True, True, False, False, True]
    assert desk.counts.stale == 2


def test_ten_thousand_malformed_messages_are_dropped_and_counted() -> None:
    rng, desk = np.random.default_rng(7), Desk()
    visitor = steering(desk)
    good, kinds = json.dumps(words()), 0
    for k in range(10_000):
        now = 10.0 + k / MOST * 1.01
        text = list(good)
        if k % 3 == 0:
            text = [chr(c) for c in rng.integers(32, 1000, rng.integers(1, 80))]
        elif k % 3 == 1:
            text = text[: rng.integers(0, len(text) - 1)]
        else:
            text = text * (1 + LONGEST // len(text))
        assert desk.hear(visitor, "".join(text), now) is None
        kinds += 1
    counts = desk.counts
    assert counts.malformed + counts.huge == 10_000
    assert counts.huge == 3333
    assert counts.hands == 0


def test_too_many_messages_are_dropped_until_the_second_is_over() -> None:
    desk = Desk()
    visitor = steering(desk)
    taken = sum(
        desk.hear(visitor, json.dumps(words(n + 1)), 10.0) is not None for n in range(2 * MOST)
    )
    assert (taken, desk.counts.too_many) == (MOST, MOST)
    assert desk.hear(visitor, json.dumps(words(1000, at=11.0)), 11.01) is not None


def test_that_the_operator_lets_go_is_never_one_message_too_many() -> None:
    desk, watcher = Desk(), Visitor()
    visitor = steering(desk)
    for n in range(MOST):
        for each in (visitor, watcher):
            desk.hear(each, json.dumps(words(n + 1)), 10.0)
    lets_go = json.dumps(words(MOST + 1) | {"held": False})
    for dropped in (json.dumps(words(MOST + 1)), lets_go[1:], lets_go + " " * LONGEST, "[]"):
        assert desk.hear(visitor, dropped, 10.0) is None
    assert desk.hear(watcher, lets_go, 10.0) is None
    assert desk.counts.too_many == 5
    found = desk.hear(visitor, lets_go, 10.0)
    assert isinstance(found, Hand)
    assert not found.held


# The server ----------------------------------------------------------------------------------


class Served:
    """A running server, and the loop's end of its channel."""

    def __init__(self, console: Console, port: int, channel: socket.socket) -> None:
        self.console, self.port, self.channel = console, port, channel

    def connect(self, *, token: str = TOKEN, origin: str | None = None) -> Any:
        name = f"127.0.0.1:{self.port}"
        return websockets.connect(
            f"ws://{name}/hand?token={token}",
            origin=websockets.Origin(f"http://{name}" if origin is None else origin),
        )

    async def heard(self) -> Hand:
        """The next hand that the loop gets."""
        data = await asyncio.wait_for(
            asyncio.get_running_loop().sock_recv(self.channel, 4096), PATIENCE
        )
        return Hand.unpack(data)

    async def page(self, query: str, name: str = "127.0.0.1") -> tuple[int, str]:
        """Status and text of the page."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        head = f"GET /{query} HTTP/1.1\r\nHost: {name}:{self.port}\r\nConnection: close\r\n\r\n"
        writer.write(head.encode())
        answer = (await reader.read()).decode()
        writer.close()
        return int(answer.split()[1]), answer


@contextlib.asynccontextmanager
async def serving() -> AsyncIterator[Served]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    for each in (ours, theirs):
        each.setblocking(False)
    with ours, theirs, socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        console = Console("the page", TOKEN, ours, local=True)
        server = Server(console.app)
        console.listen()
        task = asyncio.create_task(server.serve(sockets=[listener]))
        while not server.started:
            await asyncio.sleep(0.01)
        yield Served(console, listener.getsockname()[1], theirs)
        server.leave()
        await task


def on_a_server(act: Callable[[Served], Awaitable[None]]) -> None:
    async def run() -> None:
        async with serving() as served:
            await act(served)

    asyncio.run(run())


async def told(page: Any, kind: str) -> dict[str, Any]:
    """The next message of a kind that a page gets."""
    while True:
        said: dict[str, Any] = json.loads(await asyncio.wait_for(page.recv(), PATIENCE))
        if said["kind"] == kind:
            return said


async def say(page: Any, **message: Any) -> None:
    await page.send(json.dumps(message))


def test_the_page_needs_the_token() -> None:
    async def act(served: Served) -> None:
        status, text = await served.page(f"?token={TOKEN}")
        assert status == 200
        assert text.endswith("the page")
        assert "referrer-policy: no-referrer" in text.lower()
        for query in ("", "?token=", "?token=a-tokem", f"?tokens={TOKEN}"):
            assert (await served.page(query))[0] == 403
        assert served.console.desk.counts.wrong_token == 4
        status, text = await served.page(
            f"?token={TOKEN}", "evil.example"
        )  # its name, our address
        assert status == 403
        assert served.console.desk.counts.foreign == 1

    on_a_server(act)


@pytest.mark.parametrize(
    ("refused", "count"),
    [
        ({"token": "another"}, "wrong_token"),
        ({"origin": "http://evil.example"}, "foreign"),
        ({"origin": "http://127.0.0.1:1"}, "foreign"),
    ],
)
def test_a_page_of_another_origin_or_without_the_token_is_refused(
    refused: dict[str, str], count: str
) -> None:
    async def act(served: Served) -> None:
        with pytest.raises(websockets.InvalidStatus, match="403"):
            async with served.connect(**refused):
                pass
        assert getattr(served.console.desk.counts, count) == 1

    on_a_server(act)


def test_a_page_that_goes_lets_go_and_the_next_one_may_steer() -> None:
    async def act(served: Served) -> None:
        async with served.connect() as watcher:
            async with served.connect() as page:
                await say(page, kind="take")
                assert (await told(page, "role"))["steers"]
                await say(watcher, kind="take")
                assert not (await told(watcher, "role"))["steers"]
                await say(watcher, **words(at=time.monotonic(), devices=["keys"]))
                await say(page, **words(7, at=time.monotonic()))
                hand = await served.heard()
                assert (hand.number, hand.held) == (7, True)
            assert not (await served.heard()).held
            await told(watcher, "free")
            await say(watcher, kind="take")
            assert (await told(watcher, "role"))["steers"]
            assert served.console.desk.counts.watching == 1
            assert served.console.devices == {"mouse"}  # of the one that steered

    on_a_server(act)


def test_hands_that_the_loop_does_not_take_are_counted() -> None:
    async def act(served: Served) -> None:
        counts = served.console.desk.counts
        async with served.connect() as page:
            await say(page, kind="take")
            await told(page, "role")
            served.channel.close()
            await say(page, **words(1, at=time.monotonic()))
            await say(page, kind="ping", at=1, drawn=[])
            await told(page, "pong")
            assert (counts.hands, counts.lost) == (1, 1)
        while served.console.desk.operator is not None:
            await asyncio.sleep(0.01)
        assert counts.lost == 2  # letting go as the page goes

    on_a_server(act)


def test_states_go_to_every_page_and_clocks_are_compared() -> None:
    async def act(served: Served) -> None:
        async with served.connect() as one, served.connect() as other:
            for page in (one, other):  # both are there
                before = time.monotonic()
                await say(page, kind="ping", at=5.0, drawn=[20.0])
                pong = await told(page, "pong")
                assert pong["at"] == 5.0
                assert before <= pong["now"] <= time.monotonic()
            served.channel.send(b'{"kind": "state", "time": 1.0}')
            for page in (one, other):
                assert (await told(page, "state"))["time"] == 1.0
            served.console.end("it is over")
            assert (await told(one, "ended"))["why"] == "it is over"
        assert served.console.drawn.latency().total == 2

    on_a_server(act)


def test_a_flood_does_not_keep_the_other_pages_from_being_served() -> None:
    async def act(served: Served) -> None:
        async with served.connect() as flood, served.connect() as page:
            await say(page, kind="take")
            await told(page, "role")
            for _ in range(10_000):
                await flood.send("x" * 50)
            await flood.send(b"\0" * 50)
            hearing = asyncio.create_task(served.heard())
            for number in range(1, 200):
                await say(page, **words(number, at=time.monotonic()))
                if (await asyncio.wait({hearing}, timeout=0.05))[0]:
                    break
            assert (await hearing).held
            assert number < 20
            counts = served.console.desk.counts
            while counts.malformed + counts.too_many < 10_001:  # or the test runs out of time
                await asyncio.sleep(0.01)

    on_a_server(act)
