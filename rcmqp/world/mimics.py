"""Parallelograms on the way to the flange: joints that follow another one, put into one joint."""

from __future__ import annotations

import copy
import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rcmqp.errors import ArmError
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.urdf import Urdf, model_of

PARALLEL = 1e-6
"""How far the axes of a parallelogram may be from parallel."""

REMEDY = "hold it with locked, or take its <mimic> out of the URDF"


@dataclass(frozen=True, slots=True, eq=False)
class _Member:
    """A joint on the chain that turns with its master, by ``factor`` times the master's angle."""

    joint: ET.Element
    factor: float
    oMl: pin.SE3  # of its link, all joints at zero


def without_mimics(urdf: Urdf, link: str, locked: Sequence[str]) -> Urdf:
    """The URDF in which no joint between base and ``link`` follows another one.

    A parallelogram, as in the dVRK's PSM and ECM, is a chain of parallel joints that turn by +q
    and -q in turn. Behind it everything turns by q about one point: with s the sum of the factors
    so far, 0 or 1, and a the way from each joint to the next,

        p(q) = p_1 + sum_{s = 0} a + R(q) sum_{s = 1} a.

    So one joint through p_1 + sum_{s = 0} a takes the place of all, with the limits of the one
    that is followed. The shapes of the links between are left out: they move otherwise.

    Raises:
        ArmError: a joint on the way follows another one in some other manner.
    """
    root = copy.deepcopy(urdf.root)
    chain = [joint for joint in _chain(root, link) if joint.get("name") not in locked]
    followers = [joint for joint in chain if joint.find("mimic") is not None]
    if not followers:
        return urdf
    model = model_of(urdf)
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    for master in dict.fromkeys(_followed(root, joint)[0] for joint in followers):
        members = []
        for joint in chain:
            name, factor = _followed(root, joint)
            if name == master:
                child = joint.find("child")
                assert child is not None
                frame = model.getFrameId(child.attrib["link"], pin.FrameType.BODY)
                members.append(_Member(joint, factor, data.oMf[frame]))
        _check(members, chain, urdf)
        _replace(root, master, members)
    return Urdf(urdf.path, root, hashlib.sha256(ET.tostring(root)).hexdigest())


def held_followers(urdf: Urdf, link: str, locked: Mapping[str, float]) -> dict[str, float]:
    """Joints between base and ``link`` that follow a locked one, and their positions.

    Raises:
        ArmError: a joint follows another one that is not there.
    """
    held = {}
    for joint in _chain(urdf.root, link):
        name = joint.attrib["name"]
        position = None if name in locked else _position(urdf.root, joint, locked)
        if position is not None:
            held[name] = position
    return held


def _position(root: ET.Element, joint: ET.Element, locked: Mapping[str, float]) -> float | None:
    """Where a joint is if it is locked, or follows a locked one in the end; None if neither."""
    scale, shift, seen = 1.0, 0.0, set[str]()
    while (name := joint.attrib["name"]) not in locked:
        mimic = joint.find("mimic")
        if mimic is None or name in seen:
            return None
        seen.add(name)
        shift += scale * _offset(joint)
        scale *= float(mimic.get("multiplier", "1"))
        joint = _named(root, mimic.get("joint", ""))
    return scale * locked[name] + shift


def _check(members: list[_Member], chain: list[ET.Element], urdf: Urdf) -> None:
    """Refuse joints that are no parallelogram."""
    name = next(each.joint for each in members if each.joint.find("mimic") is not None).get("name")
    axes = [each.factor * _axis(each) for each in members]
    sums = np.cumsum([axis @ axes[-1] for axis in axes])
    indices = [chain.index(each.joint) for each in members]
    between = chain[indices[0] : indices[-1] + 1]
    own = [each.joint for each in members]
    good = (
        all(each.joint.get("type") in ("revolute", "continuous") for each in members)
        and all(abs(abs(float(axis @ axes[-1])) - 1.0) < PARALLEL for axis in axes)
        and bool(np.isclose(np.minimum(np.abs(sums), np.abs(sums - 1.0)), 0.0, atol=1e-6).all())
        and bool(np.isclose(sums[-1], 1.0))
        and all(joint.get("type") == "fixed" for joint in between if joint not in own)
        and not any(_offset(joint) for joint in own)
    )
    if not good:
        raise ArmError(
            f"{urdf.path}: joint {name!r} mimics another one, moves the flange, and is no part of "
            f"a parallelogram, which is all that can be put into one joint: {REMEDY}"
        )


def _replace(root: ET.Element, master: str, members: list[_Member]) -> None:
    """Put one joint in the place of a parallelogram's."""
    last, axes = members[-1], [each.factor * _axis(each) for each in members]
    points = [each.oMl.translation for each in members]
    centre, total = np.array(points[0]), 0.0
    for i in range(len(members) - 1):
        total += float(axes[i] @ axes[-1])
        if abs(total) < 0.5:
            centre += points[i + 1] - points[i]
    limits = [_named(root, master).find(tag) for tag in ("limit", "safety_controller")]
    own = [each.joint.attrib["name"] for each in members]
    name = master if master in own else own[0]
    parent, child = members[0].joint.find("parent"), last.joint.find("child")
    assert parent is not None
    assert child is not None
    before = members[0].oMl * _placement(members[0].joint).inverse()
    pivot = pin.SE3(last.oMl.rotation, centre)
    for each in members[:-1]:
        _fix(root, each.joint)
    root.remove(last.joint)
    middle = f"{name} (pivot)"
    ET.SubElement(root, "link", name=middle)
    kind = "revolute" if limits[0] is not None else "continuous"
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    _origin(joint, before.actInv(pivot))
    ET.SubElement(joint, "parent", link=parent.attrib["link"])
    ET.SubElement(joint, "child", link=middle)
    axis = last.oMl.rotation.T @ axes[-1]
    ET.SubElement(joint, "axis", xyz=" ".join(repr(float(x)) for x in axis))
    joint.extend(copy.deepcopy(limit) for limit in limits if limit is not None)
    rigid = ET.SubElement(root, "joint", name=f"{name} (rigid)", type="fixed")
    _origin(rigid, pivot.actInv(last.oMl))
    ET.SubElement(rigid, "parent", link=middle)
    ET.SubElement(rigid, "child", link=child.attrib["link"])


def _fix(root: ET.Element, joint: ET.Element) -> None:
    """Hold a joint of a parallelogram, without the shapes of its link."""
    joint.set("type", "fixed")
    joint.set("name", f"{joint.attrib['name']} (held)")
    for tag in ("mimic", "limit", "safety_controller", "axis"):
        for element in joint.findall(tag):
            joint.remove(element)
    child = joint.find("child")
    assert child is not None
    for link in root.iterfind("link"):
        if link.get("name") == child.get("link"):
            for shape in [*link.iterfind("visual"), *link.iterfind("collision")]:
                link.remove(shape)


def _chain(root: ET.Element, link: str) -> list[ET.Element]:
    """The joints from the base to a link."""
    above: dict[str, ET.Element] = {}
    for joint in root.iterfind("joint"):
        child = joint.find("child")
        assert child is not None
        above[child.attrib["link"]] = joint
    joints = []
    while link in above:
        joints.append(above[link])
        parent = above[link].find("parent")
        assert parent is not None
        link = parent.attrib["link"]
    return joints[::-1]


def _followed(root: ET.Element, joint: ET.Element) -> tuple[str, float]:
    """Name of the joint that one follows in the end, and the factor; itself and 1 if none."""
    factor, seen = 1.0, set[str]()
    while (mimic := joint.find("mimic")) is not None and joint.attrib["name"] not in seen:
        seen.add(joint.attrib["name"])
        factor *= float(mimic.get("multiplier", "1"))
        joint = _named(root, mimic.get("joint", ""))
    return joint.attrib["name"], factor


def _named(root: ET.Element, name: str) -> ET.Element:
    for joint in root.iterfind("joint"):
        if joint.get("name") == name:
            return joint
    raise ArmError(f"a joint mimics {name!r}, and there is no joint of that name; mend <mimic>")


def _offset(joint: ET.Element) -> float:
    mimic = joint.find("mimic")
    return 0.0 if mimic is None else float(mimic.get("offset", "0"))


def _axis(member: _Member) -> Array:
    """Unit vector (3,) of a joint's axis in the world, all joints at zero."""
    axis = member.joint.find("axis")
    text = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
    vector = np.array([float(x) for x in text.split()])
    found: Array = member.oMl.rotation @ vector / np.linalg.norm(vector)
    return found


def _placement(joint: ET.Element) -> pin.SE3:
    """Placement of a joint's link in its parent, the joint at zero."""
    origin = joint.find("origin")
    given = {} if origin is None else origin.attrib
    texts = [given.get(key, "0 0 0").split() for key in ("xyz", "rpy")]
    xyz, rpy = (np.array([float(x) for x in each]) for each in texts)
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _origin(joint: ET.Element, placement: pin.SE3) -> None:
    """Give a joint its <origin>."""
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    texts = (" ".join(repr(float(x)) for x in each) for each in (placement.translation, rpy))
    ET.SubElement(joint, "origin", dict(zip(("xyz", "rpy"), texts, strict=True)))
