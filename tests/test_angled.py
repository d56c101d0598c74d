"""An instrument mounted beside the flange, at an angle, with a camera that looks aside."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, shaft_distance
from opened import Opened

from rcmqp import Camera, Instrument, Run, Scenario, load_arm, make_controller, simulate
from rcmqp.errors import OptionError, RcmqpError, UnknownName
from rcmqp.maths import dualquaternion as dq
from rcmqp.references.hand import DeviceState, ImageHand
from rcmqp.references.paths import ViewMoves
from rcmqp.references.view import view_pose
from rcmqp.runs.loading import load_scenario
from rcmqp.world.camera import OUTSIDE, Pinhole, camera_pose
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Mount
from rcmqp.world.instrument_file import load_instrument
from rcmqp.world.obstacles import Sphere

MOUNT = Mount((0.02, -0.03, 0.05), (0.2, math.radians(45.0), -0.3))
ANGLE, ROLL = math.radians(30.0), math.radians(20.0)
SCOPE = Instrument(mount=MOUNT, camera=Camera(angle=ANGLE, roll=ROLL))

FILE = """
length = 0.31
mount_offset = 0.01

[mount]
xyz = [0.02, -0.03, 0.05]
rpy = [0.2, 0.7854, -0.3]

[camera]
angle = 0.5236
field_of_view = 1.2

[sources]
length = "measured"
"""


def by_hand(oMf: pin.SE3, length: float) -> pin.SE3:
    """The tip of SCOPE with Pinocchio's turns, one after the other."""
    roll, pitch, yaw = MOUNT.rpy
    R = pin.utils.rotate("z", yaw) @ pin.utils.rotate("y", pitch) @ pin.utils.rotate("x", roll)
    along = pin.SE3(np.eye(3), np.array([0.0, 0.0, length]))
    return oMf * pin.SE3(R, np.array(MOUNT.xyz)) * along


def looking(oMtip: pin.SE3) -> pin.SE3:
    """The camera of SCOPE at a tip: turned down about x, then rolled about where it looks."""
    R = pin.utils.rotate("x", -ANGLE) @ pin.utils.rotate("z", ROLL)
    return oMtip * pin.SE3(R, np.zeros(3))


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """A view with the scope, and a sphere in the middle of what its camera sees at the start."""
    scenario = load_scenario("helix", "lwa3", instrument=SCOPE, duration=1.0, period=0.008)
    scenario = dataclasses.replace(
        scenario, path=ViewMoves(views=((0.1, 0.05, 0.0, 0.02),), move=0.8, dwell=0.2)
    )
    insertion = scenario.insertion()
    camera = looking(by_hand(flange(insertion, insertion.q_start), 0.33))
    ahead = camera.act(np.array([0.004, -0.006, 0.06]))
    scenario = dataclasses.replace(scenario, obstacles=(Sphere(tuple(ahead), 0.006),))
    made = make_controller("hierarchical_qp", scenario.insertion(), scenario.period)
    return [simulate(scenario, made)]


def flange(insertion: Insertion, q: np.ndarray) -> pin.SE3:
    arm = load_arm(insertion.arm.name)
    data = arm.model.createData()
    pin.framesForwardKinematics(arm.model, data, q)
    return data.oMf[arm.model.getFrameId(arm.flange)]


@pytest.mark.parametrize("name", ["lwa3", "panda", "ur10"])
def test_a_shaft_mounted_aside_and_at_45_degrees_stays_on_the_trocar(name: str) -> None:
    scenario = load_scenario("helix", name, instrument=SCOPE, duration=2.0)
    insertion = scenario.insertion()
    run = simulate(scenario, make_controller("hierarchical_qp", insertion, scenario.period))
    assert run.rcm_error.max() < 1e-6
    assert run.tip_error.max() < 2e-6
    for k in (0, len(run.q) // 2, len(run.q) - 1):
        tip = by_hand(flange(insertion, run.q[k]), 0.33)
        assert shaft_distance(tip, run.pivot[k]) < 1e-6
        assert_allclose(run.tip[k], tip.translation, rtol=0, atol=1e-12)


def test_the_camera_is_turned_down_and_then_rolled() -> None:
    insertion = Insertion.on_shaft(load_arm("panda"), SCOPE)
    tip = by_hand(flange(insertion, insertion.q_start), 0.33)
    seen = camera_pose(insertion.x_rcm, insertion.tip_depth, SCOPE.camera)
    assert_allclose(dq.to_se3(seen).homogeneous, looking(tip).homogeneous, rtol=0, atol=1e-12)
    straight = camera_pose(insertion.x_rcm, insertion.tip_depth, Camera())
    assert_allclose(straight, camera_pose(insertion.x_rcm, insertion.tip_depth), rtol=0, atol=0)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("rolled", [0.0, 0.7])
def test_the_hand_moves_the_tip_in_the_axes_of_the_angled_picture(
    axis: int, rolled: float
) -> None:
    insertion = Insertion.on_shaft(load_arm("panda"), SCOPE)
    hand = ImageHand(insertion)
    for place, roll in (((0.0, 0.0, 0.0), 0.0), ((0.03, -0.02, 0.01), rolled)):
        hand.ask(DeviceState(place, roll=roll))
    before = dq.to_se3(view_pose(insertion.x_rcm, hand.view).x_d)
    along = pin.SE3(np.eye(3), np.array([0.0, 0.0, insertion.tip_depth]))
    step = 1e-5 * np.eye(3)[axis]
    x, y, z = np.array([0.03, -0.02, 0.01]) + step
    hand.ask(DeviceState((x, y, z), roll=rolled))
    after = dq.to_se3(view_pose(insertion.x_rcm, hand.view).x_d)
    moved = looking(before * along).actInv((after * along).translation)
    assert_allclose(moved, step, rtol=0, atol=2e-7)


def test_the_endoscope_shows_a_point_where_the_angled_pinhole_projects_it(
    opened: Opened, runs: list[Run]
) -> None:
    run = runs[0]
    for name in ("trails", "desired", "targets"):
        opened.js("name => rcmqp.show(name, false)", name)
    for k in (0, len(run.time) - 1):
        image = opened.picture(f"rcmqp.seek({run.time[k]})", which="endoscope")
        without = opened.picture("rcmqp.show('obstacles', false)", which="endoscope")
        opened.js("rcmqp.show('obstacles', true)")
        rows, columns = np.nonzero(np.abs(image - without).max(axis=-1) > 8.0)
        assert rows.size > 100
        camera = looking(by_hand(flange(run.insertion(), run.q[k]), 0.33))
        pinhole = Pinhole(SCOPE.camera, len(image))
        index, _ = pinhole.seen(dq.from_se3(camera), run.scenario.obstacles)
        i, j = np.nonzero(index == 0)
        found = np.array([columns.mean(), rows.mean()])
        assert_allclose(found, [j.mean(), i.mean()], rtol=0, atol=1.0)
        assert (index != OUTSIDE).any()


def test_a_scenario_with_a_scope_is_the_same_out_of_its_own_text(runs: list[Run]) -> None:
    scenario = runs[0].scenario
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert "mount" not in load_scenario("helix").to_json().replace("mount_offset", "")


def test_an_instruments_file_is_read(tmp_path: Path) -> None:
    file = tmp_path / "scope.toml"
    file.write_text(FILE)
    mount = Mount((0.02, -0.03, 0.05), (0.2, 0.7854, -0.3))
    expected = Instrument(
        length=0.31, mount_offset=0.01, mount=mount, camera=Camera(1.2, angle=0.5236)
    )
    assert load_instrument(file) == expected


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("length = 0", r"scope.toml: length = 0 m, it must be positive"),
        ("[camera]\nangle = 30", "angle = 30 rad, it must be from 0 to 1.222, which is 70"),
        ("[mount]\nrpy = [0, 45, 0]", "are these degrees"),
        ("[mount]\nxyz = [0, 45]", "three finite numbers"),
        ("camera = 3", r"camera = 3, it must be a table: \[camera\]"),
        ("lenght = 0.3", "unknown key in .*scope.toml 'lenght'.*length"),
        ("[camera]\nfov = 1", r"key in .*scope.toml \[camera\]"),
        ("length = ", "is not TOML"),
        (None, "no such file"),
    ],
)
def test_a_file_that_is_wrong_is_refused_in_words(
    tmp_path: Path, text: str | None, said: str
) -> None:
    file = tmp_path / "scope.toml"
    if text is not None:
        file.write_text(text)
    with pytest.raises((OptionError, UnknownName, RcmqpError), match=said):
        load_instrument(file)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Camera(angle=30.0), "70 degrees; are these degrees"),
        (lambda: Mount(xyz=(0.0, 60.0, 40.0)), "are these millimetres"),
        (lambda: Instrument(length=330.0), "are these millimetres"),
    ],
)
def test_other_units_of_an_instrument_are_questioned(
    make: Callable[[], object], said: str
) -> None:
    with pytest.raises(OptionError, match=said):
        make()
