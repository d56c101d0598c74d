"""MuJoCo's format: the same kinematics as MuJoCo's own, limits as far as it has them."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose

from rcmqp import load_arm
from rcmqp.errors import ArmError, ArmWarning, OptionError
from rcmqp.world.arm_limits import SPEED, SPEED_TIME, STROKE_SPEED
from rcmqp.world.geometry import geometry_of

ARM = """
<mujoco model="bench">
  <compiler angle="degree" eulerseq="ZYX" meshdir="parts"/>
  <default>
    <joint axis="0 0 1" range="-150 150"/>
    <default class="slow">
      <joint axis="0 1 0" range="-110 120" actuatorfrcrange="-40 40"/>
    </default>
  </default>
  <asset>
    <mesh name="cover" file="cover.obj" scale="0.5 0.5 0.5"/>
    <mesh name="gone" file="gone.stl"/>
    <texture name="wood" type="2d" file="wood.png"/>
    <material name="oak" texture="wood"/>
    <hfield name="ground" file="ground.png" size="1 1 1 1"/>
  </asset>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <geom type="hfield" hfield="ground"/>
    <body name="cup" pos="0.4 0 0">
      <freejoint/>
      <geom name="cup" size="0.03" material="oak"/>
    </body>
    <body name="plinth" pos="0.1 -0.2 0.3" euler="20 -10 35">
      <geom type="box" size="0.1 0.1 0.05"/>
      <body name="column" pos="0 0 0.1">
        <joint name="rail" type="slide" axis="1 0 0" range="-0.4 0.4" ref="0.1"/>
        <joint name="turn" pos="0.02 0.03 0"/>
        <geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.3"/>
        <body name="arm" pos="0 0.05 0.3" quat="0.9 0.1 -0.3 0.2">
          <joint name="lift" class="slow" pos="0 0 -0.05" ref="30"/>
          <geom type="mesh" mesh="cover" group="2" contype="0" conaffinity="0"/>
          <geom name="hood" type="mesh" mesh="gone" material="oak"/>
          <body name="forearm" pos="0.3 0 0.05" axisangle="1 0 0 90">
            <joint name="bend" class="slow"/>
            <geom type="cylinder" size="0.04 0.1" group="3"/>
            <body pos="0.2 0 0" euler="0 90 0">
              <joint name="roll" limited="false"/>
              <geom type="sphere" size="0.04"/>
              <body name="wrist" pos="0 0 0.1">
                <joint name="pitch" class="slow" axis="1 1 0"/>
                <geom type="sphere" size="0.03"/>
                <body name="flange" pos="0 0 0.08" euler="45 0 0">
                  <site name="flange" pos="0.01 0 0.02" euler="0 30 0"/>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><pair geom1="cup" geom2="hood"/></contact>
  <keyframe><key name="home"/></keyframe>
  <actuator>
    <velocity joint="bend" kv="5" ctrlrange="-1.5 1.5" gear="0.5"/>
    <position joint="turn" kp="50" ctrlrange="-2 2" forcerange="-30 30"/>
  </actuator>
</mujoco>
"""
CORNERS = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"]
FACES = ["1 3 2", "1 2 4", "1 4 3", "2 3 4"]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    parts = tmp_path / "parts"
    parts.mkdir()
    lines = [*(f"v {each}" for each in CORNERS), *(f"f {each}" for each in FACES)]
    (parts / "cover.obj").write_text("\n".join(lines))
    path = tmp_path / "bench.xml"
    path.write_text(ARM)
    return path


LOST = r'<(mesh name="gone"|texture|material|hfield|geom name="hood"|geom type="hfield"|pair).*?/>'


def mujoco_of(path: Path) -> Any:
    """MuJoCo's own reading, without the files that are not there."""
    text = re.sub(LOST, "", path.read_text()).replace(' material="oak"', "")
    whole = path.with_name("whole.xml")
    whole.write_text(text)
    return mujoco.MjModel.from_xml_path(str(whole))


@pytest.mark.parametrize("frame", ["forearm", "flange", "flange (site)"])
def test_every_frame_is_where_mujoco_has_it(path: Path, frame: str) -> None:
    arm, model = load_arm(path, frame), mujoco_of(path)
    data, rng = mujoco.MjData(model), np.random.default_rng(7)
    for _ in range(20):
        angles = arm.random_angles(rng)
        for joint, angle in zip(arm.joints, angles, strict=True):
            data.joint(joint).qpos = angle
        mujoco.mj_forward(model, data)
        seen = data.site("flange") if "site" in frame else data.body(frame)
        found = arm.state(arm.configuration(angles)).oMe
        assert_allclose(found.translation, seen.xpos, rtol=0, atol=1e-14)
        assert_allclose(found.rotation, seen.xmat.reshape(3, 3), rtol=0, atol=1e-14)


def test_limits_are_those_of_the_file_and_others_are_said_to_be_assumed(path: Path) -> None:
    arm = load_arm(path, "flange")
    assert arm.joints == ("rail", "turn", "lift", "bend", "roll", "pitch")
    assert arm.joint_units[0] == "m"
    assert_allclose(arm.lower[:2], [-0.4, -np.radians(150)], rtol=0, atol=1e-15)
    assert_allclose(np.degrees([arm.lower[2], arm.upper[2]]), [-110, 120], rtol=0, atol=1e-12)
    assert (arm.lower[4], arm.upper[4]) == (-np.inf, np.inf)
    assert arm.velocity.tolist() == [STROKE_SPEED, SPEED, SPEED, 3.0, SPEED, SPEED]
    assert arm.is_assumed("velocity").tolist() == [True, True, True, False, True, True]
    assert arm.assumed == {"velocity", "acceleration", "jerk"}
    assert arm.model.effortLimit.tolist() == [0.0, 30.0, 40.0, 40.0, 0.0, 40.0]


def test_a_velocity_actuator_without_gear_says_no_speed(path: Path) -> None:
    path.write_text(ARM.replace('gear="0.5"', 'gear="0"'))
    arm = load_arm(path, "flange")
    assert arm.velocity[3] == SPEED
    assert arm.is_assumed("velocity")[3]


def test_no_real_arm_is_driven_at_an_assumed_speed(path: Path) -> None:
    arm = load_arm(path, "flange", acceleration=5.0, jerk=100.0)
    with pytest.raises(
        OptionError, match=r"the velocity limits of .* only assumed: 0\.1, 1, .*velocity=\.\.\.\)"
    ):
        arm.check_limits_known()
    known = load_arm(path, "flange", velocity=2.0, acceleration=5.0, jerk=100.0)
    known.check_limits_known()
    assert known.limits_by_hand.velocity == (2.0,) * 6
    assert arm.limits_by_hand.velocity is None
    assert arm.confirmed().limits_by_hand.velocity is not None


def test_a_speed_given_by_hand_is_what_the_acceleration_is_assumed_from(path: Path) -> None:
    arm = load_arm(path, "flange", velocity={"turn": 2.0})
    assert arm.acceleration[1] == 2.0 / SPEED_TIME
    assert not arm.is_assumed("velocity")[1]


def test_shapes_are_where_mujoco_has_them(path: Path) -> None:
    with pytest.warns(ArmWarning, match=r"bench\.xml is drawn without parts/gone\.stl: no such"):
        arm = load_arm(path, "flange")
    found = geometry_of(arm, pin.GeometryType.VISUAL)
    assert found is not None
    assert found.missing == ()
    model = mujoco_of(path)
    data = mujoco.MjData(model)
    data.qpos[7:] = 0.0
    mujoco.mj_forward(model, data)
    own = found.model.createData()
    pin.framesForwardKinematics(found.model, own, pin.neutral(found.model))
    mesh = next(
        each for each in found.shapes.geometryObjects if hasattr(each.geometry, "vertices")
    )
    place = own.oMi[mesh.parentJoint] * mesh.placement
    mine = np.array([place.act(each) for each in mesh.geometry.vertices()])
    geom = next(i for i in range(model.ngeom) if model.geom_dataid[i] >= 0)
    turn, at = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
    theirs = model.mesh_vert @ turn.T + at
    assert len(mine) == len(theirs) == 4
    for corner in theirs:  # MuJoCo keeps meshes in single precision
        assert np.linalg.norm(mine - corner, axis=1).min() < 1e-7
    balls = [
        each for each in found.shapes.geometryObjects if "Sphere" in type(each.geometry).__name__
    ]
    assert len(balls) == 5  # three spheres, and the ends of the capsule


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '"roll" limited="false"',
            '"roll" type="ball" range="0 90"',
            "'roll' is a ball joint; only",
        ),
        ('range="-0.4 0.4"', 'limited="false"', "'rail' slides without a range; give it one"),
        ('type="sphere" size="0.04"', 'type="spere"', "MuJoCo cannot read it: .*invalid keyword"),
    ],
)
def test_what_is_no_arm_is_refused(path: Path, old: str, new: str, message: str) -> None:
    path.write_text(ARM.replace(old, new))
    with pytest.raises(ArmError, match=message):
        load_arm(path, "flange")


def test_a_base_that_floats_is_refused_and_a_cup_that_lies_about_is_not(path: Path) -> None:
    assert load_arm(path, "flange").nv == 6
    with pytest.raises(ArmError, match=r"6 degrees of freedom .* fix the base"):
        load_arm(path, "cup")


def test_without_mujoco_a_sentence_says_how(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(
        ArmError, match=r"mujoco is not installed: pip install 'rcmqp\[mjcf\]'; or"
    ):
        load_arm(path, "flange")
