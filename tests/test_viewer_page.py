"""The page in a real Chromium: it fails, it does not skip, where there is none."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose
from opened import Opened

from rcmqp import Run, Scenario, make_controller, simulate
from rcmqp.maths import dualquaternion as dq
from rcmqp.references.paths import ViewMoves
from rcmqp.show.labels import COLOURS
from rcmqp.world.obstacles import Sphere

VIEW = (0.13, 0.06, 0.0, 0.05)
CONTROLLERS = ("dual_quaternion", "hierarchical_qp")


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """Two controllers go to one view, past an obstacle."""
    path = ViewMoves(views=(VIEW,), move=1.5, dwell=0.3)
    scenario = Scenario.on_shaft("view", "lwa3", path, period=0.008)
    beside = scenario.insertion().from_start((0.05, 0.0, 0.05))
    obstacle = Sphere(tuple(np.add(scenario.trocar.pivot, beside)), 0.01)
    scenario = dataclasses.replace(scenario, obstacles=(obstacle,))
    return [
        simulate(scenario, make_controller(name, scenario.insertion(), scenario.period))
        for name in CONTROLLERS
    ]


@pytest.fixture
def shown(opened: Opened) -> Opened:
    """The page as it opens: at the start, paused."""
    opened.js("rcmqp.pause(), rcmqp.choose({main: 0, ghosts: false, limits: false, speed: 1})")
    opened.seek(0.0)
    return opened


def test_the_page_opens_offline_without_errors_or_requests(opened: Opened) -> None:
    assert len(opened.requests) == 1
    assert opened.requests[0].startswith("file:")
    assert [line for line in opened.said if line.startswith(("error", "warning"))] == []


def test_nothing_is_drawn_again_while_nothing_changes(shown: Opened) -> None:
    frames = """() => new Promise((done) => {
      let left = 9;
      const next = () => (left-- ? requestAnimationFrame(next) : done(rcmqp.draws));
      next();
    })"""
    shown.seek(0.5)
    before = shown.js(frames)
    assert shown.js(frames) == before
    shown.seek(0.6)
    assert shown.js(frames) == before + 1


def test_the_scene_can_be_played_before_the_plots_are_there(opened: Opened) -> None:
    assert 0.0 < opened.js("rcmqp.drawnIn") < opened.js("rcmqp.openedIn")
    assert opened.js("document.getElementById('wait')") is None


def test_the_scene_shows_arm_trocar_wall_trails_and_obstacles(shown: Opened) -> None:
    whole = shown.picture("rcmqp.seek(1.8)")
    for name in ("arm", "trocar", "wall", "trails", "desired", "obstacles"):
        without = shown.picture(f"rcmqp.show('{name}', false)")
        shown.js("name => rcmqp.show(name, true)", name)
        changed = np.abs(whole - without).max(axis=-1) > 12.0
        assert changed.sum() > (5000 if name == "arm" else 40), name


def test_the_trail_has_its_runs_colour(shown: Opened) -> None:
    rgb = [int(COLOURS[0][i : i + 2], 16) for i in (1, 3, 5)]

    def count(t: float) -> int:
        image = shown.picture(f"rcmqp.seek({t})")
        return int((np.abs(image - rgb).max(axis=-1) < 12.0).sum())

    assert count(0.0) == 0  # the tip has not drawn anything yet
    assert count(1.8) > 10


def test_the_desired_line_has_its_marks_colour_in_both_themes(shown: Opened) -> None:
    colours = []
    for name in ("dark", "light"):
        whole = shown.picture(f"rcmqp.theme('{name}'), rcmqp.seek(0)")
        without = shown.picture("rcmqp.show('desired', false)")
        shown.js("rcmqp.show('desired', true)")
        mark = "document.querySelector('#keys .desired')"
        text = shown.js(f"getComputedStyle({mark}).backgroundColor")
        colours.append([float(x) for x in text.removeprefix("rgb(").removesuffix(")").split(",")])
        changed = np.abs(whole - without).max(axis=-1) > 12.0
        assert (changed & (np.abs(whole - colours[-1]).max(axis=-1) < 12.0)).sum() > 40
    assert np.abs(np.subtract(colours[0], colours[1])).min() > 40.0


def test_the_arm_casts_a_shadow_on_the_floor(shown: Opened) -> None:
    whole = shown.picture("rcmqp.seek(0)")
    without = shown.picture("rcmqp.show('floor', false)")
    shown.js("rcmqp.show('floor', true)")
    assert ((without - whole).min(axis=-1) > 12.0).sum() > 4000


def test_play_advances_the_time_and_pause_holds_it(shown: Opened) -> None:
    shown.page.keyboard.press("Space")
    shown.page.wait_for_function("rcmqp.time > 0.2")
    shown.page.keyboard.press("Space")
    held = shown.js("rcmqp.time")
    shown.page.wait_for_timeout(100)
    assert shown.js("rcmqp.time") == held
    shown.page.locator("#play").click()
    shown.page.wait_for_function("held => rcmqp.time > held", arg=held)


def test_a_slow_machine_plays_at_the_speed_that_is_said(shown: Opened) -> None:
    times = shown.js("""() => {
      const [own, times] = [window.requestAnimationFrame, []];
      let next = null;
      window.requestAnimationFrame = (tick) => ((next = tick), 0);
      return new Promise((done) => own((start) => {
        rcmqp.play();
        for (const passed of [0, 0.7, 1.4]) {
          next(start + 1000 * passed);
          times.push(rcmqp.time);
        }
        rcmqp.pause();
        window.requestAnimationFrame = own;
        own(next);
        done(times);
      }));
    }""")
    assert_allclose(times, [0.0, 0.7, 1.4], rtol=0, atol=1e-9)


def test_playing_ends_at_the_end_and_starts_again(shown: Opened, runs: list[Run]) -> None:
    shown.seek(runs[0].time[-1] - 0.01)
    shown.js("rcmqp.play()")
    shown.page.wait_for_function("!rcmqp.playing")
    assert shown.js("rcmqp.time") == pytest.approx(runs[0].time[-1])
    shown.js("rcmqp.play()")
    assert shown.js("rcmqp.time") < 0.5


def test_keys_step_and_change_the_speed(shown: Opened, runs: list[Run]) -> None:
    for key, time in (("ArrowRight", 0.05), ("Shift+ArrowRight", 1.05), ("ArrowLeft", 1.0)):
        shown.page.keyboard.press(key)
        assert shown.js("rcmqp.time") == pytest.approx(time)
    for key, speed in (("+", 2), ("+", 4), ("-", 2), ("-", 1), ("-", 0.5)):
        shown.page.keyboard.press(key)
        assert shown.js("rcmqp.speed") == speed
    for key, time in (("Home", 0.0), ("End", runs[0].time[-1])):
        shown.page.keyboard.press(key)
        assert shown.js("rcmqp.time") == pytest.approx(time)


def test_keys_and_buttons_switch_what_is_shown(shown: Opened) -> None:
    states = {
        "limits": "rcmqp.shown('limits')[0]",
        "ghosts": "rcmqp.arm(1) === 'ghost'",
        "frame": "rcmqp.boxes('trocar').map((box) => box.map(rcmqp.pixel))"
        ".every(([[a], [b]]) => Math.abs(b - a) > 30)",
        "theme": "document.documentElement.dataset.theme === 'dark'",
    }
    for name, key in zip(states, "lgfb", strict=True):
        button = shown.page.locator(f"#{name}")
        for by_key in (True, False):
            before = shown.js(states[name])
            shown.page.keyboard.press(key) if by_key else button.click()
            assert shown.js(states[name]) != before
            assert button.get_attribute("aria-pressed") == str(not before).lower()
    shown.js("rcmqp.choose({magnify: 1})")
    for factor in (10, 100, 1000, 10000, 1):
        shown.page.keyboard.press("e")
        assert shown.page.locator("#magnify").input_value() == str(factor)


def test_scrubbing_moves_every_link_to_its_recorded_pose(shown: Opened, runs: list[Run]) -> None:
    arm = runs[0].insertion().arm
    data = arm.model.createData()
    for k in (0, 31, 120, runs[0].time.size - 1):
        shown.page.locator("#time").fill(str(runs[0].time[k]))
        assert shown.js("rcmqp.time") == pytest.approx(runs[0].time[k])
        for i, run in enumerate(runs):
            pin.forwardKinematics(arm.model, data, run.q[k])
            for j, joint in enumerate(run.joints):
                found = shown.js("([run, link]) => rcmqp.pose(run, link)", [i, joint])
                expected = data.oMi[j + 1].homogeneous
                assert_allclose(np.reshape(found, (4, 4)).T, expected, rtol=0, atol=1e-4)
            camera = np.reshape(shown.js("run => rcmqp.pose(run, 'camera')", i), (4, 4)).T
            assert_allclose(camera[:3, 3], run.tip[k], rtol=0, atol=1e-4)
            z = dq.rotate(dq.P(run.x[k]), [0.0, 0.0, 1.0])
            assert_allclose(-camera[:3, 2], z, rtol=0, atol=1e-4)


@pytest.mark.parametrize("k", [0, 80])
def test_the_endoscope_sees_the_target_where_it_projects_to(
    shown: Opened, runs: list[Run], k: int
) -> None:
    run = runs[0]
    image = shown.picture(
        f"rcmqp.show('desired', false), rcmqp.seek({run.time[k]})", which="endoscope"
    )
    shown.js("rcmqp.show('desired', true)")
    size = image.shape[0]
    assert image.shape[1] == size
    red, green, blue = np.moveaxis(image, -1, 0)
    rows, columns = np.nonzero((green > 0.8 * red) & (blue < 0.7 * green) & (green > 60.0))
    assert rows.size > 50

    insertion = run.insertion()
    alpha, beta, _, t_z = VIEW  # the tip of the view that is asked for, by plain rotations
    R_start = dq.to_se3(insertion.x_rcm).rotation
    turn = pin.utils.rotate("y", alpha) @ pin.utils.rotate("x", beta)
    deep = np.array([0.0, 0.0, insertion.tip_depth + t_z])
    target = np.array(run.scenario.trocar.pivot) + R_start @ turn @ deep
    seen = dq.to_se3(run.x[k]).rotation.T @ (target - run.tip[k])
    focal = size / 2 / math.tan(run.scenario.instrument.camera.field_of_view / 2)
    expected = size / 2 + focal * seen[:2] / seen[2]
    assert_allclose([columns.mean() + 0.5, rows.mean() + 0.5], expected, rtol=0, atol=1.0)


def test_clicking_a_plot_jumps_in_time(shown: Opened, runs: list[Run]) -> None:
    for subplot, share in (("xy", 0.75), ("xy4", 0.25)):
        plot = shown.page.locator(f"rect.nsewdrag[data-subplot='{subplot}']")
        plot.scroll_into_view_if_needed()
        box = plot.bounding_box()
        assert box is not None
        shown.page.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
        expected = share * runs[0].time[-1]
        assert shown.js("rcmqp.time") == pytest.approx(expected, abs=2e-2)
        cursor = shown.page.locator("#cursor").bounding_box()
        assert cursor is not None
        assert cursor["x"] == pytest.approx(box["x"] + share * box["width"], abs=2.0)
        last = shown.page.locator("rect.nsewdrag[data-subplot='xy4']").bounding_box()
        assert last is not None
        assert cursor["y"] + cursor["height"] == pytest.approx(last["y"] + last["height"], abs=1.0)


def test_ticks_of_small_errors_are_short_enough_to_be_whole(shown: Opened) -> None:
    ticks = [shown.page.locator(f"#figure .y{i}tick").all_text_contents() for i in ("", 2, 3, 4)]
    assert all(ticks)
    assert any("e\u2212" in text for text in ticks[1])
    assert max(len(text) for texts in ticks for text in texts) <= 6


def test_the_slip_is_drawn_as_many_times_as_asked(shown: Opened, runs: list[Run]) -> None:
    k = int(np.argmax(runs[0].rcm_error))
    shown.seek(runs[0].time[k])
    text = shown.page.locator("#slip").inner_text()
    _, _, size, unit = text.partition(",")[0].split()
    assert unit == "mm"
    assert float(size) == pytest.approx(1e3 * runs[0].rcm_error[k], rel=6e-3)
    for factor, said in ((10, "too small to draw"), (10000, "drawn \u00d710000")):
        shown.page.locator("#magnify").select_option(str(factor))
        assert said in shown.page.locator("#slip").inner_text()


def test_limits_and_ghosts_are_there_on_request(shown: Opened) -> None:
    plain = shown.picture("rcmqp.seek(1.0)")
    for key in ("l", "g"):
        shown.page.keyboard.press(key)
        assert (np.abs(shown.picture() - plain).max(axis=-1) > 3.0).sum() > 500
        shown.page.keyboard.press(key)
    assert np.array_equal(shown.picture(), plain)


def test_limits_have_marks_while_they_are_shown(shown: Opened) -> None:
    marks = shown.page.locator("#keys .mark:visible")
    for on in (True, False):
        shown.js("limits => rcmqp.choose({limits})", on)
        limits = ["cone of the shaft", "depths of the tip"] if on else []
        assert marks.all_inner_texts() == ["desired tip", "target", "obstacle", *limits]


def test_an_anchor_that_is_no_pane_hides_nothing(opened: Opened) -> None:
    other = opened.page.context.new_page()
    other.goto(opened.page.url.partition("#")[0] + "#results")
    other.wait_for_selector("#wait", state="detached")
    assert other.locator("footer").is_visible()
    assert other.locator("nav").is_visible()
    other.close()


def test_legend_and_table_name_every_run(shown: Opened) -> None:
    rows = shown.page.locator("#legend tbody tr")
    assert rows.count() == len(CONTROLLERS)
    heads = shown.page.locator("footer th").all_inner_texts()
    assert [head.partition(",")[0].strip() for head in heads[1:]] == list(CONTROLLERS)
    for i, name in enumerate(CONTROLLERS):
        assert name in rows.nth(i).inner_text()
    rows.nth(1).click()
    assert "main" in (rows.nth(1).get_attribute("class") or "")
