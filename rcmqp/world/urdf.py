"""URDFs read from files: plain, packed, in any encoding, or made of a xacro; and their models."""

from __future__ import annotations

import gzip
import hashlib
import importlib
import math
import os
import sys
import tempfile
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pinocchio as pin

from rcmqp.errors import ArmError
from rcmqp.files import absent
from rcmqp.world.mjcf import urdf_from_mjcf
from rcmqp.world.urdf_checks import check_numbers, check_tree, check_xml

MOST_URDF = 64_000_000
"""Bytes of a URDF, unpacked."""

WORLD_LINK, MOUNT_JOINT, RAIL_JOINT = "rcmqp_world", "rcmqp_mount", "rail"
"""Names of what placed() puts below a URDF's base."""


@dataclass(frozen=True, slots=True, eq=False)
class Urdf:
    """A URDF that was read and checked.

    Attributes:
        path: the file that it came from.
        root: its XML.
        sha256: of the file's bytes, or, where the URDF was changed or made of a xacro or an MJCF,
            its text.
    """

    path: Path
    root: ET.Element
    sha256: str

    @property
    def text(self) -> str:
        """The URDF as text, without comments."""
        return ET.tostring(self.root, encoding="unicode")


def read_urdf(path: Path) -> Urdf:
    """Read a .urdf, a .urdf.gz, a .xacro with the package xacro, or an MJCF with mujoco.

    Raises:
        ArmError: the file is missing or too large, is not a URDF, or cannot be an arm; the message
            names what is wrong and what to do.
    """
    raw = _bytes(path)
    if path.suffix.lower() == ".xacro":
        check_xml(raw, str(path))
        raw = _from_xacro(path)
    elif path.suffix.lower() == ".xml" and b"<mujoco" in raw:
        check_xml(raw, str(path))
        raw = urdf_from_mjcf(path)
    return urdf_of(raw, path)


def urdf_of(raw: bytes, path: Path) -> Urdf:
    """The URDF in the bytes of a file.

    Raises:
        ArmError: as read_urdf() does; ``path`` stands in the message.
    """
    check_xml(raw, str(path))
    root = ET.fromstring(raw)
    if root.tag == "mujoco":
        raise ArmError(
            f"{path} is not a URDF: it is MuJoCo's MJCF; give it with a name that ends in .xml"
        )
    if root.tag != "robot" or "name" not in root.attrib:
        raise ArmError(f'{path} is not a URDF: its root must be <robot name="...">')
    if any("ros.org/wiki/xacro" in element.tag for element in root.iter()):
        raise ArmError(
            f"{path} is a xacro, not yet a URDF: end its name in .xacro, with the package xacro "
            f"installed (pip install xacro), or run xacro {path.name} > {path.stem}_flat.urdf"
        )
    check_tree(root, str(path))
    check_numbers(root, str(path))
    return Urdf(path, root, hashlib.sha256(raw).hexdigest())


def model_of(urdf: Urdf) -> pin.Model:
    """Pinocchio's model; what its parser would only print on the terminal, raised.

    Raises:
        ArmError: the parser refuses the URDF, with its reason.
    """
    try:
        with _captured() as said:
            model = pin.buildModelFromXML(urdf.text)
    except (ValueError, RuntimeError) as error:
        reason = " ".join(line for line in said if " at line " not in line).replace("Error:", "")
        raise ArmError(
            f"{urdf.path} is not a URDF that Pinocchio can read: "
            f"{' '.join(reason.split()) or str(error).strip()}"
        ) from error
    bodies = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    for frame in model.frames:  # links and joints may share names, Pinocchio's frames may not
        if frame.type != pin.FrameType.BODY and frame.name in bodies:
            frame.name = f"{frame.name} (joint)"
    return model


def limits_of(urdf: Urdf, joints: Sequence[str]) -> dict[str, dict[str, float]]:
    """Limits that URDF 1.2 has of some joints: ``limits["acceleration"]["elbow"]``, and "jerk".

    Of acceleration and deceleration it is the smaller one: ours hold in both directions.
    """
    limits: dict[str, dict[str, float]] = {"acceleration": {}, "jerk": {}}
    for joint in _joints(urdf):
        limit, name = joint.find("limit"), joint.attrib["name"]
        if limit is None or name not in joints:
            continue
        for key in ("acceleration", "deceleration", "jerk"):
            if key in limit.attrib:
                found = limits["jerk" if key == "jerk" else "acceleration"]
                found[name] = min(float(limit.attrib[key]), found.get(name, math.inf))
    return limits


def assumed_speeds(urdf: Urdf) -> list[str]:
    """Joints whose speed limit only stands for one that is not known, as in an MJCF."""
    limits = ((joint, joint.find("limit")) for joint in _joints(urdf))
    return [
        joint.attrib["name"]
        for joint, limit in limits
        if limit is not None and limit.get("assumed") == "velocity"
    ]


def equalities_of(urdf: Urdf) -> dict[str, str]:
    """Joints that an MJCF's <equality> ties, and the element that ties each of them."""
    marked = (joint for joint in _joints(urdf) if "equality" in joint.attrib)
    return {joint.attrib["name"]: joint.attrib["equality"] for joint in marked}


def soft_limits_of(urdf: Urdf, joint: str) -> tuple[float, float]:
    """Lower and upper soft limit of a joint's <safety_controller>; infinite where not given."""
    for element in _joints(urdf):
        soft = element.find("safety_controller")
        if soft is not None and element.attrib["name"] == joint:
            # without a number the URDF format takes 0 for it, and 0, 0 for no limits at all
            pair = [float(soft.get(f"soft_{end}_limit", "0")) for end in ("lower", "upper")]
            if pair[0] < pair[1]:
                return pair[0], pair[1]
    return -math.inf, math.inf


def _joints(urdf: Urdf) -> Iterator[ET.Element]:
    return urdf.root.iterfind("joint")


def _bytes(path: Path) -> bytes:
    """The bytes of a file, decompressed."""
    try:
        there, size = path.is_file(), path.stat().st_size if path.is_file() else 0
    except (OSError, ValueError):  # too long a name, or NUL in it
        there, size = False, 0
    if not there:
        raise ArmError(f"{path}: {absent(path)}; give the path of a URDF or of an arm's .toml")
    if size > MOST_URDF:
        raise ArmError(f"{path} has {size} bytes, a URDF {MOST_URDF} at most")
    try:
        if path.suffix.lower() != ".gz":
            return path.read_bytes()
        with gzip.open(path) as file:
            raw = file.read(MOST_URDF + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise ArmError(f"{path} cannot be read: {error}") from error
    if len(raw) > MOST_URDF:
        raise ArmError(f"{path} unpacks to more than {MOST_URDF} bytes, which a URDF may have")
    return raw


def _from_xacro(path: Path) -> bytes:
    """The URDF that a xacro makes."""
    try:
        xacro = importlib.import_module("xacro")
    except ModuleNotFoundError as error:
        raise ArmError(
            f"{path} is a xacro, and the package xacro is not installed: pip install xacro; or "
            f"make a URDF of it where it is: xacro {path.name} > {path.stem}"
            f"{'' if path.stem.endswith('.urdf') else '.urdf'}"
        ) from error
    try:
        made: bytes = xacro.process_file(str(path)).toxml(encoding="utf-8")
    except Exception as error:  # xacro lets a file's own expressions raise anything
        raise ArmError(
            f"{path}: xacro cannot make a URDF of it: {type(error).__name__}: {error}"
        ) from error
    return made


@contextmanager
def _captured() -> Iterator[list[str]]:
    """Keep what C++ prints on stderr meanwhile: a list of lines, filled at the end."""
    said: list[str] = []
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        kept = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            said += file.read().decode(errors="replace").splitlines()


def placed(urdf: Urdf, base: pin.SE3, rail: Mapping[str, str] | None) -> Urdf:
    """The URDF with its base at a placement in the world, on a rail if there is one.

    Args:
        urdf: of the arm.
        base: placement of the URDF's root link in the world, where the rail is at zero.
        rail: attributes ``axis``, ``lower``, ``upper`` and ``velocity`` of the rail, a prismatic
            joint; the axis in the base's frame.
    """
    children = {end.get("link") for joint in _joints(urdf) for end in joint.iterfind("child")}
    links = [link.attrib["name"] for link in urdf.root.iterfind("link")]
    base_link = next(link for link in links if link not in children)
    root = ET.Element("robot", urdf.root.attrib)
    ET.SubElement(root, "link", name=WORLD_LINK)
    name, kind = (RAIL_JOINT, "prismatic") if rail else (MOUNT_JOINT, "fixed")
    mount = ET.SubElement(root, "joint", name=name, type=kind)
    rpy = pin.rpy.matrixToRpy(base.rotation)
    ET.SubElement(mount, "origin", xyz=_numbers(base.translation), rpy=_numbers(rpy))
    ET.SubElement(mount, "parent", link=WORLD_LINK)
    ET.SubElement(mount, "child", link=base_link)
    if rail:
        ET.SubElement(mount, "axis", xyz=rail["axis"])
        limit = {key: rail[key] for key in ("lower", "upper", "velocity")}
        ET.SubElement(mount, "limit", limit | {"effort": "1000"})
    root.extend(urdf.root)
    check_tree(root, str(urdf.path))
    check_numbers(root, str(urdf.path))
    return Urdf(urdf.path, root, hashlib.sha256(ET.tostring(root)).hexdigest())


def _numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(x)) for x in values)
