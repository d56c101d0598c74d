"""Checks of an MJCF before MuJoCo reads it: its size, with includes and replicates."""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from pathlib import Path

from rcmqp.errors import ArmError
from rcmqp.world.urdf_checks import MOST_LINKS, check_xml

COUNTED = ("body", "joint", "freejoint", "site")
"""Elements of <worldbody> that become links."""


def check_size(path: Path) -> None:
    """Count what an MJCF is made of, with its included files, before MuJoCo multiplies it.

    Bodies, joints and sites count, and in a <replicate> or another element with a count whatever
    is repeated. A file that is not there is left for MuJoCo to say.

    Raises:
        ArmError: they are more than MOST_LINKS; or an included file is not XML that is read.
    """
    total, included = 0.0, {path.resolve()}
    rest = [(_root(path), path, 1.0, False)]
    while rest:
        element, file, times, in_world = rest.pop()
        times *= _count(element)
        in_world = in_world or element.tag == "worldbody"
        if in_world and (element.tag in COUNTED or times > 1.0):
            total += times
            check_count(total, path)
        if element.tag == "include":
            name = element.get("file", "")
            places = (folder / name for folder in (path.parent, file.parent))
            file = next((each for each in places if _there(each)), path).resolve()
            if file not in included:  # MuJoCo refuses to include a file twice
                included.add(file)
                rest.append((_root(file), file, times, in_world))
        rest += [(child, file, times, in_world) for child in element]


def check_count(total: float, path: Path) -> None:
    """Refuse more than MOST_LINKS bodies, joints and sites.

    Raises:
        ArmError: there are more.
    """
    if total > MOST_LINKS:
        raise ArmError(
            f"{path} has {total:.10g} or more bodies, joints, sites and replicated elements, at "
            f"most {MOST_LINKS} are read; take out what does not move the flange, or lower the "
            "count of its <replicate>"
        )


def _root(path: Path) -> ET.Element:
    raw = path.read_bytes()
    check_xml(raw, str(path))
    return ET.fromstring(raw)


def _there(path: Path) -> bool:
    """Whether a file is there and may be read; False where its name is too long, too."""
    try:
        return path.is_file() and os.access(path, os.R_OK)
    except OSError:
        return False


def _count(element: ET.Element) -> float:
    """How many times an element is there: the product of its counts, 1 without any."""
    try:
        return max(1.0, math.prod(map(float, element.get("count", "").split())))
    except ValueError:  # MuJoCo refuses it
        return 1.0
