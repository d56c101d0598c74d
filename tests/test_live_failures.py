"""The console's page fails in mid-motion, in every way that it can; others meddle meanwhile."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import websockets
from at_the_console import ARM, GAMEPAD, came_to_rest_as_it_must, cycles_of, opened, tip, until
from served import served
from websockets.sync.client import ClientConnection, connect

from rcmqp.live.steering import RELEASED
from rcmqp.show.viewer.browser import PATIENCE, browser

if TYPE_CHECKING:
    from playwright.sync_api import Page

BRAKING = 0.3
"""Within so long the arm is at rest [s]; the limits of its jerk take a fifth of a second."""


def socket_of(address: str, **options: Any) -> tuple[str, dict[str, Any]]:
    """Where a page of this address has its socket, and what it says of itself."""
    host, _, query = address.removeprefix("http://").partition("/")
    return f"ws://{host}/hand{query}", {"origin": websockets.Origin(f"http://{host}")} | options


def ended(process: subprocess.Popen[str]) -> str:
    """End a session by Ctrl-C; its report."""
    process.send_signal(signal.SIGINT)
    assert process.stdout is not None
    report = process.stdout.read()
    assert process.wait(PATIENCE) == 0, report
    return report


def counted(report: str, what: str) -> int:
    """A number of the report."""
    (line,) = (line for line in report.splitlines() if line.startswith(f"| {what} |"))
    return int(line.split("|")[2])


class Watcher:
    """A page that only watches, without a browser."""

    def __init__(self, page: ClientConnection) -> None:
        self.page = page

    def state(self) -> dict[str, Any]:
        """The next state."""
        while True:
            said: dict[str, Any] = json.loads(self.page.recv(PATIENCE))
            assert said["kind"] != "ended", said
            if said["kind"] == "state":
                return said

    def rests(self) -> bool:
        """Whether the arm rests for a while."""
        start = self.state()["time"]
        while (state := self.state())["time"] < start + BRAKING:
            if state["moving"]:
                return False
        return True


class Cable:
    """Passes on what comes to a port of its own, until it is cut."""

    def __init__(self, port: int) -> None:
        self.port, self.cut = port, False
        self.ends: list[socket.socket] = []
        self.listener = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near = self.listener.accept()[0]
                far = socket.create_connection(("127.0.0.1", self.port))
                self.ends += [near, far]
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=self._pass, args=pair, daemon=True).start()

    def _pass(self, here: socket.socket, there: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := here.recv(65536):
                if not self.cut:
                    there.sendall(data)
            there.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        for end in (self.listener, *self.ends):
            end.close()


@contextlib.contextmanager
def cable(address: str) -> Iterator[tuple[Cable, str]]:
    """A cable to a server, and the address at its other end."""
    port = int(address.split(":")[2].partition("/")[0])
    made = Cable(port)
    try:
        yield made, address.replace(str(port), str(made.listener.getsockname()[1]))
    finally:
        made.close()


def in_motion(page: Page) -> None:
    """The stand-in gamepad moves the camera to and fro, and the arm follows."""
    until(lambda: page.evaluate("rcmqp.steers"), "the right to steer")
    to, before = [1.0], tip(page)

    def moves() -> bool:
        page.evaluate(f"push([{0.7 * to[0]}, 0.2, 0, 0])")
        time.sleep(0.3)
        held = page.evaluate("rcmqp.newest.moving && rcmqp.said.startsWith('you hold')")
        held = held and np.linalg.norm(tip(page) - before) > 1e-3
        if not held:
            page.evaluate("unplug()")
            time.sleep(0.1)
            to[0] = -to[0]
        return bool(held)

    until(moves, "the arm to follow the stick")


def hide(page: Page) -> None:
    """As a browser does where another tab comes in front."""
    page.evaluate(
        """() => {
          Object.defineProperty(document, "hidden", { get: () => true });
          document.dispatchEvent(new Event("visibilitychange"));
        }"""
    )


def kill(page: Page) -> None:
    """Kill the browser."""
    chromium = page.context.browser
    assert chromium is not None
    processes = chromium.new_browser_cdp_session().send("SystemInfo.getProcessInfo")
    (number,) = (each["id"] for each in processes["processInfo"] if each["type"] == "browser")
    os.kill(number, signal.SIGKILL)


WAYS: dict[str, Callable[[Page], Any]] = {
    "page hidden": hide,
    "focus lost": lambda page: page.evaluate("window.dispatchEvent(new Event('blur'))"),
    "hand disconnected": lambda page: page.evaluate("unplug()"),
    "page closed": lambda page: page.close(),
    "network cut": lambda page: None,
    "browser killed": kill,
}


def test_however_a_page_fails_in_mid_motion_the_arm_rests_and_the_file_is_whole(
    tmp_path: Path,
) -> None:
    file = tmp_path / "run.h5"
    with served("live", "--arm", ARM, "--out", str(file)) as (process, address):
        uri, options = socket_of(address)
        with browser() as chromium:
            for way, fail in WAYS.items():
                with cable(address) as (wire, through):
                    window = chromium.new_context(viewport={"width": 120, "height": 120})
                    window.add_init_script(GAMEPAD)
                    page, _ = opened(window, through)
                    in_motion(page)
                    wire.cut = way == "network cut"
                    fail(page)
                    with connect(uri, **options) as watching:
                        watcher = Watcher(watching)
                        until(watcher.rests, f"the arm to rest: {way}")
                        assert watcher.rests(), way  # it does not begin again
                    if way == "browser killed":
                        break
                    window.close()
        report = ended(process)
    run = came_to_rest_as_it_must(file, moved=1e-3)
    assert "ended |" in report
    assert counted(report, "- lost, as the loop did not take them") == 0
    released = cycles_of(RELEASED, run)
    began = [k for k in released if k - 1 not in released and np.abs(run.v[k - 1]).max() > 1e-4]
    assert len(began) >= len(WAYS)
    for k in began:
        rest = k + np.flatnonzero(~run.v[k:].any(axis=1))[0]
        assert (rest - k) * run.period < BRAKING


def test_a_page_that_is_driven_at_random_keeps_every_promise() -> None:
    """Some seconds of it; PROMISES of the benchmark has them."""
    fuzz = Path(__file__).parent.parent / "benchmarks" / "fuzz_console.py"
    done = subprocess.run(
        [sys.executable, fuzz, "--minutes", "0.3"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert counted(done.stdout, "messages that the page sent") > 20
    assert counted(done.stdout, "messages unaccounted for on the way to the loop") == 0


MALFORMED = 100_000


def test_others_that_meddle_are_refused_and_counted_and_the_operator_steers_on(
    tmp_path: Path,
) -> None:
    """A second operator, another origin, a wrong token, and a flood of malformed messages."""
    file, pings = tmp_path / "run.h5", []

    async def meddle(uri: str, options: dict[str, Any]) -> None:
        wrong = [(uri + "x", options), (uri, {"origin": websockets.Origin("http://evil.example")})]
        for place, said in wrong:
            with pytest.raises(websockets.InvalidStatus, match="403"):
                async with websockets.connect(place, **said):
                    pass
        async with websockets.connect(uri, **options) as page:
            await page.send('{"kind": "take"}')
            await page.send(hand(1, 1, 0.05))
            for k in range(MALFORMED):
                await page.send('{"kind": "hand", "number": ' + str(k))
                if k % 5000 == 4999:
                    await heard(page)

    async def heard(page: websockets.ClientConnection) -> None:
        """Wait until the server has heard all; it drops pings after a flood, too."""
        while True:
            await asyncio.sleep(1.1)
            await page.send('{"kind": "ping", "at": 1, "drawn": []}')
            pings.append(1)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(1.0):
                    async for text in page:
                        said = json.loads(text)
                        assert said["kind"] != "role" or not said["steers"]
                        if said["kind"] == "pong":
                            return

    def hand(number: int, grip: int, x: float) -> str:
        now = time.monotonic()
        said = {"number": number, "grip": grip, "held": True, "at": now, "event": now}
        return json.dumps(
            {"kind": "hand", "way": [x, 0.0, 0.0, 0.0], "felt": False, "devices": [], **said}
        )

    async def steer(uri: str, options: dict[str, Any]) -> int:
        """How often the arm moved while others meddle."""
        moving = number = grip = 0
        async with websockets.connect(uri, **options) as page:
            await page.send('{"kind": "take"}')
            meddling = asyncio.create_task(meddle(uri, options))
            while not meddling.done() or moving < 20:
                number += 1
                if number % 60 == 1:
                    grip = number  # a busy machine may have been silent for too long
                await page.send(hand(number, grip, 0.03 * float(np.sin(0.05 * number))))
                with contextlib.suppress(TimeoutError):
                    said = json.loads(await asyncio.wait_for(page.recv(), 0.016))
                    moving += said.get("moving", False)
            await meddling
        return moving

    with served("live", "--arm", ARM, "--out", str(file)) as (process, address):
        uri, options = socket_of(address)
        asyncio.run(steer(uri, options))
        time.sleep(1.0)
        report = ended(process)
    came_to_rest_as_it_must(file, moved=1e-3)
    dropped = counted(report, "- dropped, as they were malformed")
    assert dropped > 0
    too_many = counted(report, "- dropped, as they were too many")
    assert MALFORMED <= dropped + too_many <= MALFORMED + len(pings)
    assert counted(report, "- dropped, as somebody else steers") == 1
    assert counted(report, "connections refused: another origin") == 1
    assert counted(report, "requests refused: wrong token") == 1
    assert counted(report, "- lost, as the loop did not take them") == 0
    assert "asked to stop" in report
