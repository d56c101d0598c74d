"""Where an arm's limits come from: the maker, the URDF, a number given, or an assumption."""

from __future__ import annotations

import dataclasses
import importlib.resources
import json
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose, robot_toml

from rcmqp import Arm, arm_names, load_arm, load_scenario, make_controller, simulate
from rcmqp.controllers.braking import braking
from rcmqp.errors import ArmError, OptionError, RcmqpError
from rcmqp.world.arm_limits import ArmLimits, SpeedNearLimits

ELBOW, WRIST = "elbow_joint", "wrist_1_joint"

FR3 = """
[speed_near_limits]
offset = [0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35]
deceleration = [6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0]
lower = [-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]
upper = [2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]
"""
"""An FR3's, as a table of robot.toml: libfranka 458b47e include/franka/rate_limiting.h."""

FR3_SPEED = np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])


def fr3_limits() -> SpeedNearLimits:
    return SpeedNearLimits(**tomllib.loads(FR3)["speed_near_limits"])


def urdf(folder: Path, *limits: str) -> Path:
    """An arm of three joints, a, b and c, with these attributes in their <limit>."""
    text = '<robot name="r" version="1.2"><link name="l0"/>'
    for i, limit in enumerate(limits):
        name, axis = "abc"[i], ("0 0 1", "0 1 0", "1 0 0")[i]
        text += (
            f'<link name="l{i + 1}"/><joint name="{name}" type="revolute"><parent link="l{i}"/>'
            f'<child link="l{i + 1}"/><origin xyz="0.1 0 0.3"/><axis xyz="{axis}"/>'
            f'<limit lower="-2" upper="1.5" effort="1" velocity="2" {limit}/></joint>'
        )
    path = folder / "small.urdf"
    path.write_text(text + "</robot>", encoding="utf-8")
    return path


# Where they come from ----------------------------------------------------------------------


def test_a_registered_arm_has_its_makers_limits_and_the_others_are_assumed(arm: Arm) -> None:
    entry = robot_toml(arm.name)
    acceleration = np.array(entry.get("acceleration", arm.velocity / 0.5))
    assert_allclose(arm.acceleration, acceleration, rtol=1e-15)
    assert_allclose(arm.jerk, entry.get("jerk", acceleration / 0.02), rtol=1e-15)
    assert arm.assumed == {"acceleration", "jerk"} - entry.keys()
    assert np.isfinite([arm.acceleration, arm.jerk]).all()
    about = " ".join(entry["sources"])  # what is assumed is said to be, what is known has a source
    assert "acceleration" in about
    assert "jerk" in about
    for name in arm.assumed:
        topic = next(topic for topic in entry["sources"] if name in topic)
        assert "assumed by load_arm()" in entry["sources"][topic]
    assert arm.limits_by_hand == ArmLimits()


def test_panda_and_xarm7_have_the_numbers_of_their_makers() -> None:
    panda, xarm7 = load_arm("panda"), load_arm("xarm7")
    assert panda.jerk.tolist() == [7500, 3750, 5000, 6250, 7500, 10000, 10000]
    assert_allclose(panda.jerk, 500.0 * panda.acceleration, rtol=1e-15)
    assert panda.speed_near_limits is None
    assert_allclose(np.degrees(xarm7.acceleration), 1145.0, rtol=1e-5)
    assert_allclose(np.degrees(xarm7.jerk), 28647.0, rtol=1e-5)
    assert not panda.assumed | xarm7.assumed


def test_a_urdf_with_limits_of_version_1_2_has_them(tmp_path: Path) -> None:
    path = urdf(
        tmp_path,
        'acceleration="8" deceleration="6" jerk="300"',
        'acceleration="4" deceleration="9" jerk="200"',
        'acceleration="5" jerk="100"',
    )
    arm = load_arm(path, "l3")
    assert arm.acceleration.tolist() == [6.0, 4.0, 5.0]
    assert arm.jerk.tolist() == [300.0, 200.0, 100.0]
    assert arm.assumed == frozenset()


def test_what_a_urdf_leaves_out_is_assumed_joint_by_joint(tmp_path: Path) -> None:
    arm = load_arm(urdf(tmp_path, 'deceleration="8"', "", 'jerk="7"'), "l3")
    assert arm.acceleration.tolist() == [8.0, 4.0, 4.0]
    assert_allclose(arm.jerk, [400.0, 200.0, 7.0], rtol=1e-15)
    assert arm.assumed == {"acceleration", "jerk"}


def test_limits_of_a_urdf_are_kept_in_a_run_and_in_a_stop(tmp_path: Path) -> None:
    lwa3 = load_arm("lwa3").urdf
    assert lwa3 is not None
    text = lwa3.read_text(encoding="utf-8").replace("<robot ", '<robot version="1.2" ')
    file = tmp_path / "lwa3.urdf"
    file.write_text(text.replace("velocity=", 'acceleration="1.5" deceleration="1.5" velocity='))
    scenario = load_scenario("fast_helix", str(file), flange="flange", duration=0.4)
    insertion = scenario.insertion()
    assert insertion.arm.acceleration.tolist() == [1.5] * 7
    run = simulate(scenario, make_controller("hierarchical_qp", insertion, scenario.period))
    steps = np.diff(run.v, axis=0, prepend=0.0 * run.v[:1])
    assert np.abs(steps).max() / scenario.period == pytest.approx(1.5, rel=1e-6)
    pivot = np.array(insertion.trocar.pivot)
    stop = list(braking(insertion, insertion.angles_start, np.full(7, 0.3), 1e-3, pivot))
    assert len(stop) >= 200  # 0.3 rad/s at 1.5 rad/s^2


@pytest.mark.parametrize("key", ["acceleration", "deceleration", "jerk"])
@pytest.mark.parametrize("value", ["0", "-1", "inf", "nan", "fast", ""])
def test_a_limit_of_a_urdf_that_is_no_limit_is_refused(
    tmp_path: Path, key: str, value: str
) -> None:
    path = urdf(tmp_path, "", f'{key}="{value}"', "")
    with pytest.raises(ArmError, match=f"joint 'b' has {key} limit '{value}'; it must be a posit"):
        load_arm(path, "l3")


@pytest.mark.parametrize("limit", ['lower="-2"', 'upper="1.5"', 'velocity="2"'])
@pytest.mark.parametrize("value", ["inf", "nan", "far"])
def test_a_position_or_speed_limit_of_a_urdf_is_a_finite_number(
    tmp_path: Path, limit: str, value: str
) -> None:
    key = limit.partition("=")[0]
    path = urdf(tmp_path, "", "", "")
    path.write_text(path.read_text().replace(limit, f'{key}="{value}"', 1))
    with pytest.raises(ArmError, match=f"joint 'a' has {key} limit '{value}'; it must be a finit"):
        load_arm(path, "l3")


def test_a_speed_limit_of_0_can_be_replaced_by_hand(tmp_path: Path) -> None:
    path = urdf(tmp_path, "", "", "")
    path.write_text(path.read_text().replace('velocity="2"', 'velocity="0"', 1))
    with pytest.raises(
        ArmError, match=r"joint 'a' has velocity limit 0\.0; give it a positive, f"
    ):
        load_arm(path, "l3")
    assert load_arm(path, "l3", velocity={"a": 1.0}).velocity.tolist() == [1.0, 2.0, 2.0]


# By hand -----------------------------------------------------------------------------------


def test_limits_are_given_as_a_number_a_sequence_or_by_joint() -> None:
    own = load_arm("ur5")
    every = load_arm("ur5", acceleration=8, jerk=400.0, velocity=1.5)
    assert every.acceleration.tolist() == [8.0] * 6
    assert every.jerk.tolist() == [400.0] * 6
    assert every.velocity.tolist() == [1.5] * 6
    each = load_arm("ur5", acceleration=np.arange(1.0, 7.0), jerk=[None, 5, None, None, 6, 7])
    assert each.acceleration.tolist() == [1, 2, 3, 4, 5, 6]
    assert_allclose(each.jerk, [50, 5, 150, 200, 6, 7], rtol=1e-15)
    named = load_arm("ur5", acceleration={ELBOW: 3.0}, position={WRIST: (-1.7, 1.0)})
    expected = own.acceleration.copy()
    expected[2] = 3.0
    assert np.array_equal(named.acceleration, expected)
    assert (named.lower[3], named.upper[3]) == (-1.7, 1.0)
    assert named.middle[3] == pytest.approx(-0.35)
    assert np.array_equal(np.delete(named.lower, 3), np.delete(own.lower, 3))


def test_what_is_given_is_not_assumed_and_what_follows_from_it_is() -> None:
    assert load_arm("ur5", acceleration=8.0).assumed == {"jerk"}
    assert load_arm("ur5", acceleration=8.0, jerk=100.0).assumed == frozenset()
    assert load_arm("ur5", acceleration={ELBOW: 8.0}, jerk=9.0).assumed == {"acceleration"}
    slow = load_arm("ur5", velocity=1.0)
    assert slow.acceleration.tolist() == [2.0] * 6
    assert slow.assumed == {"acceleration", "jerk"}
    panda = load_arm("panda", acceleration=2.0)
    assert panda.jerk[0] == 7500.0
    assert panda.assumed == frozenset()


def test_no_limit_has_to_be_asked_for(arm: Arm) -> None:
    free = load_arm(arm.name, acceleration=math.inf, jerk=math.inf)
    assert np.isposinf([free.acceleration, free.jerk]).all()
    assert free.assumed == frozenset()
    without = load_arm("ur5", acceleration=math.inf)  # jerk would follow from the acceleration
    assert np.isposinf(without.jerk).all()
    assert without.assumed == frozenset()


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (
            {"acceleration": 0.0},
            r"acceleration = 0 rad/s\^2, it must be positive; math\.inf is no",
        ),
        ({"jerk": -1.0}, r"jerk = -1 rad/s\^3, it must be positive"),
        ({"jerk": math.nan}, r"jerk = nan rad/s\^3, it must be positive"),
        ({"acceleration": [1, 2, 0, 4, 5, 6]}, r"acceleration of elbow_joint = 0 rad/s\^2, it m"),
        ({"acceleration": {ELBOW: -2}}, r"acceleration of elbow_joint = -2 rad/s\^2"),
        ({"acceleration": [1.0] * 5}, r"has shape \(5,\), the arm has 6 joints; give one number"),
        ({"jerk": {"elbow": 1.0}}, r"unknown joint 'elbow'; did you mean elbow_joint\?"),
        ({"velocity": math.inf}, r"velocity = inf rad/s, it must be finite"),
        ({"velocity": "fast"}, r"velocity = 'fast', it must be a number"),
        ({"velocity": "8"}, r"velocity = '8', it must be a number"),
        ({"jerk": True}, r"jerk = True, it must be a number"),
        ({"position": {WRIST: (1.0, 1.0)}}, r"position of wrist_1_joint = \(1\.0, 1\.0\), the fi"),
        ({"position": {WRIST: 1.0}}, r"position of wrist_1_joint = 1\.0, it must be a lower and"),
        ({"position": 3.0}, r"position = 3\.0, it must be a lower and an upper limit"),
        ({"position": (-1.0, 1.0)}, r"shoulder_lift_joint at -1\.6000 rad, allowed \[-1"),
        ({"speed_near_limits": fr3_limits()}, r"speed_near_limits is for 7 joints, the arm has 6"),
    ],
)
def test_limits_by_hand_that_cannot_be_are_refused(limits: dict[str, Any], message: str) -> None:
    with pytest.raises(RcmqpError, match=message):
        load_arm("ur5", **limits)


def test_position_limits_are_not_for_a_joint_that_turns_without_end() -> None:
    with pytest.raises(
        OptionError, match="position of j2s6s200_joint_1 is given, and the joint tu"
    ):
        load_arm("kinova", position={"j2s6s200_joint_1": (-1.0, 1.0)})


@pytest.mark.parametrize(
    "limits",
    [
        {},
        {"acceleration": 8.0},
        {"acceleration": {ELBOW: math.inf}, "jerk": [None, 1, None, 2, None, math.inf]},
        {"velocity": 1.0, "position": {WRIST: (-3.0, 3.0)}},
        {"position": (-3.0, 3.0), "jerk": 50},
    ],
)
def test_an_arm_knows_which_limits_were_set_by_hand(limits: dict[str, Any]) -> None:
    arm = load_arm("ur5", **limits)
    assert set(arm.limits_by_hand.given()) == set(limits)
    again = load_arm("ur5", **arm.limits_by_hand.given())
    for name in ("lower", "upper", "velocity", "acceleration", "jerk"):
        assert np.array_equal(getattr(again, name), getattr(arm, name))
    assert again.assumed == arm.assumed
    assert again.limits_by_hand == arm.limits_by_hand


def test_a_limit_that_is_set_later_is_by_hand_and_not_assumed() -> None:
    arm = load_arm("ur5")
    arm.acceleration = np.full(6, 8.0)
    assert arm.assumed == {"jerk"}
    again = load_arm("ur5", **arm.limits_by_hand.given())
    assert np.array_equal(again.acceleration, arm.acceleration)
    assert np.array_equal(again.jerk, arm.jerk)  # assumed of the acceleration that there was


def test_what_is_confirmed_is_not_assumed_and_the_arm_it_came_from_is_as_it_was() -> None:
    arm = load_arm("ur5")
    checked = arm.confirmed()
    assert checked.assumed == frozenset()
    assert arm.assumed == {"acceleration", "jerk"}
    assert np.array_equal(checked.acceleration, arm.acceleration)
    assert load_arm("ur5", **checked.limits_by_hand.given()).assumed == frozenset()


@pytest.mark.parametrize("name", arm_names())
def test_only_an_arm_with_known_limits_may_be_driven(name: str) -> None:
    arm = load_arm(name)
    if arm.assumed:
        least = min(arm.assumed)
        with pytest.raises(OptionError, match=rf"the {least} limits of {name} are only assumed: "):
            arm.check_limits_known()
    load_arm(name, acceleration=1.0, jerk=20.0).check_limits_known()
    arm.confirmed().check_limits_known()
    with pytest.raises(OptionError, match=r"the jerk limits of .* are infinite: .* choose one"):
        load_arm(name, acceleration=1.0, jerk=math.inf).check_limits_known()


# Near the position limits ------------------------------------------------------------------


def test_speeds_near_the_limits_of_an_fr3_are_those_of_libfranka() -> None:
    """The formula as libfranka writes it, joint by joint, without its tolerance of 0.001 rad/s."""
    rng = np.random.default_rng(7)
    arm = load_arm("panda", velocity=FR3_SPEED, speed_near_limits=fr3_limits())
    c = [12.0, 5.17, 7.00, 8.00, 34.0, 11.0, 34.0]
    near = fr3_limits()
    slowed = 0
    for q in rng.uniform(np.array(near.lower) - 0.1, np.array(near.upper) + 0.1, (300, 7)):
        lower, upper = near.bounds(q)
        for i, angle in enumerate(q):
            up = max(0.0, -near.offset[i] + math.sqrt(max(0.0, c[i] * (near.upper[i] - angle))))
            down = min(0.0, near.offset[i] - math.sqrt(max(0.0, c[i] * (angle - near.lower[i]))))
            assert upper[i] == pytest.approx(up, rel=1e-12)
            assert lower[i] == pytest.approx(down, rel=1e-12)
            slowed += up < FR3_SPEED[i]
    assert slowed > 200
    assert arm.limits_by_hand.speed_near_limits == near


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"offset": [0.1] * 6},
            "have 6, 7, 7 and 7 numbers; give each of them one number a joint",
        ),
        ({"offset": [-0.1] * 7}, r"of joint 1: offset -0\.1 must be 0 or more"),
        ({"deceleration": [0.0] * 7}, r"deceleration 0\.0 positive"),
        ({"lower": [9.0] * 7}, r"lower 9\.0 below upper 2\.7501"),
        ({"upper": ["far"] * 7}, r"speed_near_limits\.upper = 'far', it must be a number"),
    ],
)
def test_speed_limits_near_the_ends_that_cannot_be_are_refused(
    change: dict[str, Any], message: str
) -> None:
    with pytest.raises(OptionError, match=message):
        dataclasses.replace(fr3_limits(), **change)


def test_robot_toml_can_have_speeds_near_the_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panda = importlib.resources.files("rcmqp.robots") / "panda" / "robot.toml"
    (tmp_path / "fr3").mkdir()
    (tmp_path / "fr3/robot.toml").write_text(panda.read_text(encoding="utf-8") + FR3)
    monkeypatch.setattr("rcmqp.world.loading._robots", lambda: tmp_path)
    arm = load_arm("fr3")
    assert arm.speed_near_limits == fr3_limits()
    assert arm.limits_by_hand == ArmLimits()


# As data -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "limits",
    [
        ArmLimits(),
        ArmLimits(acceleration=8, jerk=math.inf),
        ArmLimits(position=((-1, 1), None), velocity=(1, None), acceleration=(math.inf, 2)),
        ArmLimits(position=(-math.inf, 3.0), speed_near_limits=fr3_limits()),
    ],
)
def test_limits_as_data_are_the_same_limits(limits: ArmLimits) -> None:
    text = json.dumps(limits.to_data(), allow_nan=False)
    assert ArmLimits.from_data(json.loads(text)) == limits
