"""Checks of a URDF before a parser in C++ reads it: bounded, a tree, with numbers."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from xml.parsers import expat

from rcmqp.errors import ArmError

MOST_DEPTH = 100
"""Elements inside each other in a URDF."""

MOST_LINKS = 2000
"""Links of a URDF: with more, its parser overflows the stack or takes minutes."""

COUNTED = {"link": "links", "joint": "joints", "body": "bodies"}
"""Elements of which there may be MOST_LINKS, and what several of them are called."""

MOST_LENGTH = 1000.0
"""Of an <origin> [m]."""

MOVING = ("revolute", "continuous", "prismatic")
JOINT_TYPES = (*MOVING, "fixed", "floating", "planar")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_POSITIVE = ("acceleration", "deceleration", "jerk")
_NOT_NEGATIVE = ("velocity", "effort")


def check_xml(text: bytes, name: str) -> None:
    """Refuse what makes a parser run away: entities, elements nested very deep, too many links.

    Links and joints of a URDF, and bodies of an MJCF, are counted while the XML is read.

    Raises:
        ArmError: the bytes are no XML, or such XML.
    """
    parser = expat.ParserCreate()
    depth = 0
    counts = dict.fromkeys(COUNTED, 0)

    def entity(entity_name: str, *_: object) -> None:
        raise ArmError(f"{name} defines the XML entity {entity_name!r}, a URDF needs none; remove")

    def start(tag: str, _: object) -> None:
        nonlocal depth
        depth += 1
        if tag in COUNTED and (depth == 2 or tag == "body"):
            counts[tag] += 1
            if counts[tag] > MOST_LINKS:
                raise ArmError(
                    f"{name} has more than {MOST_LINKS} {COUNTED[tag]}, at most so many are read; "
                    "take out what does not move the flange"
                )
        if depth > MOST_DEPTH:
            raise ArmError(f"{name} has more than {MOST_DEPTH} XML elements inside each other")

    def end(_: object) -> None:
        nonlocal depth
        depth -= 1

    parser.EntityDeclHandler, parser.StartElementHandler = entity, start
    parser.EndElementHandler = end
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise ArmError(f"{name} is not a URDF: {error}") from error


def check_tree(root: ET.Element, name: str) -> None:
    """Check that links and joints are a tree, by names that are there and used once.

    Raises:
        ArmError: they are not; the message names a joint or link.
    """
    links = [link.get("name", "") for link in root.iterfind("link")]
    joints = list(root.iterfind("joint"))
    for what, names in (("link", links), ("joint", [j.get("name", "") for j in joints])):
        if twice := _twice(names):
            raise ArmError(f"{name}: two {what}s are called {twice!r}; rename one")
        if "" in names:
            raise ArmError(f"{name}: a {what} has no name; give it one")
    if not links:
        raise ArmError(f"{name} has no <link>, so it is no URDF of an arm")
    known = frozenset(links)
    parents: dict[str, str] = {}
    for joint in joints:
        joint_name, kind = joint.get("name"), joint.get("type")
        if kind not in JOINT_TYPES:
            raise ArmError(
                f"{name}: joint {joint_name!r} has type {kind!r}, it must be one of "
                f"{', '.join(JOINT_TYPES)}"
            )
        parent, child = (_link(joint, end, known, name) for end in ("parent", "child"))
        if parent == child:
            raise ArmError(f"{name}: joint {joint_name!r} goes from link {parent!r} to itself")
        if child in parents:
            raise ArmError(
                f"{name}: link {child!r} is the child of two joints, the second is "
                f"{joint_name!r}; a URDF must be a tree"
            )
        parents[child] = parent
    roots = [link for link in links if link not in parents]
    if not roots:
        raise ArmError(f"{name}: every link is the child of a joint, so they form a ring")
    if len(roots) > 1:
        raise ArmError(
            f"{name}: the links {', '.join(map(repr, roots[:4]))} hang on no joint, one of them "
            "must be the base and the others joined to it"
        )
    _check_no_ring(parents, name)


def check_numbers(root: ET.Element, name: str) -> None:
    """Check every number of a joint that the kinematics depends on.

    Raises:
        ArmError: one is missing or impossible; the message names joint, attribute and remedy.
    """
    for joint in root.iterfind("joint"):
        where = f"{name}: joint {joint.get('name')!r}"
        kind = joint.get("type")
        for tag, key in (("origin", "xyz"), ("origin", "rpy"), ("axis", "xyz")):
            if (element := joint.find(tag)) is not None and key in element.attrib:
                _check_vector(element.attrib[key], f"<{tag} {key}=...>", where)
        axis = joint.find("axis")
        if kind in MOVING and axis is not None and "xyz" in axis.attrib:
            length = math.hypot(*map(float, axis.attrib["xyz"].split()))
            if length < 1e-6:
                raise ArmError(
                    f"{where} moves, and its axis {axis.attrib['xyz']!r} has no direction; give "
                    'it one, such as <axis xyz="0 0 1"/>'
                )
        limit = joint.find("limit")
        if limit is None and kind in ("revolute", "prismatic"):
            raise ArmError(f"{where} has no <limit>; add one")
        if limit is not None:
            _check_limit(limit, kind, where)
        for tag, keys in (
            ("mimic", ("multiplier", "offset")),
            ("safety_controller", ("soft_lower_limit", "soft_upper_limit")),
        ):
            if (element := joint.find(tag)) is not None:
                for key in keys:
                    if key in element.attrib:
                        _check_number(element.attrib[key], f"<{tag} {key}=...>", where)


def _twice(names: list[str]) -> str | None:
    """The first name that comes again."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def _link(joint: ET.Element, end: str, links: frozenset[str], name: str) -> str:
    element = joint.find(end)
    link = None if element is None else element.get("link")
    if link is None:
        raise ArmError(f"{name}: joint {joint.get('name')!r} has no <{end} link=...>; add it")
    if link not in links:
        raise ArmError(
            f"{name}: the {end} of joint {joint.get('name')!r} is link {link!r}, which is not "
            "there; add the link or mend its name"
        )
    return link


def _check_no_ring(parents: dict[str, str], name: str) -> None:
    good: set[str] = set()
    for link in parents:
        path = []
        while link in parents and link not in good:
            if link in path:
                raise ArmError(f"{name}: the joints at link {link!r} form a ring; open it")
            path.append(link)
            link = parents[link]
        good.update(path)


def _check_vector(text: str, what: str, where: str) -> None:
    parts = text.split()
    if len(parts) != 3 or not all(_NUMBER.fullmatch(part) for part in parts):
        hint = _hint(text)
        raise ArmError(f"{where} has {text!r:.60} in {what}; it must be three numbers{hint}")
    if max(abs(float(part)) for part in parts) > MOST_LENGTH:
        raise ArmError(f"{where} has {text!r:.60} in {what}, beyond {MOST_LENGTH:g} m or rad")


def _check_number(text: str, what: str, where: str) -> None:
    if not _NUMBER.fullmatch(text.strip()) or not math.isfinite(float(text)):
        raise ArmError(f"{where} has {text!r:.60} in {what}; it must be a number{_hint(text)}")


def _hint(text: str) -> str:
    if "${" in text or "$(" in text:
        return " (this is xacro: run xacro on the file first)"
    return " (decimals with a point, not a comma)" if "," in text else ""


def _check_limit(limit: ET.Element, kind: str | None, where: str) -> None:
    for key in ("effort", "velocity"):
        if key not in limit.attrib and kind in MOVING:
            raise ArmError(f"{where} has no {key} limit; give one: <limit {key}=...>")
    for key in ("lower", "upper", *_NOT_NEGATIVE, *_POSITIVE):
        text = limit.get(key)
        if text is None:
            continue
        value = float(text) if _NUMBER.fullmatch(text.strip()) else math.nan
        if key in _POSITIVE:
            good, wanted = 0.0 < value < math.inf, "positive, finite number"
        elif key in _NOT_NEGATIVE:
            good, wanted = 0.0 <= value < math.inf, "finite number, 0 or more"
        else:
            good, wanted = math.isfinite(value), "finite number"
        if not good:
            raise ArmError(
                f"{where} has {key} limit {text!r}; it must be a {wanted}: mend <limit "
                f"{key}=...>, or take it out{_hint(text)}"
            )
