"""Load every URDF of example-robot-data with six joints on the way to some link.

For each, the longest chain of the file is loaded, and its forward kinematics and position limits
are compared with an independent reading of the XML. Prints a table; exits with 1 where one is off.
With --helix, the paper's law and hierarchical_qp draw a conical helix at that link, or, where it
is refused, at the next link towards the base that is not: ten seconds an arm.

    python benchmarks/urdfs.py
    python benchmarks/urdfs.py --helix
"""

from __future__ import annotations

import argparse
import importlib.metadata
import math
import sys
import warnings
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rcmqp import Arm, compute_metrics, load_arm, load_scenario, make_controller, simulate
from rcmqp.errors import ArmError, RcmqpError

Array = NDArray[np.float64]
MOVING = ("revolute", "continuous", "prismatic")
LEAST, OFF = 6, 1e-12
LAWS = ("dual_quaternion", "hierarchical_qp")


def urdfs() -> list[Path]:
    """The URDFs of the installed wheel."""
    wheel = importlib.metadata.distribution("example-robot-data")
    root = Path(str(wheel.locate_file("cmeel.prefix/share/example-robot-data/robots")))
    return sorted(root.rglob("*.urdf"))


def longest(root: ET.Element) -> tuple[str, list[ET.Element]]:
    """The link with most moving joints above it, and all joints on the way to it."""
    above = {str(joint.find("child").get("link")): joint for joint in root.iterfind("joint")}  # type: ignore[union-attr]
    best: tuple[str, list[ET.Element]] = ("", [])
    for link in above:
        chain, at = [], link
        while at in above:
            chain.append(above[at])
            at = str(above[at].find("parent").get("link"))  # type: ignore[union-attr]
        if moving(chain) > moving(best[1]):
            best = link, chain[::-1]
    return best


def moving(chain: list[ET.Element]) -> int:
    """How many joints of a chain move."""
    return sum(joint.get("type") in MOVING for joint in chain)


def vector(joint: ET.Element, tag: str, key: str, default: str) -> Array:
    """An attribute of three numbers."""
    element = joint.find(tag)
    text = default if element is None else element.get(key, default)
    return np.array([float(part) for part in text.split()])


def about(axis: Array, angle: float) -> Array:
    """Rotation matrix by Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K)


def kinematics(chain: list[ET.Element], angles: dict[str, float]) -> Array:
    """Pose (4, 4) of the chain's end in its root link, out of the XML alone."""
    pose = np.eye(4)
    for joint in chain:
        roll, pitch, yaw = vector(joint, "origin", "rpy", "0 0 0")
        step = np.eye(4)
        step[:3, :3] = about(np.eye(3)[2], yaw) @ about(np.eye(3)[1], pitch)
        step[:3, :3] = step[:3, :3] @ about(np.eye(3)[0], roll)
        step[:3, 3] = vector(joint, "origin", "xyz", "0 0 0")
        axis, kind = vector(joint, "axis", "xyz", "1 0 0"), joint.get("type")
        move, angle = np.eye(4), angles.get(str(joint.get("name")), 0.0)
        if kind == "prismatic":
            move[:3, 3] = angle * axis / np.linalg.norm(axis)
        elif kind in MOVING:
            move[:3, :3] = about(axis, angle)
        pose = pose @ step @ move
    return pose


def limits_off(arm: Arm, chain: list[ET.Element]) -> float:
    """Largest distance of the arm's position limits from those of the XML [rad or m]."""
    off = 0.0
    joints = {str(joint.get("name")): joint for joint in chain}
    for i, name in enumerate(arm.joints):
        joint = joints[name]
        if joint.get("type") == "continuous":
            off = max(off, 0.0 if math.isinf(arm.upper[i]) else math.inf)
            continue
        hard, soft = joint.find("limit"), joint.find("safety_controller")
        assert hard is not None
        lower, upper = float(hard.get("lower", 0.0)), float(hard.get("upper", 0.0))
        if soft is not None:
            lower = max(lower, float(soft.get("soft_lower_limit", lower)))
            upper = min(upper, float(soft.get("soft_upper_limit", upper)))
        off = max(off, abs(arm.lower[i] - lower), abs(arm.upper[i] - upper))
    return off


def helix(path: Path, chain: list[ET.Element]) -> str:
    """A table row: link, shaft tilt at home, RCM and tip errors of both laws, or the error."""
    links = [str(joint.find("child").get("link")) for joint in chain[::-1]]  # type: ignore[union-attr]
    reason = ""
    for k, link in enumerate(links):
        if moving(chain[: len(chain) - k]) < LEAST:
            break
        try:
            load_arm(path, link)
        except ArmError:
            continue
        try:
            scenario = load_scenario("conical_helix", str(path), flange=link, period=0.002)
            cells = [link]
            for law in LAWS:
                made = make_controller(law, scenario.insertion(), scenario.period)
                found = compute_metrics(simulate(scenario, made))
                kept = "" if max(found.speed_ratio_max, 0.0) <= 1.0 + 1e-9 else ", too fast"
                kept += "" if found.limit_margin_min_rad >= -1e-9 else ", beyond a limit"
                cells.append(f"{found.rcm_max_mm:.1e} mm, {found.tip_rms_mm:.2g} mm{kept}")
            return " | ".join(cells)
        except RcmqpError as error:
            reason = reason or str(error).replace(f"{path}: ", "").replace(str(path), path.name)
    return f"| {reason or 'no chain of six joints without a mimic'} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--helix", action="store_true", help="draw a helix with both laws too")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    rng, wrong = np.random.default_rng(7), 0
    more = [f"helix at | {' | '.join(f'{law}: RCM max, tip rms' for law in LAWS)} |"]
    print("| URDF | link | joints | FK off | limits off | refused |", *more * given.helix)
    print("| --- | --- | --- | --- | --- | --- |", *["--- | --- | --- |"] * given.helix)
    for path in urdfs():
        link, chain = longest(ET.parse(path).getroot())
        count = moving(chain)
        if count < LEAST:
            continue
        try:
            arm = load_arm(path, link)
        except ArmError as error:
            reason = str(error).replace(f"{path}: ", "").replace(str(path), path.name)
            line = f"| {path.name} | {link} | {count} | | | {reason} |"
            print(line, *([f"{helix(path, chain)} |"] if given.helix else []), flush=True)
            continue
        off = 0.0
        for _ in range(5):
            angles = arm.random_angles(rng)
            named = dict(zip(arm.joints, angles.tolist(), strict=True))
            pose = arm.state(arm.configuration(angles)).oMe.homogeneous
            off = max(off, float(np.abs(pose - kinematics(chain, named)).max()))
        limits = limits_off(arm, chain)
        wrong += not (off < OFF and limits < OFF)
        line = f"| {path.name} | {link} | {count} | {off:.1e} | {limits:.1e} | |"
        print(line, *([f"{helix(path, chain)} |"] if given.helix else []), flush=True)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
