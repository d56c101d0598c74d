"""A wrist out of a URDF: of the instrument alone, or of the robot that carries it."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose
from wristed import NEEDLE_DRIVER, PITCH_TO_YAW, SHAFT, YAW_TO_TIP

from rcmqp import load_arm, make_controller, simulate
from rcmqp.errors import OptionError, RcmqpError
from rcmqp.runs.loading import load_scenario
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument_file import load_instrument

LINKS = ("instrument_base", "rolled", "clevis", "jaws", "tool_tip")
QUARTER = f"{math.pi / 2.0!r}"
JOINTS = f"""
<joint name="instrument_roll" type="revolute"><parent link="instrument_base"/>
  <child link="rolled"/><axis xyz="0 0 1"/>
  <limit lower="-4.53786" upper="4.53786" velocity="3" effort="1"/></joint>
<joint name="wrist_pitch" type="revolute"><parent link="rolled"/><child link="clevis"/>
  <origin xyz="0 0 {SHAFT}" rpy="0 0 {QUARTER}"/><axis xyz="1 0 0"/>
  <limit lower="-1.39626" upper="1.39626" velocity="3" effort="1"/></joint>
<joint name="wrist_yaw" type="revolute"><parent link="clevis"/><child link="jaws"/>
  <origin xyz="0 0 {PITCH_TO_YAW}"/><axis xyz="0 -1 0"/>
  <limit lower="-1.39626" upper="1.39626" velocity="3" effort="1" acceleration="40"/></joint>
<joint name="point" type="fixed"><parent link="jaws"/><child link="tool_tip"/>
  <origin xyz="0 0 {YAW_TO_TIP}" rpy="0.3 0 0"/></joint>
"""
"""The needle driver as a URDF may have it: the roll at the mount, links with their own axes."""

TOML = '[wrist]\nurdf = "{}"\nshaft = "instrument_base"\ntip = "tool_tip"\n'


def instrument_file(folder: Path, joints: str = JOINTS) -> Path:
    links = "".join(f'<link name="{link}"/>' for link in LINKS)
    (folder / "tool.urdf").write_text(f'<robot name="tool">{links}{joints}</robot>')
    (folder / "tool.toml").write_text("radius = 0.004\n" + TOML.format("tool.urdf"))
    return folder / "tool.toml"


def robot_file(folder: Path) -> Path:
    """A UR10 whose URDF goes on to the tip of the needle driver."""
    source = load_arm("ur10").source
    assert source is not None
    root = ET.fromstring(source.text)
    root.extend(ET.fromstring(f"<r>{''.join(f'<link name={link!r}/>' for link in LINKS)}</r>"))
    root.extend(ET.fromstring(f"<r>{JOINTS}</r>"))
    mount = (
        "<joint name='m' type='fixed'><parent link='{}'/><child link='instrument_base'/></joint>"
    )
    root.append(ET.fromstring(mount.format(load_arm("ur10").flange)))
    (folder / "robot.urdf").write_bytes(ET.tostring(root))
    (folder / "robot.toml").write_text("radius = 0.004\n" + TOML.format("robot.urdf"))
    return folder / "robot.toml"


def test_the_wrist_of_a_urdf_is_the_one_that_is_written_out(tmp_path: Path) -> None:
    found = load_instrument(instrument_file(tmp_path))
    assert found.wrist is not None
    assert NEEDLE_DRIVER.wrist is not None
    assert found.length == pytest.approx(NEEDLE_DRIVER.length, abs=1e-15)
    assert found.radius == NEEDLE_DRIVER.radius
    assert found.wrist.tool == pytest.approx(NEEDLE_DRIVER.wrist.tool, abs=1e-15)
    for ours, written in zip(found.wrist.joints, NEEDLE_DRIVER.wrist.joints, strict=True):
        assert (ours.name, ours.position) == (written.name, written.position)
        assert_allclose(ours.axis, written.axis, rtol=0, atol=1e-15)
        assert_allclose(ours.along, written.along, rtol=0, atol=1e-15)
    assert [joint.acceleration for joint in found.wrist.joints] == [None, None, 40.0]


def test_a_robot_and_the_wrist_in_its_urdf_keep_trocar_and_tip(tmp_path: Path) -> None:
    """The tool's point is where Pinocchio has the tip's link of the robot's whole URDF."""
    tool = load_instrument(robot_file(tmp_path))
    arm = load_arm(tmp_path / "robot.urdf", "instrument_base", home=load_arm("ur10").home)
    insertion = Insertion.on_shaft(arm, tool)
    model = pin.buildModelFromUrdf(str(tmp_path / "robot.urdf"))
    data = model.createData()
    assert list(insertion.arm.joints) == list(model.names)[1:]
    rng = np.random.default_rng(7)
    for _ in range(3):
        q = insertion.q_start + rng.uniform(-0.5, 0.5, model.nq)
        pin.framesForwardKinematics(model, data, q)
        tip = data.oMf[model.getFrameId("tool_tip")].translation
        assert_allclose(insertion.state(q).tool.oMt.translation, tip, rtol=0, atol=1e-12)
    helix = load_scenario("helix", "ur10", instrument=tool, duration=0.5)
    run = simulate(helix, make_controller("hierarchical_qp", helix.insertion(), helix.period))
    assert run.rcm_error.max() < 1e-6
    assert run.tip_error.max() < 1e-5


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            f"0 0 {PITCH_TO_YAW}",
            "0.002 0 0.0091",
            "wrist_yaw is 2.00 mm off the z axis of instrument_",
        ),
        ('wrist_yaw" type="revolute"', 'wrist_yaw" type="prismatic"', "wrist_yaw slides"),
        ('wrist_yaw" type="revolute"', 'wrist_yaw" type="continuous"', "wrist_yaw turns without"),
        (f"0 0 {PITCH_TO_YAW}", "0 0 -0.01", "do not follow each other along z"),
        (
            '<axis xyz="0 -1 0"/>',
            '<axis xyz="0 -1 0"/><mimic joint="wrist_pitch"/>',
            "follows anoth",
        ),
        (
            'lower="-1.39626" upper="1.39626" velocity="3" effort="1"/>',
            'lower="0.1" upper="1" velocity="3" effort="1"/>',
            "about zero",
        ),
    ],
)
def test_what_is_no_wrist_is_refused_in_words(
    old: str, new: str, said: str, tmp_path: Path
) -> None:
    assert JOINTS.count(old) == 1
    with pytest.raises(RcmqpError, match=said):
        load_instrument(instrument_file(tmp_path, JOINTS.replace(old, new)))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("tool_tip", "tip", "tip.*tool_tip"),
        ("tool_tip", "instrument_base", "no joint is between the links instrument_base and inst"),
        ('tip = "tool_tip"', "tool = 0.01", "has urdf, shaft, tip, each a text"),
        ("radius", "length = 0.4\nradius", "says how long the shaft is"),
        ("tool.urdf", "else.urdf", "no such file"),
    ],
)
def test_a_file_that_names_a_urdf_wrongly_is_refused_in_words(
    old: str, new: str, said: str, tmp_path: Path
) -> None:
    file = instrument_file(tmp_path)
    file.write_text(re.sub(re.escape(old), new, file.read_text()))
    with pytest.raises((RcmqpError, OptionError), match=said):
        load_instrument(file)


def test_a_urdf_of_one_joint_is_a_wrist_of_one_joint(tmp_path: Path) -> None:
    one = (
        '<joint name="wrist_pitch" type="revolute"><parent link="instrument_base"/>'
        '<child link="tool_tip"/><origin xyz="0 0 0.3"/><axis xyz="1 0 0"/>'
        '<limit lower="-1" upper="1" velocity="3" effort="1"/></joint>'
    )
    file = instrument_file(tmp_path, one)
    urdf = tmp_path / "tool.urdf"
    for link in LINKS[1:-1]:
        urdf.write_text(urdf.read_text().replace(f'<link name="{link}"/>', ""))
    found = load_instrument(file)
    assert found.wrist is not None
    assert found.length == pytest.approx(0.3, abs=1e-15)
    assert [(joint.name, joint.axis) for joint in found.wrist.joints] == [
        ("wrist_pitch", (1.0, 0.0, 0.0))
    ]


@pytest.mark.parametrize("value", ["[0.1]", "{z = 0.1}", "'far'", "1" + 400 * "0"])
def test_a_mount_offset_that_is_no_length_is_refused_beside_a_urdf(
    value: str, tmp_path: Path
) -> None:
    file = instrument_file(tmp_path)
    file.write_text(f"mount_offset = {value}\n{file.read_text()}")
    with pytest.raises(OptionError, match=r"tool\.toml: mount_offset"):
        load_instrument(file)
