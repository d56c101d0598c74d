"""rcmqp live as a whole: its processes, and its page in a real Chromium."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import websockets
from at_the_console import (
    ARM,
    at_rest,
    came_to_rest_as_it_must,
    cycles_of,
    drag,
    opened,
    tip,
    until,
)
from priorities import may_be_real_time, policies, shows_priorities
from served import served
from test_urdf import urdf

from rcmqp import Run, Scenario
from rcmqp.cli import main
from rcmqp.live.console import LiveReport, latency_row
from rcmqp.live.steering import RELEASED
from rcmqp.show.viewer.browser import PATIENCE, browser
from rcmqp.show.viewer.build import write_page

if TYPE_CHECKING:
    from playwright.sync_api import WebSocketRoute


def test_a_server_that_is_killed_leaves_the_arm_at_rest_and_the_file_whole(
    tmp_path: Path,
) -> None:
    """A client drags without end; the server is killed while the arm moves."""
    file = tmp_path / "run.h5"

    async def drag(address: str, kill: Callable[[], None]) -> None:
        name = address.removeprefix("http://")
        origin = websockets.Origin(f"http://{name.partition('/')[0]}")
        host, _, query = name.partition("/")
        async with websockets.connect(f"ws://{host}/hand{query}", origin=origin) as page:
            await page.send('{"kind": "take"}')
            number, began, moving = 0, time.monotonic(), 0
            while moving < 20:
                now = time.monotonic()
                assert now - began < PATIENCE
                if number % 60 == 0:
                    grip = number  # a busy machine may have been silent for too long
                number += 1
                way = [0.05 * np.sin(2.0 * (now - began)), 0.0, 0.0, 0.0]
                words: dict[str, object] = {
                    "number": number,
                    "grip": grip,
                    "held": True,
                    "event": now,
                }
                words |= {"felt": False, "devices": ["mouse"]}
                await page.send(json.dumps({"kind": "hand", "at": now, "way": way, **words}))
                with contextlib.suppress(TimeoutError):
                    said = json.loads(await asyncio.wait_for(page.recv(), 0.016))
                    moving += said.get("moving", False)
            kill()

    with served("live", "--arm", ARM, "--out", str(file)) as (process, address):
        with contextlib.suppress(websockets.ConnectionClosed):
            asyncio.run(drag(address, process.kill))
        until(file.exists, "the file of the session whose server was killed")
    run = came_to_rest_as_it_must(file, moved=1e-3)
    stopped = cycles_of("asked to stop", run) | cycles_of(RELEASED, run)
    began = max(k for k in stopped if k - 1 not in stopped)  # on a busy machine by silence
    assert np.abs(run.v[began - 1]).max() > 1e-3  # it was moving


def test_a_page_steers_and_when_it_is_closed_in_mid_motion_the_arm_rests(tmp_path: Path) -> None:
    file = tmp_path / "run.h5"
    with (
        served("live", "--arm", ARM, "--out", str(file)) as (process, address),
        browser() as chromium,
    ):
        window = chromium.new_context(viewport={"width": 400, "height": 700})
        watcher, watched = opened(
            chromium.new_context(viewport={"width": 60, "height": 60}), address
        )
        page, said = opened(window, address)
        assert watcher.evaluate("rcmqp.steers")  # it came first
        assert page.evaluate("rcmqp.said") == "somebody else steers; you watch"
        before = tip(page)
        drag(page, 80, 0)
        page.keyboard.press("ArrowRight", delay=200)
        assert np.linalg.norm(tip(page) - before) < 1e-9
        watcher.close()
        page.locator("#take").click(timeout=1e3 * PATIENCE)
        until(lambda: page.evaluate("rcmqp.steers"), "the right to steer")
        point = (before - np.array([0.0, 0.0, 0.05])).tolist()
        there = page.evaluate("point => rcmqp.seen(point)", point)
        box = page.locator("#scope").bounding_box()
        assert box is not None

        def dragged() -> bool:
            drag(page, box["width"] / 3, 0.0)
            return bool(np.linalg.norm(tip(page) - before) > 5e-3)

        until(dragged, "the arm to follow the pointer")
        until(lambda: at_rest(page), "the arm to come to rest")
        moved = np.subtract(page.evaluate("point => rcmqp.seen(point)", point), there)
        assert moved[0] < 0.0  # the picture's content went to the left
        assert abs(moved[1]) < 0.1 * abs(moved[0])
        page.mouse.down()
        page.evaluate("window.dispatchEvent(new Event('blur'))")  # the focus is lost
        before = tip(page)
        for k in range(20):
            page.mouse.move(box["x"] + 10.0 * k, box["y"] + box["height"] / 2)
        time.sleep(0.3)
        assert page.evaluate("rcmqp.said").startswith("at rest")
        assert np.linalg.norm(tip(page) - before) < 1e-4
        page.mouse.up()

        def keyed() -> bool:
            page.keyboard.down("ArrowUp")
            time.sleep(0.3)
            moving = page.evaluate("rcmqp.newest.moving")
            if moving and np.linalg.norm(tip(page) - before) > 2e-3:
                return True
            page.keyboard.up("ArrowUp")
            time.sleep(0.2)
            return False

        until(keyed, "the arm to follow a key")
        page.close()
        assert [*said, *watched] == []
        time.sleep(1.0)
        last, errors = opened(window, address)
        until(lambda: last.evaluate("rcmqp.steers"), "the right to steer after the page is gone")
        until(lambda: at_rest(last), "the arm to rest")
        assert errors == []
        process.send_signal(signal.SIGINT)
        assert process.stdout is not None
        report = process.stdout.read()
        assert process.wait(PATIENCE) == 0, report
    for line in ("input event to command", "command to state", "state to picture"):
        assert f"| {line} |" in report
    run = came_to_rest_as_it_must(file, moved=5e-3)
    asked, released = cycles_of("asked to stop", run), cycles_of(RELEASED, run)
    assert not run.v[min(asked) - 1].any()  # of Ctrl-C, long after the page was closed
    let_go = max(k for k in released if k - 1 not in released)
    assert np.abs(run.v[let_go - 1]).max() > 1e-3  # the page was closed in mid-motion
    rest = let_go + np.flatnonzero(~run.v[let_go:].any(axis=1))[0]
    assert rest - let_go < 300
    assert not run.v[rest:].any()
    write_page([run], tmp_path / "page.html")


def test_a_page_says_that_it_is_over_and_whether_the_connection_was_lost() -> None:
    """What a server of a trial says last, put in between by a stand-in."""
    with served("live", "--arm", ARM) as (_, address), browser() as chromium:
        for last, said in ((False, "The connection is lost"), (True, "Thank you, that is all.")):
            window = chromium.new_context(viewport={"width": 320, "height": 400})
            sockets: list[WebSocketRoute] = []

            def between(ws: WebSocketRoute, sockets: list[WebSocketRoute] = sockets) -> None:
                ws.connect_to_server()
                sockets.append(ws)

            window.route_web_socket("**/hand*", between)
            page, errors = opened(window, address)
            for text in ("Please wait.", "Thank you, that is all."):
                words = {"kind": "over", "title": "Done <b>", "text": text, "last": last}
                sockets[0].send(json.dumps(words))
                page.wait_for_function(
                    "text => document.querySelector('#over p')?.textContent === text",
                    arg=text,
                    timeout=1e3 * PATIENCE,
                )
            assert page.locator("#over").count() == 1
            assert page.locator("#over h1").text_content() == "Done <b>"  # not HTML
            box = page.locator("#over").bounding_box()
            assert box is not None
            assert (box["x"], box["y"], box["width"], box["height"]) == (0, 0, 320, 400)
            sockets[0].close()
            time.sleep(0.5)
            assert (page.locator("#over p").text_content() or "").startswith(said)
            assert errors == []
            window.close()


@shows_priorities
def test_the_loop_is_before_ordinary_processes_where_permitted_and_nothing_else_is(
    tmp_path: Path,
) -> None:
    real_time = may_be_real_time()

    def children(pid: int) -> list[int]:
        return [*map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())]

    with served("live", "--arm", ARM, "--out", str(tmp_path / "run.h5")) as (process, _):
        (loop,) = children(process.pid)
        (writer,) = children(loop)
        assert policies(loop) == {os.SCHED_FIFO if real_time else os.SCHED_OTHER}
        for pid in (process.pid, writer):
            assert policies(pid) == {os.SCHED_OTHER}
            assert os.getpriority(os.PRIO_PROCESS, pid) == os.getpriority(os.PRIO_PROCESS, 0)
        process.send_signal(signal.SIGINT)
        assert process.stdout is not None
        report = process.stdout.read()
    assert f"| priority | {'real-time (SCHED_FIFO' if real_time else 'ordinary, as'}" in report


def test_a_page_without_a_graphics_card_says_so_and_draws_only_what_has_changed() -> None:
    """And that the loop is slow, if it is; the browser of the tests draws in software."""
    skipped = 0.0
    with served("live", "--arm", ARM) as (_, address), browser() as chromium:
        window = chromium.new_context(viewport={"width": 320, "height": 400})

        def between(ws: WebSocketRoute) -> None:
            def changed(text: str | bytes) -> None:
                words = json.loads(text)
                if words["kind"] == "state":
                    words["skipped"] = skipped
                ws.send(json.dumps(words))

            server = ws.connect_to_server()
            server.on_message(changed)

        window.route_web_socket("**/hand*", between)
        page, errors = opened(window, address)
        light, why = page.locator("#light"), page.locator("#why")
        assert light.get_attribute("aria-pressed") == "true"
        assert (why.text_content() or "").startswith("no graphics card")

        def rests() -> bool:
            """Whether states and frames came, and none was drawn: the arm is at rest."""
            before = page.evaluate("rcmqp.draws")
            page.evaluate(
                """async () => {
                    const from = rcmqp.newest.time;
                    for (let k = 0; k < 10 || rcmqp.newest.time < from + 0.5; k += 1)
                        await new Promise(requestAnimationFrame);
                }"""
            )
            return bool(page.evaluate("rcmqp.draws") == before > 0)

        until(rests, "a page that draws nothing while the arm is at rest")
        before = page.evaluate("rcmqp.draws")
        slow, said, place = page.locator("#slow"), page.locator("#slow-said"), "rcmqp_place"
        page.evaluate(
            f"{place} = () => document.querySelector('#light').getBoundingClientRect().y"
        )
        assert slow.is_hidden()
        there = page.evaluate(f"{place}()")
        skipped = 0.31
        until(slow.is_visible, "to be told that the loop is slow")
        text = "The loop is too slow: the arm moves about 30 % slower than it should."
        until(lambda: slow.text_content() == text, "to be told by how much")
        assert said.text_content() == "The loop is too slow."
        assert page.evaluate(f"{place}()") == there  # buttons stay where they are
        skipped = 0.01
        until(slow.is_hidden, "the loop to be in time again")
        assert said.text_content() == ""
        light.click(timeout=1e3 * PATIENCE)
        assert light.get_attribute("aria-pressed") == "false"
        assert why.text_content() == ""
        until(lambda: page.evaluate("rcmqp.draws") > before, "a finer picture")
        assert errors == []


def test_a_drag_counts_before_the_next_picture_if_the_browser_tells_of_it() -> None:
    """pointerrawupdate comes at once, pointermove with the next picture."""
    with served("live", "--arm", ARM) as (_, address), browser() as chromium:
        window = chromium.new_context(viewport={"width": 320, "height": 400})
        page, errors = opened(window, address)
        until(lambda: page.evaluate("rcmqp.steers"), "the right to steer")
        page.evaluate(
            """document.querySelector('#scope canvas').addEventListener('pointerdown',
                (event) => (window.pressed = event))"""
        )
        page.locator("#scope canvas").hover()
        page.mouse.down()
        way = page.evaluate(
            """() => {
                const { pointerId, clientX, clientY } = pressed;
                const more = { pointerId, clientX: clientX + 30, clientY, bubbles: true };
                const before = rcmqp.way[0];
                pressed.target.dispatchEvent(new PointerEvent('pointerrawupdate', more));
                return rcmqp.way[0] - before;
            }"""
        )
        page.mouse.up()
        size = page.evaluate("document.querySelector('#scope canvas').clientWidth")
        assert way == pytest.approx(30.0 / size * 0.08)
        assert errors == []


def test_without_the_extra_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("rcmqp.live.console", "rcmqp.live.server"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    with pytest.raises(SystemExit) as ended:
        main(["live"])
    assert ended.value.code == 1
    assert "pip install 'rcmqp[live]'" in capsys.readouterr().err


def test_another_interface_is_warned_about_and_a_taken_port_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    import socket

    with socket.socket() as taken:
        taken.bind(("0.0.0.0", 0))
        taken.listen()
        with pytest.raises(SystemExit):
            main(["live", "--no-open", "--host", "0.0.0.0", "--port", str(taken.getsockname()[1])])
    said = capsys.readouterr().err
    assert "warning: 0.0.0.0 can be reached from other machines" in said
    assert "cannot listen at 0.0.0.0" in said


@pytest.mark.parametrize(("option", "said"), [("--scale", "scale = 0.0"), ("--viscosity", "-1")])
def test_what_the_loop_cannot_begin_with_is_said(
    option: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    value = "0" if option == "--scale" else "-1"
    with pytest.raises(SystemExit) as ended:
        main(["live", "--no-open", option, value])
    assert ended.value.code == 1
    text = capsys.readouterr().err
    assert text.startswith("error: the loop cannot begin")
    assert said in text


def test_a_urdf_goes_with_its_flange_and_limits(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    begun: list[Scenario] = []

    def run_live(scenario: Scenario, *_: object, **__: object) -> LiveReport:
        begun.append(scenario)
        return LiveReport("", "")

    monkeypatch.setattr("rcmqp.live.console.run_live", run_live)
    (tmp_path / "r.urdf").write_text(urdf())
    given = ["--flange", "l7", "--acceleration", "8", "--jerk", "400"]
    with pytest.raises(SystemExit) as ended:
        main(["live", "--no-open", "--arm", str(tmp_path / "r.urdf"), *given])
    assert ended.value.code == 0
    arm = begun[0].insertion().arm
    assert (arm.flange, set(arm.acceleration), set(arm.jerk)) == ("l7", {8.0}, {400.0})


def test_a_law_of_ones_own_steers(tmp_path: Path) -> None:
    own, file = tmp_path / "own.py", tmp_path / "run.h5"
    own.write_text(
        "from dataclasses import dataclass\n"
        "from rcmqp.controllers.hierarchical_qp import HierarchicalQP\n"
        "@dataclass(frozen=True, eq=False)\n"
        "class MyLaw(HierarchicalQP):\n"
        "    mine: float = 1.0\n"
    )
    law = f"{own}:MyLaw:mine=2"
    with served("live", "--arm", ARM, "-c", law, "--set", "gain=7", "--out", str(file)) as (
        process,
        _,
    ):
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        assert process.stdout is not None
        report = process.stdout.read()
    assert "| controller | my_law |" in report
    run = Run.load(file)
    assert (run.controller, run.options["mine"], run.options["gain"]) == ("my_law", 2.0, 7.0)


def test_latencies_of_nothing_are_a_dash() -> None:
    assert latency_row("state", 0.0, 0.0, 0.0, 0) == ("state", "-", "-", "-", "0")
    assert latency_row("state", 1e-3, 2e-3, 0.01, 7) == (
        "state",
        "1.0 ms",
        "2.0 ms",
        "10.0 ms",
        "7",
    )
