"""Parallelograms become one joint; other joints that follow one are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose
from test_urdf import link, urdf

from rcmqp import load_arm
from rcmqp.errors import ArmError


def bar(i: int, factor: float | None, axis: str = "0 1 0", offset: str = "0.1 0.03 0.2") -> str:
    """Link b{i} of a parallelogram on the one before; without a factor, the joint that leads."""
    mimic = "" if factor is None else f'<mimic joint="p1" multiplier="{factor}"/>'
    parent = "l1" if i == 1 else f"b{i - 1}"
    return (
        f'<link name="b{i}"/><joint name="p{i}" type="revolute"><origin xyz="{offset}" '
        f'rpy="0 {0.3 * i} 0"/><parent link="{parent}"/><child link="b{i}"/><axis xyz="{axis}"/>'
        f'<limit lower="-0.9" upper="0.8" velocity="1.5" effort="50"/>{mimic}</joint>'
    )


def text(*bars: str) -> str:
    """A turn about z, the bars, and a wrist of five joints on the last of them."""
    whole = urdf("zzyxyzx")
    wrist = whole.split('<link name="l2"/>')[1].replace('"l1"', f'"b{len(bars)}"')
    return whole.split('<link name="l2"/>')[0] + "".join(bars) + '<link name="l2"/>' + wrist


# Joints and the factors by which they turn; the axis of a joint may also point the other way.
PARALLELOGRAMS = {
    "three": ([None, -1.0, 1.0], None),
    "five": ([None, -1.0, 1.0, -1.0, 1.0], None),
    "axis turned": ([None, 1.0, 1.0], 2),
}


def bars_of(factors: list[float | None], turned: int | None) -> list[str]:
    return [
        bar(i, factor, "0 -2 0" if i == turned else "0 1 0") for i, factor in enumerate(factors, 1)
    ]


@pytest.mark.parametrize(("factors", "turned"), PARALLELOGRAMS.values(), ids=PARALLELOGRAMS)
def test_a_parallelogram_moves_the_flange_as_all_its_joints_do(
    tmp_path: Path, factors: list[float | None], turned: int | None
) -> None:
    """Beside Pinocchio's model of all joints, each given the angle that it follows."""
    path = tmp_path / "r.urdf"
    path.write_text(text(*bars_of(factors, turned)))
    arm = load_arm(path, "l7", home=[0.0] * 8)
    assert arm.joints == ("j1", "p1", "j2", "j3", "j4", "j5", "j6", "j7")
    assert (arm.lower[1], arm.upper[1], arm.velocity[1]) == (-0.9, 0.8, 1.5)
    model = pin.buildModelFromUrdf(str(path))
    data, rng = model.createData(), np.random.default_rng(7)
    for _ in range(10):
        angles = arm.random_angles(rng)
        q = pin.neutral(model)
        for joint, angle in zip(arm.joints, angles, strict=True):
            q[model.joints[model.getJointId(joint)].idx_q] = angle
        for i, factor in enumerate(factors, 1):
            at = model.joints[model.getJointId(f"p{i}")].idx_q
            q[at] = angles[1] * (1.0 if factor is None else factor)
        pin.framesForwardKinematics(model, data, q)
        expected = data.oMf[model.getFrameId("l7", pin.FrameType.BODY)]
        found = arm.state(angles).oMe
        assert_allclose(found.homogeneous, expected.homogeneous, rtol=0, atol=1e-12)


NONE = {
    "half as far": ([None, 0.5], "0 1 0"),
    "twice": ([None, 1.0], "0 1 0"),
    "not parallel": ([None, -1.0, 1.0], "0 1 0.2"),
}


@pytest.mark.parametrize(("factors", "axis"), NONE.values(), ids=NONE)
def test_what_is_no_parallelogram_is_refused_with_the_remedy(
    tmp_path: Path, factors: list[float | None], axis: str
) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(text(bar(1, None), *(bar(i, f, axis) for i, f in enumerate(factors[1:], 2))))
    with pytest.raises(ArmError, match=r"joint 'p2' mimics another .* hold it with locked"):
        load_arm(path, "l7")


def test_a_follower_that_is_locked_or_off_the_way_is_held(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(text(bar(1, None), bar(2, 0.5)))
    assert "p2" not in load_arm(path, "l7", locked={"p2": 0.0}, home=[0.0] * 8).joints
    finger = link(8, "x").replace("</joint>", '<mimic joint="j7"/></joint>')
    path.write_text(urdf().replace("</robot>", f"{finger}</robot>"))
    assert load_arm(path, "l7", home=[0.0] * 7).nv == 7


def test_the_followers_of_a_locked_joint_are_held_where_they_follow_it(tmp_path: Path) -> None:
    """A chain of followers, with an offset; beside a load with each of them locked by hand."""
    follower = bar(3, -1.0).replace('joint="p1"', 'joint="p2" offset="0.05"')
    path = tmp_path / "r.urdf"
    path.write_text(text(bar(1, None), bar(2, -1.0), follower))
    home = [0.1 * i for i in range(7)]
    arm = load_arm(path, "l7", locked={"p1": 0.4}, home=home)
    by_hand = load_arm(path, "l7", locked={"p1": 0.4, "p2": -0.4, "p3": 0.45}, home=home)
    assert arm.joints == tuple(f"j{i}" for i in range(1, 8))
    assert arm.source is not None
    assert "held, as they follow locked joints: p2, p3" in arm.source.notes
    found, expected = (each.state(each.configuration(home)).oMe for each in (arm, by_hand))
    assert_allclose(found.homogeneous, expected.homogeneous, rtol=0, atol=1e-12)
    middle = load_arm(path, "l7", locked={"p2": 0.2}, home=[0.0] * 8)
    assert middle.joints == ("j1", "p1", *by_hand.joints[1:])
    with pytest.raises(ArmError, match="p1 cannot be locked at 'high'; give a number"):
        load_arm(path, "l7", locked={"p1": "high"})  # type: ignore[dict-item]


def test_a_parallelogram_keeps_the_soft_limits_of_the_joint_that_leads(tmp_path: Path) -> None:
    soft = '<safety_controller soft_lower_limit="-0.5" soft_upper_limit="0.6" k_velocity="1"/>'
    path = tmp_path / "r.urdf"
    leading = bar(1, None).replace("</joint>", f"{soft}</joint>")
    path.write_text(text(leading, bar(2, -1.0), bar(3, 1.0)))
    arm = load_arm(path, "l7", home=[0.0] * 8)
    assert (arm.joints[1], arm.lower[1], arm.upper[1]) == ("p1", -0.5, 0.6)
