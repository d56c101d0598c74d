"""The page of what is out of the ordinary: odd runs, an arm that slides, windows of any shape."""

from __future__ import annotations

import dataclasses
from itertools import combinations
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose
from opened import Opened

from rcmqp import Run, Scenario, load_arm, make_controller, simulate
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths import ConicalHelix
from rcmqp.show.labels import COLOURS
from rcmqp.show.viewer.browser import open_page
from rcmqp.show.viewer.build import write_page
from rcmqp.show.viewer.shapes import arm_parts

LIFT = """
<link name="floor"><visual><geometry><box size="0.2 0.2 0.1"/></geometry>
<material name="odd"><color rgba="0.1 0.5 0.9 1"/></material></visual></link>
<joint name="lift" type="prismatic"><parent link="floor"/><child link="base_link"/>
<origin xyz="0.1 0 0.2" rpy="0 0.2 0.4"/><axis xyz="0 0.6 0.8"/>
<limit lower="-0.3" upper="0.3" velocity="0.2" effort="100"/></joint></robot>"""

STOPPED = [*range(20, 50), 99]
FIGURE = "document.getElementById('figure')"


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    lwa3 = load_arm("lwa3")
    assert lwa3.urdf is not None
    file = tmp_path_factory.mktemp("arm") / "lift.urdf"
    file.write_text(lwa3.urdf.read_text().replace("</robot>", LIFT))
    scenario = Scenario.on_shaft(
        "helix", str(file), ConicalHelix(), flange="flange", angles_start=[0.1, *lwa3.home]
    )
    return dataclasses.replace(scenario, duration=0.5, period=0.005)


@pytest.fixture(scope="module")
def runs(scenario: Scenario) -> list[Run]:
    """One run stopped now and then, and lacks numbers; the other is fast, and slips by 2 mm."""
    one, other = (
        simulate(
            scenario,
            make_controller("dual_quaternion", scenario.insertion(), scenario.period, gain=gain),
        )
        for gain in (60.0, 30.0)
    )
    ramp = np.linspace(0.0, 1.0, one.time.size)
    slipping = 0.1e-3 * ramp
    slipping[9] = np.nan
    unknown = np.where(np.isin(np.arange(one.time.size), STOPPED), np.nan, 1.0)
    fast = other.v * 0.7 / np.abs(other.v / other.velocity_limit).max()
    return [
        dataclasses.replace(
            one,
            tip_d=one.tip_d * unknown[:, None],
            tip_error=4e-3 * ramp * unknown,
            rcm_error=slipping,
            stops={"no view": STOPPED[:-1], "too fast": STOPPED[-1:]},
        ),
        dataclasses.replace(other, v=fast, tip_error=1e-4 * ramp, rcm_error=2e-3 * ramp),
    ]


def pixel(opened: Opened, point: Array) -> Array:
    """Where the scene's pane shows a point, (2,) from its upper left corner."""
    return np.array(opened.js("point => rcmqp.pixel(point)", point.tolist()))


def joints(run: Run, k: int) -> dict[str, Array]:
    """Placement (4, 4) of each link in the world at a row."""
    model = run.insertion().arm.model
    data = model.createData()
    pin.forwardKinematics(model, data, run.q[k])
    return {name: data.oMi[model.getJointId(name)].homogeneous for name in run.joints}


def test_a_joint_that_slides_takes_all_links_along(opened: Opened, runs: list[Run]) -> None:
    assert np.ptp(runs[0].angles[:, 0]) > 0.01
    for k in (0, runs[0].time.size - 1):
        opened.seek(runs[0].time[k])
        for name, expected in joints(runs[0], k).items():
            found = np.reshape(opened.js("link => rcmqp.pose(0, link)", name), (4, 4)).T
            assert_allclose(found, expected, rtol=0, atol=1e-5)


def test_a_shape_has_the_urdfs_colour(scenario: Scenario) -> None:
    (box,) = [part for part in arm_parts(scenario.insertion().arm) if part.joint == 0]
    assert_allclose(box.colour, [0.1, 0.5, 0.9], rtol=0, atol=1e-6)


def test_safe_stops_are_in_the_plots_and_counted(opened: Opened, runs: list[Run]) -> None:
    shapes = opened.js(f"{FIGURE}.layout.shapes")
    bands = [shape for shape in shapes if shape["type"] == "rect"]
    time, T = runs[0].time, runs[0].period
    for band, (first, last) in zip(bands, [(20, 49), (99, 99)], strict=True):
        assert_allclose([band["x0"], band["x1"]], [time[first], time[last] + T], rtol=1e-6)
        assert (band["yref"], band["y0"], band["y1"]) == ("paper", 0, 1)
        assert band["fillcolor"] == COLOURS[0]
    assert "safe stop" in opened.page.locator("#keys .mark:visible").all_inner_texts()
    row = opened.page.locator("footer tbody tr", has_text="cycles in the safe stop")
    assert row.locator("td").all_inner_texts()[1:] == [str(len(STOPPED)), "0"]


def test_numbers_that_are_missing_are_said_to_be(opened: Opened, runs: list[Run]) -> None:
    legend = opened.page.locator("#legend tbody tr").first
    for k, expected in ((15, "0.600 mm"), (30, "missing"), (100, "4.00 mm")):
        opened.seek(runs[0].time[k])
        assert legend.locator("td").nth(1).inner_text() == expected
    row = opened.page.locator("footer tbody tr", has_text="tip error, max")
    assert row.locator("td").nth(1).inner_text() == "missing"
    assert "nan" not in opened.page.locator("body").inner_text().lower()


def test_the_limit_of_the_speed_is_drawn_where_it_is_near(opened: Opened) -> None:
    lines = [s for s in opened.js(f"{FIGURE}.layout.shapes") if s["type"] == "line"]
    assert [(s["yref"], s["y0"], s["y1"]) for s in lines] == [("y3", 1, 1)]


def test_errors_far_apart_are_drawn_logarithmically(opened: Opened) -> None:
    axes = opened.js(f"['', 2, 3, 4].map((i) => {FIGURE}._fullLayout[`yaxis${{i}}`].type)")
    assert axes == ["log", "linear", "linear", "linear"]  # maxima 40 and 20 times apart


def test_curves_and_their_marks_are_dashed_alike(opened: Opened) -> None:
    curves = opened.js(f"{FIGURE}.data.map(({{line}}) => line.dash)")
    assert curves == ["solid", "dash"] * 4
    marks = "[...document.querySelectorAll(`${where} .run`)].map((mark) => mark.classList[1])"
    for where in ("#legend", "footer th"):
        assert opened.js(f"where => {marks}", where) == ["solid", "dashed"]


def test_the_slip_is_magnified_to_three_centimetres_at_most(opened: Opened) -> None:
    assert opened.page.locator("#magnify").input_value() == "10"  # of 2 mm, and one is missing


def test_a_plot_is_dragged_over_with_the_first_button_only(opened: Opened) -> None:
    plot = opened.page.locator("rect.nsewdrag[data-subplot='xy2']")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    assert box is not None
    mouse, y = opened.page.mouse, box["y"] + box["height"] / 2
    mouse.move(box["x"] + 0.2 * box["width"], y)
    mouse.down()
    for share in (0.4, 0.8):
        mouse.move(box["x"] + share * box["width"], y)
        assert opened.js("rcmqp.time") == pytest.approx(0.5 * share, abs=5e-3)
    mouse.up()
    mouse.click(box["x"] + box["width"] / 2, y, button="right")
    assert opened.js("rcmqp.time") == pytest.approx(0.4, abs=5e-3)


def test_the_clock_of_a_short_run_has_more_decimals(opened: Opened) -> None:
    opened.seek(0.1234)
    assert opened.page.locator("#clock").inner_text() == "0.123 / 0.500 s"
    assert opened.page.locator("#time").get_attribute("aria-valuetext") == "0.123 s"


def test_without_a_mouse_a_run_is_chosen_and_all_has_a_name(opened: Opened) -> None:
    rows = opened.page.get_by_role("button", name="dual_quaternion")
    for i, key in ((1, "Enter"), (0, "Space")):
        rows.nth(i).focus()
        opened.page.keyboard.press(key)
        assert [opened.js(f"rcmqp.arm({j})") == "solid" for j in (0, 1)] == [i == 0, i == 1]
        assert rows.nth(i).get_attribute("aria-pressed") == "true"
        assert rows.nth(1 - i).get_attribute("aria-pressed") == "false"
    assert not opened.js("rcmqp.playing")
    for name in ("the arm", "the endoscope", "errors, joint speed"):
        assert opened.page.get_by_role("img", name=name).count() == 1
    assert opened.page.locator("#clock").get_attribute("aria-live") == "off"


def test_a_run_of_one_instant_is_shown(opened: Opened, runs: list[Run], tmp_path: Path) -> None:
    rows = {name: values[:1] for name, values in runs[1].rows().items()}
    slow = {"v": 0.5 * runs[1].v[:1] / 0.7}
    run = runs[1].with_rows(rows | slow, {}, {})
    page = open_page(opened.page.context, write_page([run], tmp_path / "one.html"))
    other = Opened(page, [], [])
    for t in (0.0, 1.0):
        other.seek(t)
        for name, expected in joints(run, 0).items():
            found = np.reshape(other.js("link => rcmqp.pose(0, link)", name), (4, 4)).T
            assert_allclose(found, expected, rtol=0, atol=1e-5)
    assert "NaN" not in page.locator("body").inner_text()
    assert page.locator("#clock").inner_text() == "0.00 / 0.00 s"
    assert page.locator("#figure .scatterlayer path.point").count() == 4
    assert other.js(f"{FIGURE}.layout.shapes") == []  # far below the limit of the speed
    page.close()


def resize(opened: Opened, width: int, height: int) -> None:
    """Give the page a window of another size, and wait until all has followed."""
    opened.page.set_viewport_size({"width": width, "height": height})
    frames = "requestAnimationFrame(() => requestAnimationFrame(done))"
    opened.js(f"() => new Promise((done) => {frames})")


@pytest.mark.parametrize(
    "size", [(1280, 800), (1024, 768), (961, 700), (768, 1024), (390, 844)], ids=str
)
def test_nothing_overlaps_or_is_cut(opened: Opened, size: tuple[int, int]) -> None:
    resize(opened, *size)
    assert opened.js("document.documentElement.scrollWidth") <= size[0]
    corners = {}
    for name in ("header", "#scene", "#scope", "#legend", "#plots", "nav", "footer"):
        box = opened.page.locator(name).bounding_box()
        assert box is not None
        low = np.array([box["x"], box["y"]])
        corners[name] = low, low + np.array([box["width"], box["height"]])
        assert 0.0 <= low[0] < corners[name][1][0] <= size[0]
    for (one, a), (other, b) in combinations(corners.items(), 2):
        assert (np.maximum(a[0], b[0]) >= np.minimum(a[1], b[1]) - 0.5).any(), (one, other)
    wide, high = corners["#scope"][1] - corners["#scope"][0]
    assert wide == pytest.approx(high, abs=1.0)  # what the endoscope sees is round
    assert wide > 100.0
    legend = "document.getElementById('legend')"
    assert opened.js(f"{legend}.scrollWidth - {legend}.clientWidth") == 0


@pytest.mark.parametrize("size", [(240, 600), (800, 250), (480, 480), (64, 64)], ids=str)
def test_a_picture_shows_the_whole_arm_the_trocar_and_the_tip(
    opened: Opened, runs: list[Run], size: tuple[int, int]
) -> None:
    opened.js("document.body.dataset.solo = 'scene', rcmqp.choose({close: false}), rcmqp.seek(0)")
    resize(opened, *size)
    trocar = pixel(opened, runs[0].pivot[0])
    links = [pixel(opened, placement[:3, 3]) for placement in joints(runs[0], 0).values()]
    points = np.array([trocar, pixel(opened, runs[0].tip[0]), *links])
    assert (points >= 0.0).all()
    assert (points <= size).all()
    assert max(np.ptp(points, axis=0) / size) > 0.25  # and no smaller than need be
    if size == (480, 480):  # so small that it has no close-up
        drawn = opened.picture() - opened.picture("rcmqp.show('trocar', false)")
        opened.js("rcmqp.show('trocar', true)")
        rows, columns = np.nonzero(np.abs(drawn).max(axis=-1) > 12.0)
        assert_allclose([np.median(columns), np.median(rows)], trocar, rtol=0, atol=6.0)
    for _ in range(2):
        opened.page.keyboard.press("f")
    assert_allclose(pixel(opened, runs[0].pivot[0]), trocar)  # the same picture again
