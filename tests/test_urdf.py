"""URDFs as they come: odd encodings, packed, with mistakes, and made to break a parser."""

from __future__ import annotations

import gzip
import re
import sys
import types
import xml.etree.ElementTree as ET
from pathlib import Path
from xml.dom import minidom

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose

from rcmqp import Arm, load_arm
from rcmqp.errors import ArmError, ArmWarning

AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def link(i: int, axis: str, kind: str = "revolute", limit: str = "2.6") -> str:
    """Link i and the joint that it hangs on."""
    return (
        f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><origin xyz="0 0 0.2"/>'
        f'<parent link="l{i - 1}"/><child link="l{i}"/><axis xyz="{AXES[axis]}"/>'
        f'<limit lower="-{limit}" upper="{limit}" velocity="2" effort="50"/></joint>'
    )


def urdf(axes: str = "zyzyzyz", **options: str) -> str:
    links = (link(i, axis, **options) for i, axis in enumerate(axes, 1))
    return f'<robot name="r"><link name="l0"/>{"".join(links)}</robot>'


def write(folder: Path, text: str, name: str = "r.urdf") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def refusal(folder: Path, text: str, flange: str = "l7") -> str:
    with pytest.raises(ArmError) as caught:
        load_arm(write(folder, text), flange)
    return str(caught.value)


def placement(arm: Arm) -> np.ndarray:
    return np.asarray(arm.state(arm.configuration(np.full(arm.nv, 0.3))).oMe.homogeneous)


# What is read ------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["utf-8", "iso-8859-1", "utf-16", "windows-1252"])
def test_a_urdf_may_be_in_any_encoding_that_it_declares(tmp_path: Path, encoding: str) -> None:
    text = urdf().replace('name="r"', 'name="Rönne"').replace('"j3"', '"gelenk_ä"')
    path = tmp_path / "r.urdf"
    path.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>{text}'.encode(encoding))
    arm = load_arm(path, "l7")
    assert (arm.title, arm.joints[2]) == ("Rönne", "gelenk_ä")


def test_a_packed_urdf_is_the_arm_that_is_in_it(tmp_path: Path) -> None:
    plain = load_arm(write(tmp_path, urdf()), "l7", home=[0.3] * 7)
    packed = tmp_path / "r.urdf.gz"
    packed.write_bytes(gzip.compress(urdf().encode()))
    arm = load_arm(packed, "l7", home=[0.3] * 7)
    assert np.array_equal(placement(arm), placement(plain))
    assert arm.sha256 == plain.sha256
    packed.write_bytes(gzip.compress(urdf().encode())[:-30])
    with pytest.raises(ArmError, match=r"r\.urdf\.gz cannot be read: "):
        load_arm(packed, "l7")


def test_a_packed_urdf_that_unpacks_to_very_much_is_refused(tmp_path: Path) -> None:
    bomb = tmp_path / "r.urdf.gz"
    bomb.write_bytes(gzip.compress(b" " * 70_000_000, compresslevel=1))
    with pytest.raises(ArmError, match="unpacks to more than 64000000 bytes"):
        load_arm(bomb, "l7")


XACRO = '<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>'


def test_a_xacro_says_how_to_make_a_urdf_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    path = write(tmp_path, XACRO, "r.urdf.xacro")
    with pytest.raises(ArmError, match=r"pip install xacro; .*: xacro r\.urdf\.xacro > r\.urdf$"):
        load_arm(path, "l7")
    with pytest.raises(ArmError, match=r"is a xacro, not yet a URDF: end its name in \.xacro"):
        load_arm(write(tmp_path, XACRO), "l7")


def test_a_xacro_is_read_where_its_package_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a package of ours with xacro's one function, which answers for it."""
    xacro = types.ModuleType("xacro")
    answers = {"good.xacro": urdf(), "bad.xacro": None}

    def process_file(name: str) -> minidom.Document:
        text = answers[Path(name).name]
        if text is None:
            raise NameError("name 'length' is not defined")
        return minidom.parseString(text)

    xacro.process_file = process_file  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "xacro", xacro)
    arm = load_arm(write(tmp_path, XACRO, "good.xacro"), "l7", home=[0.3] * 7)
    plain = load_arm(write(tmp_path, urdf()), "l7", home=[0.3] * 7)
    assert np.array_equal(placement(arm), placement(plain))
    with pytest.raises(ArmError, match=r"bad\.xacro: xacro cannot .* 'length' is not defined"):
        load_arm(write(tmp_path, XACRO, "bad.xacro"), "l7")


def test_links_and_joints_may_share_names(tmp_path: Path) -> None:
    """Valid URDF: names need be unique among links and among joints only."""
    more = (
        '<link name="cam"/><joint name="cam" type="fixed"><parent link="l3"/><child link="cam"/>'
        '</joint><link name="lens"/><joint name="x" type="fixed"><parent link="cam"/>'
        '<child link="lens"/></joint>'
    )
    text = urdf().replace("</robot>", f"{more}</robot>").replace("j7", "l7").replace("j4", "l4")
    home = [0.3] * 7
    arm = load_arm(write(tmp_path, text), "l7", home=home)
    plain = load_arm(write(tmp_path, urdf()), "l7", home=home)
    assert arm.joints == ("j1", "j2", "j3", "l4", "j5", "j6", "l7")
    assert np.array_equal(placement(arm), placement(plain))
    locked = load_arm(write(tmp_path, text), "l7", locked={"l4": 0.3}, home=home[:6])
    assert_allclose(placement(locked), placement(plain), rtol=0, atol=1e-15)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("limit", ["1e16", "100000"])
def test_home_is_near_zero_where_limits_are_far_away(
    tmp_path: Path, kind: str, limit: str
) -> None:
    text = urdf().replace(link(2, "y"), link(2, "y", kind, limit))
    if limit == "100000" and kind == "prismatic":
        with pytest.warns(ArmWarning, match="'j2' slides by 200000 m; are these millimetres"):
            arm = load_arm(write(tmp_path, text), "l7")
    else:
        arm = load_arm(write(tmp_path, text), "l7")
    assert abs(arm.home[1]) <= 7.0
    assert np.isclose(arm.upper[1], float(limit))


@pytest.mark.parametrize(("lower", "upper"), [("-2.2", "2.1"), ("-3.0", "1.0"), ("-9", "9")])
def test_soft_limits_narrow_the_position_limits(tmp_path: Path, lower: str, upper: str) -> None:
    soft = f'<safety_controller soft_lower_limit="{lower}" soft_upper_limit="{upper}"'
    none = '<safety_controller k_velocity="10"/>'
    text = urdf().replace("</joint>", f'{soft} k_velocity="10"/></joint>', 1)
    arm = load_arm(write(tmp_path, text.replace("</joint>", f"{none}</joint>")), "l7")
    assert arm.lower[0] == max(-2.6, float(lower))
    assert arm.upper[0] == min(2.6, float(upper))
    assert (arm.lower[1:] == -2.6).all()
    assert arm.source is not None
    narrowed = any("soft ones" in note and "j1" in note for note in arm.source.notes)
    assert narrowed == (float(upper) < 9)


# What is asked about -----------------------------------------------------------------------


def test_degrees_for_radians_are_questioned(tmp_path: Path) -> None:
    degrees = urdf(limit="170")
    with pytest.warns(ArmWarning, match=r"'j1' turns from -170 to 170 .* are these degrees\?"):
        load_arm(write(tmp_path, degrees), "l7")
    fast = urdf().replace('velocity="2"', 'velocity="98"')
    with pytest.warns(ArmWarning, match=r"at 98 rad/s; are these degrees\?"):
        load_arm(write(tmp_path, fast), "l7")


def test_millimetres_for_metres_are_questioned(tmp_path: Path) -> None:
    text = urdf().replace("0 0 0.2", "0 0 200")
    with pytest.warns(ArmWarning, match=r"are 1.4e\+03 m long together; are these millimetres\?"):
        load_arm(write(tmp_path, text), "l7")


@pytest.mark.parametrize(
    "rpy", ["0 1.5707963 0", "0 -1.5707963 0", "1.5707963 0 0", "3.1415926 0 0"]
)
def test_a_flange_that_points_aside_is_questioned_and_the_remedy_is_right(
    tmp_path: Path, rpy: str
) -> None:
    tool = (
        '<link name="tool"/><joint name="t" type="fixed"><origin xyz="0 0 0.1" '
        f'rpy="{rpy}"/><parent link="l7"/><child link="tool"/></joint></robot>'
    )
    path = write(tmp_path, urdf().replace("</robot>", tool))
    with pytest.warns(ArmWarning, match="axis points outwards") as caught:
        load_arm(path, "tool", home=[0.3] * 7)
    found = re.search(r"give rpy = (\[.*?\])", str(caught[0].message))
    assert found is not None
    file = tmp_path / "arm.toml"
    file.write_text(
        f'urdf = "r.urdf"\nhome = {[0.3] * 7}\n[flange]\nframe = "tool"\nrpy = {found.group(1)}\n'
    )
    arm, straight = load_arm(file), load_arm(path, "l7", home=[0.3] * 7)
    z, z_straight = placement(arm)[:3, 2], placement(straight)[:3, 2]
    assert_allclose(z, z_straight, rtol=0, atol=1e-5)


# What is refused ---------------------------------------------------------------------------


MISTAKES = {
    "no speed": (' velocity="2"', "", "'j1' has no velocity limit; give one"),
    "no effort": (' effort="50"', "", "'j1' has no effort limit; give one"),
    "a comma": ('"0 0 0.2"', '"0 0 0,2"', r"'j1' has '0 0 0,2' in <origin xyz.*not a comma"),
    "two numbers": ('"0 0 0.2"', '"0 0.2"', r"'j1' has '0 0.2' in <origin .* three numbers"),
    "xacro left": ('"0 0 0.2"', '"0 0 ${d}"', r"'j1' has .*run xacro on the file first"),
    "endless down": ('"-2.6"', '"-inf"', "'j1' has lower limit '-inf'; it must be a finite"),
    "backwards": ('velocity="2"', 'velocity="-1"', "'j1' has velocity limit '-1'"),
    "not a number": ('upper="2.6"', 'upper="nan"', "'j1' has upper limit 'nan'"),
    "no axis": ('xyz="0 0 1"', 'xyz="0 0 0"', "'j1' moves, and its axis .* no direction"),
    "tiny axis": ('xyz="0 0 1"', 'xyz="0 0 1e-12"', "'j1' moves, and its axis"),
    "far away": ('"0 0 0.2"', '"0 0 1e300"', "'j1' has .* beyond 1000 m"),
    "no type": ('type="revolute"', 'type="spring"', "'j1' has type 'spring', it must be one"),
    "no parent": ('<parent link="l0"/>', "", r"'j1' has no <parent link=\.\.\.>; add it"),
    "lost link": ('<parent link="l0"/>', '<parent link="l9"/>', "link 'l9', which is not there"),
    "itself": ('<parent link="l0"/>', '<parent link="l1"/>', "'j1' goes from link 'l1' to itself"),
    "a ring": ('<parent link="l0"/>', '<parent link="l3"/>', "form a ring"),
    "two of a link": ('<link name="l3"/>', '<link name="l2"/>', "two links are called 'l2'"),
    "two of a joint": ('name="j3"', 'name="j2"', "two joints are called 'j2'"),
    "two parents": ('<child link="l3"/>', '<child link="l1"/>', "'l1' is the child of two joints"),
    "no name": ('<link name="l3"/>', "<link/>", "a link has no name"),
}


@pytest.mark.parametrize(("old", "new", "message"), MISTAKES.values(), ids=MISTAKES.keys())
def test_a_mistake_is_named_with_its_joint_and_nothing_is_only_printed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], old: str, new: str, message: str
) -> None:
    text = urdf()
    assert old in text
    said = refusal(tmp_path, text.replace(old, new, 1))
    assert re.search(message, said), said
    assert "r.urdf" in said
    assert capfd.readouterr() == ("", "")


def test_what_only_the_parser_knows_is_in_the_exception(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    calibration = '<calibration rising="soon"/></joint>'
    said = refusal(tmp_path, urdf().replace("</joint>", calibration, 1))
    assert re.search(r"Pinocchio can read: .*soon.*j1", said), said
    assert capfd.readouterr() == ("", "")


def star(n: int) -> str:
    arms = (link(i, "z").replace(f'"l{i - 1}"', '"l0"') for i in range(1, n + 1))
    return f'<robot name="r"><link name="l0"/>{"".join(arms)}</robot>'


LAUGHS = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
HOSTILE = {
    "nested entities": (
        lambda: f'<!DOCTYPE r [<!ENTITY e0 "ha">{LAUGHS}]><robot name="&e9;"/>',
        "defines the XML entity 'e0'",
    ),
    "nested elements": (lambda: "<a>" * 100_000 + "</a>" * 100_000, "more than 100 XML elements"),
    "NUL": (lambda: urdf().replace("l3", "l\0"), "is not a URDF: "),
    "empty": (lambda: "", "is not a URDF: no element found"),
    "no links": (lambda: '<robot name="r"/>', "has no <link>"),
}


@pytest.mark.parametrize(("text", "message"), HOSTILE.values(), ids=HOSTILE.keys())
def test_a_hostile_urdf_is_refused_before_a_parser_in_cpp_sees_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: object, message: str
) -> None:
    monkeypatch.setattr(pin, "buildModelFromXML", lambda _: pytest.fail("parsed"))
    assert callable(text)
    assert message in refusal(tmp_path, text())


MANY = {
    "a chain of 20,000": (lambda: urdf("z" * 20_000), "more than 2000 links, at most"),
    "a star of 100,000": (lambda: star(100_000), "more than 2000 links, at most"),
    "joints": (lambda: urdf().replace("</robot>", "<joint/>" * 2001), "more than 2000 joints"),
    "an MJCF": (lambda: f"<mujoco><worldbody>{'<body/>' * 2001}", "more than 2000 bodies"),
}


@pytest.mark.parametrize(("text", "message"), MANY.values(), ids=MANY.keys())
def test_too_many_links_are_refused_before_a_tree_is_made_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: object, message: str
) -> None:
    monkeypatch.setattr(ET, "fromstring", lambda _: pytest.fail("parsed"))
    assert callable(text)
    assert message in refusal(tmp_path, text())


def test_the_largest_urdf_that_is_taken_loads(tmp_path: Path) -> None:
    text = urdf("zyzyzyz").replace("</robot>", "")
    more = "".join(link(i, "z") for i in range(8, 1999))
    assert load_arm(write(tmp_path, f"{text}{more}</robot>"), "l7", home=[0.3] * 7).nv == 7
