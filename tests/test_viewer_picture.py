"""What the page draws and writes, read back and compared with the runs."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose
from opened import Opened

from rcmqp import Run, load_scenario, make_controller, simulate
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.operators import CameraTrial
from rcmqp.runs.setup import GIVEN
from rcmqp.runs.vocabulary import MEASURES
from rcmqp.show.labels import COLOURS, SPHERES
from rcmqp.show.viewer.timeline import slip
from rcmqp.world.camera import Pinhole, camera_pose
from rcmqp.world.motions import Sinusoid
from rcmqp.world.obstacles import Sphere

GAINS = (60.0, 20.0)


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """Two operators at the camera task, in a trocar that moves and that has limits."""
    still = load_scenario("camera_task", "lwa3", period=0.01, duration=6.0)
    found = []
    for seed, gain in enumerate(GAINS, start=1):
        scenario = dataclasses.replace(
            still,
            seed=seed,
            trocar=dataclasses.replace(
                still.trocar, cone_half_angle=0.7, depth_range=(0.03, 0.24)
            ),
            motion=Sinusoid(0.01, 0.5, still.insertion().from_start((1.0, 0.0, 0.0)), ramp=0.5),
            pivot_velocity="unknown",
        )
        controller = make_controller(
            "dual_quaternion", scenario.insertion(), scenario.period, gain=gain
        )
        found.append(simulate(scenario, controller))
    return found


@pytest.fixture
def shown(opened: Opened) -> Opened:
    """The page as it opens: at the start, paused."""
    opened.js("rcmqp.choose({main: 0, ghosts: false, limits: false})")
    opened.seek(0.0)
    return opened


def moved(run: Run) -> int:
    """A row in which the trocar is away from where it was, and the run slips off it."""
    far = np.linalg.norm(run.pivot - run.pivot[0], axis=1)
    return int(np.argmax(np.where(far > 0.005, run.rcm_error, 0.0)))


def box(points: Array) -> Array:
    """Least and largest corner (2, 3) of points (n, 3)."""
    return np.array([points.min(axis=0), points.max(axis=0)])


def asked(run: Run, k: int) -> tuple[Array, list[Sphere]]:
    """The camera task's objectives (4, 3) and spheres at row k, in the world [m]."""
    assert isinstance(run.scenario.path, CameraTrial)
    task = run.scenario.path.task
    R = dq.to_se3(run.insertion().x_rcm).rotation
    centres = [run.pivot[k] + R @ np.array(sphere.centre) for sphere in task.spheres]
    spheres = [Sphere(tuple(c), task.sphere_radius) for c in centres]
    return run.pivot[k] + np.array(task.targets) @ R.T, spheres


@pytest.mark.parametrize("factor", [1, 10])
def test_the_arrow_goes_from_the_trocar_to_the_shaft_as_many_times_as_asked(
    shown: Opened, runs: list[Run], factor: int
) -> None:
    for i, run in enumerate(runs):
        k = moved(run)
        shown.js(f"rcmqp.choose({{main: {i}, magnify: {factor}}}), rcmqp.seek({run.time[k]})")
        vector = factor * slip(run.x, run.pivot)[k]
        length = float(np.linalg.norm(vector))
        assert length > 5e-4
        around = shown.boxes("slip")[i] - run.pivot[k]
        ends = box(np.array([np.zeros(3), vector]))
        assert_allclose(around, ends, rtol=0, atol=0.27 * length)  # the head's width
        assert_allclose(around.mean(axis=0), ends.mean(axis=0), rtol=0, atol=0.12 * length)
        assert f"drawn \u00d7{factor}" in shown.page.locator("#slip").inner_text()


def test_an_arrow_too_small_to_draw_is_said_to_be_one(shown: Opened, runs: list[Run]) -> None:
    assert runs[0].rcm_error[0] < 1e-9
    assert "too small to draw" in shown.page.locator("#slip").inner_text()
    assert shown.js("rcmqp.shown('slip')") == [False, False]


def test_trocar_limits_and_what_is_asked_for_go_with_the_trocar(
    shown: Opened, runs: list[Run]
) -> None:
    run, k = runs[0], moved(runs[0])
    shown.seek(run.time[k])
    targets, spheres = asked(run, k)
    (trocar,), (wall,), (limits,) = (shown.boxes(name) for name in ("trocar", "wall", "limits"))
    assert_allclose(trocar.mean(axis=0), run.pivot[k], rtol=0, atol=1e-5)
    assert_allclose(shown.boxes("targets").mean(axis=1), targets, rtol=0, atol=1e-5)
    for found, sphere in zip(shown.boxes("spheres"), spheres, strict=True):
        expected = np.add.outer([-sphere.radius, sphere.radius], sphere.centre)
        assert_allclose(found, expected - [[0, 0, 0]] * 2, rtol=0, atol=1e-4)

    axis = np.array(run.scenario.trocar.axis)
    assert (wall.mean(axis=0) - run.pivot[k]) @ axis > 0.005  # it bends into the patient
    angle = run.scenario.trocar.cone_half_angle
    x, y = np.linalg.svd(axis[None])[2][1:]
    rim = [
        r * (np.cos(a) * axis + np.sin(a) * (np.cos(b) * x + np.sin(b) * y))
        for r in run.scenario.trocar.depth_range
        for a in np.linspace(0.0, angle, 40)
        for b in np.linspace(0.0, 2.0 * np.pi, 80)
    ]
    assert_allclose(limits, run.pivot[k] + box(np.array(rim)), rtol=0, atol=1e-3)


def test_obstacles_stay_and_are_as_large_as_they_are(shown: Opened, runs: list[Run]) -> None:
    shown.seek(runs[0].time[moved(runs[0])])
    for found, sphere in zip(shown.boxes("obstacles"), runs[0].scenario.obstacles, strict=True):
        expected = np.add.outer([-sphere.radius, sphere.radius], sphere.centre)
        assert_allclose(found, expected, rtol=0, atol=1e-4)


def test_each_run_has_its_own_trail_and_the_main_run_its_desired_one(
    shown: Opened, runs: list[Run]
) -> None:
    assert np.abs(runs[0].tip_d - runs[1].tip_d).max() > 0.02
    for name, channel in (("trails", "tip"), ("desired", "tip_d")):
        for found, run in zip(shown.boxes(name), runs, strict=True):
            assert_allclose(found, box(getattr(run, channel)), rtol=0, atol=1e-3)
    for main in (0, 1):
        shown.js("main => rcmqp.choose({main})", main)
        assert shown.js("rcmqp.shown('desired')") == [main == 0, main == 1]


def test_a_trail_goes_on_to_the_frame_that_the_tip_goes_to(shown: Opened, runs: list[Run]) -> None:
    for i, run in enumerate(runs):
        speed = np.linalg.norm(np.diff(run.tip, axis=0), axis=1)
        k = int(np.argmax(speed))
        assert speed[k] > 1e-4
        shown.seek(run.time[k : k + 2].mean())
        assert_allclose(shown.js("run => rcmqp.trail(run)", i)[-3:], run.tip[k + 1], atol=3e-5)
        shown.seek(0.0)
        assert shown.js("run => rcmqp.trail(run)", i) == []


def test_the_main_runs_arm_is_solid_and_the_others_are_ghosts(shown: Opened) -> None:
    for main, ghosts in ((0, False), (0, True), (1, False), (1, True)):
        shown.js(f"rcmqp.choose({{main: {main}, ghosts: {str(ghosts).lower()}}})")
        looks = [shown.js("run => rcmqp.arm(run)", i) for i in (0, 1)]
        assert looks[main] == "solid"
        assert looks[1 - main] == ("ghost" if ghosts else "hidden")


@pytest.mark.parametrize("main", [0, 1])
def test_the_endoscope_is_the_main_runs_and_shows_the_spheres_it_sees(
    shown: Opened, runs: list[Run], main: int
) -> None:
    k = int(np.argmax(np.linalg.norm(runs[0].tip - runs[1].tip, axis=1) > 0.01))
    assert k > 0
    shown.js(f"rcmqp.choose({{main: {main}}}), rcmqp.seek({runs[main].time[k]})")
    for name in ("trails", "desired"):
        shown.js("name => rcmqp.show(name, false)", name)
    image = shown.picture(which="endoscope")
    changed = image - shown.picture("rcmqp.show('spheres', false)", which="endoscope")
    without = shown.picture("rcmqp.show('targets', false)", which="endoscope")
    assert np.array_equal(image - changed, without)  # objectives are for who looks from outside
    for name in ("spheres", "trails", "targets"):
        shown.js("name => rcmqp.show(name, true)", name)
    _, spheres = asked(runs[main], k)
    scenario = runs[main].scenario
    pinhole = Pinhole(scenario.instrument.camera, len(image))
    pose = camera_pose(runs[main].x[k], runs[main].insertion().tip_depth)
    index, _ = pinhole.seen(pose, [*spheres, *scenario.obstacles])
    round_image = index != -2
    expected = (index >= 0) & (index < len(spheres))
    found = (np.abs(changed).max(axis=-1) > 8.0) & round_image
    assert expected.sum() > 200
    assert (found & expected).sum() / (found | expected).sum() > 0.85
    for i, colour in enumerate(SPHERES):
        if (index == i).sum() > 50:
            mean = image[index == i].mean(axis=0)
            assert np.corrcoef(mean, colour)[0, 1] > 0.9


def test_the_plots_are_the_runs_errors_in_mm_speeds_and_singular_values(
    shown: Opened, runs: list[Run]
) -> None:
    figure = "document.getElementById('figure')"
    traces: list[dict[str, Any]] = shown.js(
        f"{figure}.data.map(({{x, y, yaxis, line}}) => "
        "({x: [...x], y: [...y], yaxis, colour: line.color}))"
    )
    titles = shown.js(f"{figure}.layout.annotations.map(({{text}}) => text)")
    tops = shown.js(f"{figure}.layout.annotations.map(({{y}}) => y)")
    for row, (title, values) in enumerate(
        {
            "tip error [mm]": [1e3 * run.tip_error for run in runs],
            "RCM error [mm]": [1e3 * run.rcm_error for run in runs],
            "joint speed / limit": [np.abs(run.v / run.velocity_limit).max(1) for run in runs],
            "least singular value": [run.singular_value for run in runs],
        }.items()
    ):
        axis = "y" if row == 0 else f"y{row + 1}"
        domain = shown.js(f"{figure}.layout.{axis.replace('y', 'yaxis')}.domain")
        assert tops[titles.index(title)] == pytest.approx(domain[1])
        drawn = [trace for trace in traces if trace["yaxis"] == axis]
        assert [trace["colour"] for trace in drawn] == list(COLOURS[: len(runs)])
        for trace, run, expected in zip(drawn, runs, values, strict=True):
            assert_allclose(trace["x"], run.time, rtol=1e-6)
            assert_allclose(trace["y"], expected, rtol=1e-5, atol=1e-9)


def test_the_legend_says_the_errors_and_the_depth_of_every_run(
    shown: Opened, runs: list[Run]
) -> None:
    rows = shown.page.locator("#legend tbody tr")
    for run, k in ((runs[0], moved(runs[0])), (runs[1], 300)):
        shown.seek(run.time[k])
        for i, each in enumerate(runs):
            cells = rows.nth(i).locator("td").all_inner_texts()[1:]
            values = [float(cell.removesuffix(" mm")) for cell in cells]
            expected = [1e3 * each.tip_error[k], 1e3 * each.rcm_error[k], 1e3 * each.depth[k]]
            assert_allclose(values, expected, rtol=6e-3)


def test_the_table_says_the_metrics_of_every_run(shown: Opened, runs: list[Run]) -> None:
    cells = {}
    for row in shown.page.locator("footer tbody tr").all():
        name, *values = row.locator("td").all_inner_texts()
        cells[name] = values

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2)))

    moving = {  # to the end: there is no rest to measure
        "reference stops [s]",
        "tip past its end, max [mm]",
        "tip below 1 mm for good, after [s]",
        "swing of a joint over its speed limit, at the end",
    }
    assert {name for name, values in cells.items() if "no stop" in values} == moving
    seen = {"depth of the tip, least [mm]", "depth of the tip, max [mm]", *moving}
    for i, run in enumerate(runs):
        for name, expected in {
            "rms until [s]": run.time[-1],
            "tip error, rms [mm]": 1e3 * rms(run.tip_error),
            "tip error, max [mm]": 1e3 * run.tip_error.max(),
            "RCM error, rms [mm]": 1e3 * rms(run.rcm_error),
            "RCM error, max [mm]": 1e3 * run.rcm_error.max(),
            "orientation error, rms [mrad]": 1e3 * rms(run.orientation_error),
            "orientation error, max [mrad]": 1e3 * run.orientation_error.max(),
            "joint speed over its limit, max": np.abs(run.v / run.velocity_limit).max(),
            "joint acceleration over its limit, max": np.abs(
                np.diff(run.v, axis=0, prepend=0.0) / run.period / run.acceleration_limit
            ).max(),
            "joint jerk over its limit, max": np.abs(
                np.diff(np.pad(run.v, ((2, 0), (0, 0))), n=2, axis=0)
                / run.period**2
                / run.jerk_limit
            ).max(),
            "margin to joint limits, least [rad]": min(
                (run.angles - run.lower).min(), (run.upper - run.angles).min()
            ),
            "singular value, least": run.singular_value.min(),
            "tip speed asked for, rms [mm/s]": 1e3
            * rms(np.linalg.norm(np.diff(run.tip_d, axis=0), axis=1) / run.period),
            "cycles in a row in which a joint turns round": 1.0,  # where the operator does
            "step of a joint's speed over its limit, max": np.abs(
                np.diff(run.v, axis=0, prepend=0.0) / run.velocity_limit
            ).max(),
            "controller step, median [us]": 1e6 * np.median(run.solve_time),
            "cycles in the safe stop": 0.0,
        }.items():
            rounded = 0.5 if "median" in name else 5e-4
            assert float(cells[name][i]) == pytest.approx(expected, rel=6e-3, abs=rounded), name
            seen.add(name)
        low, high = (float(cells[f"depth of the tip, {x} [mm]"][i]) for x in ("least", "max"))
        assert_allclose([low, high], 1e3 * box(run.depth[:, None]).ravel(), rtol=0, atol=0.06)
    others = {
        "cycles in which a joint turns round",
        "contour error, rms [mm]",
        "contour error, max [mm]",
        "lag of the tip, max [s]",
    }
    assert set(cells) - seen == others | {
        MEASURES[name].row for name in GIVEN if name != "setup"
    }  # see test_contour, test_given
    assert cells[MEASURES["assumed"].row] == [" and ".join(run.assumed) or "none" for run in runs]
    assert seen <= set(cells)


def test_the_close_up_makes_way_for_limits_that_it_would_cover(shown: Opened) -> None:
    before = shown.page.viewport_size
    assert before is not None
    lens = shown.page.locator("#lens")
    try:
        shown.page.set_viewport_size({"width": 1280, "height": 800})
        lens.wait_for(state="visible")
        for limits in (True, False):
            shown.js("limits => (rcmqp.choose({limits}), rcmqp.draw())", limits)
            assert lens.is_visible() != limits
    finally:
        shown.page.set_viewport_size(before)
        lens.wait_for(state="hidden")  # it does not fit any more: all has its size again
