"""Arms from files of one's own: the format of robots/<name>/robot.toml."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose
from test_urdf import link, urdf

from rcmqp import Arm, Insertion, Instrument, Scenario, load_arm
from rcmqp.cli import main
from rcmqp.errors import ArmError, InvalidCommand, OptionError, RcmqpError, UnknownName
from rcmqp.references.paths import Circle

HOME = [0.1, -0.6, 0.2, 1.1, -0.1, 0.9, 0.3]


def arm_file(folder: Path, *lines: str, flange: str = 'frame = "l7"') -> Path:
    (folder / "r.urdf").write_text(urdf())
    top = [line for line in lines if not line.startswith("[")]
    tables = [line for line in lines if line.startswith("[")]
    path = folder / "my_robot.toml"
    text = "\n".join(['urdf = "r.urdf"', *top, "[flange]", flange, *tables])
    path.write_text(text, encoding="utf-8")
    return path


def flange(arm: Arm, angles: list[float]) -> pin.SE3:
    return arm.state(arm.configuration(angles)).oMe


def test_a_file_is_the_arm_of_its_urdf_with_what_it_says(tmp_path: Path) -> None:
    path = arm_file(
        tmp_path,
        'title = "Mine"',
        f"home = {HOME}",
        "position = { j2 = [-1.5, 1.0] }",
        "velocity = 1.5",
        "acceleration = [1, 2, 3, 4, 5, 6, 7]",
        "jerk = { j1 = 50.0, j7 = inf }",
    )
    arm, plain = load_arm(path), load_arm(tmp_path / "r.urdf", "l7", home=HOME)
    assert (arm.title, arm.name) == ("Mine", str(path))
    assert arm.home.tolist() == HOME
    assert flange(arm, HOME) == flange(plain, HOME)
    assert (arm.lower[1], arm.upper[1], arm.lower[0]) == (-1.5, 1.0, -2.6)
    assert (arm.velocity == 1.5).all()
    assert arm.acceleration.tolist() == [1, 2, 3, 4, 5, 6, 7]
    assert (arm.jerk[0], arm.jerk[6]) == (50.0, math.inf)
    assert arm.is_assumed("jerk").tolist() == [False, *[True] * 5, False]
    assert not arm.limits_by_hand.given()  # they are its own
    changed = load_arm(path, velocity=0.5).limits_by_hand.given()
    assert changed == {"velocity": (0.5,) * 7}


@pytest.mark.parametrize(
    ("xyz", "rpy"), [((0.0, 0.0, 2.0), (math.pi, 0.0, 0.0)), ((1.0, -2.0, 0.3), (0.2, -0.5, 1.0))]
)
def test_a_base_stands_where_the_file_says(
    tmp_path: Path, xyz: tuple[float, ...], rpy: tuple[float, ...]
) -> None:
    path = arm_file(tmp_path, f"home = {HOME}", f"[base]\nxyz = {list(xyz)}\nrpy = {list(rpy)}")
    plain = load_arm(tmp_path / "r.urdf", "l7", home=HOME)
    oMb = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
    expected = oMb * flange(plain, HOME)
    assert_allclose(flange(load_arm(path), HOME).homogeneous, expected.homogeneous, atol=1e-14)


def test_a_rail_is_a_joint_more(tmp_path: Path) -> None:
    path = arm_file(
        tmp_path,
        f"home = {[0.2, *HOME]}",
        "[base]\nxyz = [0.0, 0.0, 0.5]",
        "[rail]\naxis = [0.0, 1.0, 0.0]\nlower = -0.4\nupper = 0.6\nvelocity = 0.25",
    )
    arm = load_arm(path)
    plain = load_arm(tmp_path / "r.urdf", "l7", home=HOME)
    assert arm.joints == ("rail", *plain.joints)
    assert (arm.lower[0], arm.upper[0], arm.velocity[0]) == (-0.4, 0.6, 0.25)
    assert arm.turns.tolist() == [False, *[True] * 7]
    moved = pin.SE3(np.eye(3), np.array([0.0, 0.2, 0.5])) * flange(plain, HOME)
    assert_allclose(flange(arm, [0.2, *HOME]).homogeneous, moved.homogeneous, atol=1e-14)


def test_a_scope_is_mounted_at_an_angle_and_an_offset(tmp_path: Path) -> None:
    tilt = math.radians(45.0)
    path = arm_file(
        tmp_path,
        f"home = {HOME}",
        flange=f'frame = "l7"\nxyz = [0.0, 0.05, 0.02]\nrpy = [0.0, {tilt}, 0.0]',
    )
    plain = load_arm(tmp_path / "r.urdf", "l7", home=HOME)
    mount = pin.SE3(pin.rpy.rpyToMatrix(0.0, tilt, 0.0), np.array([0.0, 0.05, 0.02]))
    expected = flange(plain, HOME) * mount
    assert_allclose(flange(load_arm(path), HOME).homogeneous, expected.homogeneous, atol=1e-14)


def test_a_file_may_change_a_registered_arm(tmp_path: Path) -> None:
    path = tmp_path / "ceiling.toml"
    path.write_text('like = "lwa3"\n[base]\nxyz = [0, 0, 2]\nrpy = [3.141592653589793, 0, 0]\n')
    arm, own = load_arm(path), load_arm("lwa3")
    assert np.array_equal(arm.acceleration, own.acceleration)
    up = pin.SE3(pin.rpy.rpyToMatrix(math.pi, 0.0, 0.0), np.array([0.0, 0.0, 2.0]))
    here = flange(arm, own.home.tolist()).homogeneous
    assert_allclose(here, (up * flange(own, own.home.tolist())).homogeneous, atol=1e-14)
    assert arm.sha256 != own.sha256


@pytest.mark.parametrize(
    ("table", "rpy", "kept"),
    [
        ("base", [0.0, 0.0, 1.0], True),
        ("base", [math.pi, 0.0, 0.0], False),
        ("flange", [0.0, 0.0, -0.5], True),
        ("flange", [0.0, 0.7854, 0.0], False),
    ],
)
def test_an_arm_that_is_tilted_does_not_keep_the_home_of_the_one_that_it_is_like(
    tmp_path: Path, table: str, rpy: list[float], kept: bool
) -> None:
    """It would point elsewhere; the shaft of the one that is found points down."""
    path = tmp_path / "mine.toml"
    path.write_text(f'like = "lwa3"\n[{table}]\nrpy = {rpy}\n')
    arm = load_arm(path)
    assert np.array_equal(arm.home, load_arm("lwa3").home) is kept
    assert flange(arm, arm.home.tolist()).rotation[2, 2] < -math.cos(math.radians(45.0))


def test_joints_are_locked_and_a_scenario_keeps_it(tmp_path: Path) -> None:
    path = arm_file(tmp_path, "[locked]\nj3 = 0.3")
    arm = load_arm(path)
    assert arm.joints == ("j1", "j2", "j4", "j5", "j6", "j7")
    insertion = Insertion.on_shaft(arm, Instrument())
    scenario = Scenario.of("mine", insertion, Circle(duration=2.0), period=0.01)
    again = Scenario.from_json(scenario.to_json()).insertion()
    assert again.arm.joints == arm.joints
    assert np.array_equal(again.x_rcm, insertion.x_rcm)


def test_a_scenario_refuses_locks_that_it_cannot_keep(tmp_path: Path) -> None:
    arm_file(tmp_path)
    arm = load_arm(tmp_path / "r.urdf", "l7", locked={"j3": 0.3})
    insertion = Insertion.on_shaft(arm, Instrument())
    with pytest.raises(OptionError, match=r"holds j3 at 0\.3 .* write an arm's file"):
        Scenario.of("mine", insertion, Circle(duration=2.0))


def test_angles_may_come_by_name_in_any_order(tmp_path: Path) -> None:
    text = urdf().replace(link(4, "y"), link(4, "y", "continuous"))
    (tmp_path / "r.urdf").write_text(text)
    home = {f"j{i}": HOME[i - 1] for i in (7, 6, 5, 4, 3, 2, 1)}
    arm = load_arm(tmp_path / "r.urdf", "l7", home=home)
    assert arm.home.tolist() == HOME
    named = {"gripper": 0.04} | dict(reversed(list(zip(arm.joints, HOME, strict=True))))
    assert np.array_equal(arm.configuration(named), arm.configuration(HOME))
    del named["j4"]
    with pytest.raises(InvalidCommand, match="without j4, but with gripper, j7"):
        arm.configuration(named)
    with pytest.raises(UnknownName, match=r"unknown joint 'j8'"):
        load_arm(tmp_path / "r.urdf", "l7", home={"j8": 0.0})
    with pytest.raises(ArmError, match="home does not say where j2, j3"):
        load_arm(tmp_path / "r.urdf", "l7", home={"j1": 0.0})


WRONG = {
    "no TOML": ("urdf = ", "is not TOML: "),
    "no urdf": ('[flange]\nframe = "l7"', r'has no urdf; add urdf = "my_robot\.urdf"'),
    "no flange": ('urdf = "r.urdf"', r"has no \[flange\] with a frame"),
    "unknown key": ('urdf = "r.urdf"\nhoem = [0]', r"unknown key in .*'hoem'; did you mean home"),
    "unknown in a table": ('urdf = "r.urdf"\n[base]\nryp = [0]', r"\[base\] 'ryp'; .* rpy"),
    "no table": ('urdf = "r.urdf"\nflange = "l7"', r"it must be a table: \[flange\]"),
    "two numbers": (
        'urdf = "r.urdf"\n[flange]\nframe = "l7"\nxyz = [0, 1]',
        r"flange\.xyz = \[0, 1\], it must be three numbers",
    ),
    "half a rail": (
        'urdf = "r.urdf"\n[flange]\nframe = "l7"\n[rail]\naxis = [0, 1, 0]',
        r"\[rail\] has no lower",
    ),
    "unknown arm": ('like = "lwa4"', "unknown arm for like 'lwa4'; did you mean lwa3"),
    "both": ('like = "lwa3"\nurdf = "r.urdf"', "has both urdf and like"),
    "no folder": (
        'urdf = "r.urdf"\npackages = ["meshes"]\n[flange]\nframe = "l7"',
        r"there is no folder .*meshes",
    ),
    "no such URDF": ('urdf = "q.urdf"\n[flange]\nframe = "l7"', r"q\.urdf: no such file"),
    "locked at a word": (
        'urdf = "r.urdf"\n[flange]\nframe = "l7"\n[locked]\nj3 = "zero"',
        "j3 cannot be locked at 'zero'; give a number",
    ),
    "limits of nobody": (
        'urdf = "r.urdf"\njerk = { j9 = 3 }\n[flange]\nframe = "l7"',
        "unknown joint 'j9'",
    ),
}


@pytest.mark.parametrize(("text", "message"), WRONG.values(), ids=WRONG.keys())
def test_a_file_that_says_something_wrong_is_refused_in_words(
    tmp_path: Path, text: str, message: str
) -> None:
    path = arm_file(tmp_path)
    path.write_text(text)
    with pytest.raises(RcmqpError, match=message) as raised:
        load_arm(path)
    assert str(tmp_path) in str(raised.value)  # the file, or the URDF that it names


def test_a_missing_file_and_a_flange_beside_a_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ArmError, match=r"none\.toml: no such file; give the path of an arm's"):
        load_arm(tmp_path / "none.toml")
    with pytest.raises(ArmError, match=r"has its own in my_robot\.toml"):
        load_arm(arm_file(tmp_path), "l7")


def test_meshes_are_found_in_package_folders_and_a_lost_one_is_named(tmp_path: Path) -> None:
    from rcmqp.world.geometry import geometry_of

    mesh = '<visual><geometry><mesh filename="package://my_arm/{}.stl"/></geometry></visual>'
    box = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
    path = arm_file(tmp_path, 'packages = ["elsewhere/my_arm"]')
    text = urdf()
    for i, shape in ((2, box), (3, mesh.format("there")), (4, mesh.format("lost"))):
        text = text.replace(f'<link name="l{i}"/>', f'<link name="l{i}">{shape}</link>')
    (tmp_path / "r.urdf").write_text(text)
    (tmp_path / "elsewhere/my_arm").mkdir(parents=True)
    corners = "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0"
    (tmp_path / "elsewhere/my_arm/there.stl").write_text(
        f"solid\nfacet normal 0 0 1\nouter loop\n{corners}\nendloop\nendfacet\nendsolid\n"
    )
    found = geometry_of(load_arm(path), pin.GeometryType.VISUAL)
    assert found is not None
    assert found.missing == ("package://my_arm/lost.stl",)
    assert len(found.shapes.geometryObjects) == 2


def test_the_command_line_shows_what_was_loaded_and_assumed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = arm_file(
        tmp_path, "acceleration = 8.0", '[sources]\nacceleration = "its manual, p. 12"'
    )
    (tmp_path / "r.urdf").write_text(
        urdf().replace("</robot>", link(8, "x").replace("j8", "finger") + "</robot>")
    )
    with pytest.raises(SystemExit) as done:
        main(["arms", str(path)])
    assert not done.value.code
    shown = capsys.readouterr().out
    for words in (
        "Assumed, as no source gives it: jerk",
        "held at zero, as they do not move the flange: finger",
        "home is not given",
        "source of acceleration: its manual, p. 12",
    ):
        assert words in shown
    with pytest.raises(SystemExit):
        main(["run", "circle", "--arm", str(path), "--duration", "0.05", "--json"])
    assert json.loads(capsys.readouterr().out)["arm"] == path.name
