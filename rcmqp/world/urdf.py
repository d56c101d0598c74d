"""What a URDF says: Pinocchio's model of it, and what Pinocchio leaves out."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path

import pinocchio as pin

from rcmqp.errors import ArmError


def model_of(path: Path) -> pin.Model:
    """Model of a URDF; what the parser would only print on the terminal, raised.

    Raises:
        ArmError: the file is no URDF, or a limit in it is no number that a limit can be.
    """
    try:
        root = ET.parse(path).getroot()
    except (ET.ParseError, LookupError, ValueError) as error:
        raise ArmError(f"{path} is not a URDF: {error}") from error
    if root.tag != "robot" or "name" not in root.attrib:
        raise ArmError(f'{path} is not a URDF: its root must be <robot name="...">')
    for joint in root.iterfind("joint"):
        if joint.get("type") in ("revolute", "prismatic") and joint.find("limit") is None:
            raise ArmError(f"{path}: joint {joint.get('name')!r} has no <limit>; add one")
        _check_limit(path, joint)
    try:
        return pin.buildModelFromUrdf(str(path))
    except (ValueError, RuntimeError) as error:
        raise ArmError(
            f"{path} is not a URDF that Pinocchio can read: {str(error).strip()}"
        ) from error


def mimics_of(path: Path) -> list[str]:
    """Names of the joints of a URDF that follow another joint."""
    return [joint.attrib["name"] for joint in _joints(path) if joint.find("mimic") is not None]


def limits_of(path: Path, joints: Sequence[str]) -> dict[str, dict[str, float]]:
    """Limits that URDF 1.2 has of some joints: ``limits["acceleration"]["elbow"]``, and "jerk".

    Of acceleration and deceleration it is the smaller one: ours hold in both directions.
    """
    limits: dict[str, dict[str, float]] = {"acceleration": {}, "jerk": {}}
    for joint in _joints(path):
        limit, name = joint.find("limit"), joint.attrib["name"]
        if limit is None or name not in joints:
            continue
        for key in ("acceleration", "deceleration", "jerk"):
            if key in limit.attrib:
                found = limits["jerk" if key == "jerk" else "acceleration"]
                found[name] = min(float(limit.attrib[key]), found.get(name, math.inf))
    return limits


def _joints(path: Path) -> Iterator[ET.Element]:
    return ET.parse(path).getroot().iterfind("joint")


def _check_limit(path: Path, joint: ET.Element) -> None:
    """Check the numbers in a joint's <limit>, where there are some."""
    limit = joint.find("limit")
    for key, text in () if limit is None else limit.attrib.items():
        if key not in ("lower", "upper", "velocity", "acceleration", "deceleration", "jerk"):
            continue
        positive = key in ("acceleration", "deceleration", "jerk")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or (positive and value <= 0.0):
            kind = "positive, finite number" if positive else "finite number"
            raise ArmError(
                f"{path}: joint {joint.get('name')!r} has {key} limit {text!r}; it must be a "
                f"{kind}: mend <limit {key}=...>, or take it out"
            )
