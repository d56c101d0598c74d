from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, robot_toml

from rcmqp import Arm, arm_names, load_arm
from rcmqp.errors import (
    ArmError,
    ArmWarning,
    FrameNotFound,
    JointLimitViolated,
    OptionError,
    RcmqpError,
    UnknownName,
)

LIMIT = '<limit lower="-2" upper="1.5" effort="1" velocity="1"/>'


def joint(name: str, parent: str, child: str, axis: str, kind: str = "revolute") -> str:
    limit = "" if kind in ("fixed", "floating", "planar") else LIMIT
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="0.1 0 0.3"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def robot(*joints: str) -> str:
    return f'<robot name="small"><link name="base"/>{"".join(joints)}</robot>'


SHOULDER = joint("shoulder", "base", "upper_arm", "0 0 1")
ELBOW = joint("elbow", "upper_arm", "forearm", "0 1 0")
WRIST = joint("wrist", "forearm", "hand", "1 0 0")
FINGER = joint("finger", "hand", "finger_tip", "0 1 0", "prismatic")
ARM = (SHOULDER, ELBOW, WRIST)


def write(folder: Path, text: str) -> Path:
    path = folder / "small.urdf"
    path.write_text(text, encoding="utf-8")
    return path


# The registry ------------------------------------------------------------------------------


def test_the_promised_arms_are_registered_with_all_their_joints_and_no_more() -> None:
    joints = {name: load_arm(name).nv for name in arm_names()}
    promised = {"lwa3": 7, "meka_a2": 7, "panda": 7, "xarm7": 7}
    promised |= {"ur5": 6, "ur10": 6, "kinova": 6, "z1": 6}
    assert joints | promised == joints


def test_every_joint_of_a_registered_arm_moves_the_flange(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    J_local = arm.state(arm.configuration(arm.random_angles(rng))).J_local
    assert (np.linalg.norm(J_local, axis=0) > 0.1).all()
    assert not [name for name in arm.joints if "finger" in name or "gripper" in name.lower()]
    assert (arm.velocity > 0).all()
    assert (arm.acceleration > 0).all()


def test_registered_home_is_far_from_limits_and_singularities(arm: Arm) -> None:
    assert arm.home.tolist() == robot_toml(arm.name)["home"]
    assert arm.limit_margin(arm.home).min() > np.radians(15)
    J_local = arm.state(arm.configuration(arm.home)).J_local
    assert np.linalg.svd(J_local, compute_uv=False)[-1] > 0.1
    with pytest.raises(ValueError, match="read-only"):
        arm.home[0] = 0.0


def test_registered_flange_points_outwards(arm: Arm) -> None:
    """Its z points away from the wrist and is square with the last joint's axis, or along it.

    The wrist is the last joint whose origin is not the flange's own.
    """
    rng = np.random.default_rng(7)
    q = arm.configuration(arm.random_angles(rng))
    flange, data = arm.state(q).oMe, arm.model.createData()
    pin.forwardKinematics(arm.model, data, q)
    outwards = [flange.translation - oMi.translation for oMi in list(data.oMi)[1:]]
    away = next(d for d in reversed(outwards) if np.linalg.norm(d) > 1e-6)
    z = flange.rotation[:, 2]
    assert z @ away > 0.7 * np.linalg.norm(away)
    along_axis = abs(arm.state(q).J_local[5, -1])
    assert min(along_axis, abs(along_axis - 1)) < 1e-6


def test_registered_arm_says_where_it_comes_from(arm: Arm) -> None:
    entry = robot_toml(arm.name)
    assert arm.name in arm_names()
    assert (arm.title, arm.licence) == (entry["title"], entry["licence"])
    assert arm.title != arm.name
    assert arm.licence.lower() not in ("", "unknown")
    assert entry["sources"]
    for topic, source in entry["sources"].items():
        assert isinstance(source, str), topic
        assert source.strip(), topic


def test_an_unknown_arm_is_answered_with_the_nearest_name() -> None:
    with pytest.raises(UnknownName, match=r"unknown arm 'lwa4'; did you mean lwa3\?") as caught:
        load_arm("lwa4")
    assert caught.value.known == arm_names()
    said = r"unknown arm 'qqq' \(known: .*panda.*\); or give the path of a URDF, with --flange F"
    with pytest.raises(UnknownName, match=said):
        load_arm("qqq")


@pytest.mark.parametrize("options", [{"flange": "flange"}, {"locked": {"lwa3_joint_1": 0.0}}])
def test_a_name_takes_no_options_of_a_urdf(options: dict[str, object]) -> None:
    with pytest.raises(ArmError, match=r"go with a URDF's path; lwa3 has its own in robot\.toml"):
        load_arm("lwa3", **options)  # type: ignore[arg-type]


# URDFs -------------------------------------------------------------------------------------


def test_a_urdf_by_path_is_the_arm_it_holds() -> None:
    rng = np.random.default_rng(7)
    named = load_arm("lwa3")
    assert named.urdf is not None
    by_path = load_arm(named.urdf, "flange", home=named.home)
    angles = named.random_angles(rng)
    assert by_path.state(angles).oMe == named.state(angles).oMe
    for array in ("home", "lower", "upper", "velocity"):
        assert np.array_equal(getattr(by_path, array), getattr(named, array))
    assert by_path.srs_offsets is None


def test_home_of_a_urdf_is_repeatable_inside_the_limits_and_not_singular(tmp_path: Path) -> None:
    lwa3 = load_arm("lwa3").urdf
    for path, flange in ((write(tmp_path, robot(*ARM)), "hand"), (str(lwa3), "flange")):
        arm, again = load_arm(path, flange), load_arm(path, flange)
        assert np.array_equal(arm.home, again.home)
        assert arm.limit_margin(arm.home).min() > 0.2
        assert not arm.home.flags.writeable
        J_local = arm.state(arm.configuration(arm.home)).J_local
        assert np.linalg.svd(J_local, compute_uv=False)[-1] > 0.05


def test_a_gripper_off_the_chain_is_held(tmp_path: Path) -> None:
    home = [0.0, 0.1, 0.2]
    with_finger = load_arm(write(tmp_path, robot(*ARM, FINGER)), "hand", home=home)
    assert with_finger.joints == ("shoulder", "elbow", "wrist")
    without = load_arm(write(tmp_path, robot(*ARM)), "hand", home=home)
    angles = [0.3, -0.5, 1.1]
    assert with_finger.state(angles).oMe == without.state(angles).oMe
    assert np.array_equal(with_finger.state(angles).J_local, without.state(angles).J_local)


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
@pytest.mark.parametrize("angle", [0.0, 0.7, -1.9])
def test_locked_joints_are_held_where_they_are_told(
    tmp_path: Path, angle: float, kind: str
) -> None:
    elbow = joint("elbow", "upper_arm", "forearm", "0 1 0", kind)
    path = write(tmp_path, robot(SHOULDER, elbow, WRIST))
    whole = load_arm(path, "hand", home=[0.0] * 3)
    locked = load_arm(path, "hand", home=[0.0] * 2, locked={"elbow": angle})
    assert locked.joints == ("shoulder", "wrist")
    expected = whole.state(whole.configuration([0.3, angle, 1.1]))
    state = locked.state([0.3, 1.1])
    assert_allclose(state.oMe.homogeneous, expected.oMe.homogeneous, rtol=0, atol=1e-15)
    assert_allclose(state.J_local, expected.J_local[:, [0, 2]], rtol=0, atol=1e-15)


def test_a_locked_joint_must_exist(tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match=r"unknown joint 'elbov'; did you mean elbow\?"):
        load_arm(write(tmp_path, robot(*ARM)), "hand", locked={"elbov": 0.0})


def test_home_of_a_urdf_must_fit(tmp_path: Path) -> None:
    path = write(tmp_path, robot(*ARM))
    assert load_arm(path, "hand", home=[0.1, 0.2, 0.3]).home.tolist() == [0.1, 0.2, 0.3]
    with pytest.raises(JointLimitViolated, match=r"elbow at 1\.6000 rad"):
        load_arm(path, "hand", home=[0.0, 1.6, 0.0])
    with pytest.raises(OptionError, match=r"home has shape \(2,\), the arm has 3 joints"):
        load_arm(path, "hand", home=[0.0, 0.0])


def test_a_urdf_needs_its_flange_named(tmp_path: Path) -> None:
    with pytest.raises(ArmError, match=r"say which frame .* upper_arm, forearm, hand\)"):
        load_arm(write(tmp_path, robot(*ARM)))


BASE_JOINT = joint("root", "base", "pelvis", "0 0 1", "floating")
HIP = joint("hip", "pelvis", "hand", "0 0 1")
NO_ARMS = {
    "no XML": ("not XML at all", r"small\.urdf is not a URDF: syntax error"),
    "cut off": ('<robot name="small"><link/>', r"small\.urdf is not a URDF: no element"),
    "no robot": ("<sdf/>", r'is not a URDF: its root must be <robot name="\.\.\.">'),
    "MJCF": ("<mujoco/>", "is not a URDF: it is MuJoCo's MJCF; give it with a name that ends in"),
    "no name": ("<robot><link/></robot>", r'its root must be <robot name="\.\.\.">'),
    "two roots": (robot(*ARM, '<link name="loose"/>'), "links 'base', 'loose' hang on no joint"),
    "no joints": (
        robot(joint("weld", "base", "hand", "0 0 1", "fixed")),
        "the URDF has no moving joints",
    ),
    "floating base": (
        robot(BASE_JOINT, HIP),
        "joint 'root' has 6 degrees of freedom .*only a fixed-base arm .*fix the base",
    ),
    "planar base": (
        robot(joint("cart", "base", "hand", "0 0 1", "planar")),
        "joint 'cart' has 3 degrees of freedom",
    ),
    "flange on the base": (
        robot(joint("weld", "base", "hand", "1 0 0", "fixed"), SHOULDER),
        "no joint moves the flange 'hand'; name a frame further out",
    ),
    "no limit": (
        robot(SHOULDER.replace(LIMIT, ""), ELBOW, WRIST),
        "joint 'shoulder' has no <limit>; add one",
    ),
    "velocity limit 0": (
        robot(SHOULDER, ELBOW.replace('velocity="1"', 'velocity="0"'), WRIST),
        "joint 'elbow' has velocity limit 0.0; give it a positive, finite one",
    ),
    "no velocity limit": (
        robot(SHOULDER, ELBOW.replace(' velocity="1"', ""), WRIST),
        "joint 'elbow' has no velocity limit; give one: <limit velocity=...>",
    ),
    "lower limit at upper": (
        robot(SHOULDER, ELBOW, WRIST.replace('upper="1.5"', 'upper="-2"')),
        "joint 'wrist' has lower limit -2.0 not below upper -2.0",
    ),
    "lower limit above upper": (
        robot(SHOULDER, ELBOW, WRIST.replace('lower="-2"', 'lower="3"')),
        "joint 'wrist' has lower limit 3.0 not below upper 1.5",
    ),
}


@pytest.mark.parametrize(("text", "message"), NO_ARMS.values(), ids=NO_ARMS.keys())
def test_a_urdf_that_holds_no_arm_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ArmError, match=message):
        load_arm(write(tmp_path, text), "hand")


def test_a_missing_frame_is_answered_with_the_nearest_names_or_the_last(tmp_path: Path) -> None:
    path = write(tmp_path, robot(*ARM))
    with pytest.raises(FrameNotFound, match=r"no frame 'forarm' .*did you mean forearm"):
        load_arm(path, "forarm")
    with pytest.raises(FrameNotFound, match=r"no frame 'qqq' .*the last ones are .*forearm"):
        load_arm(path, "qqq")


@pytest.mark.parametrize(
    ("name", "what"),
    [("none.urdf", "no such file"), ("folder/none", "no such file"), (".", "is a folder")],
)
def test_a_missing_file_is_said_to_be_missing(tmp_path: Path, name: str, what: str) -> None:
    with pytest.raises(ArmError, match=f"{what}; give the path of a URDF or of an arm's"):
        load_arm(tmp_path / name, "hand")


def test_errors_of_loading_are_of_one_family() -> None:
    for error in (ArmError, FrameNotFound, UnknownName, JointLimitViolated, OptionError):
        assert issubclass(error, RcmqpError)


def test_a_mimicking_joint_on_the_chain_is_refused_and_off_it_is_held(tmp_path: Path) -> None:
    urdf = load_arm("ur5").urdf
    assert urdf is not None
    text = urdf.read_text()
    i = text.index("</joint>", text.index('<joint name="wrist_3_joint"'))
    path = write(tmp_path, text[:i] + '<mimic joint="wrist_2_joint"/>' + text[i:])
    with pytest.raises(ArmError, match="'wrist_3_joint' mimics another one"):
        load_arm(path, "tool0")
    with pytest.warns(ArmWarning, match="its y axis points outwards"):
        assert load_arm(path, "wrist_2_link").nv == 5


@pytest.mark.parametrize("folder", ["", "robots/"])
def test_a_flange_behind_a_urdf_is_asked_for_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robots").mkdir()
    Path(f"{folder}mine.urdf").write_text("<robot/>")
    with pytest.raises(ArmError, match=rf"apart: --arm {folder}mine.urdf --flange tool0"):
        load_arm(f"{folder}mine.urdf:tool0")
