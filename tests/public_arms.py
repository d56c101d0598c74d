"""Public arms as small URDFs of our own: the kinematics, limits in round numbers, no shapes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

H = math.pi / 2

Row = tuple[float, float, float, float]

# Standard Denavit-Hartenberg rows (a, alpha, d, offset of theta), the travel of each joint to
# either side [deg], and the speed of all [deg/s].
PUBLIC_ARMS: dict[str, tuple[list[Row], Sequence[float], float]] = {
    "ur3e": (
        [
            (0, H, 0.15185, 0),
            (-0.24355, 0, 0, 0),
            (-0.2132, 0, 0, 0),
            (0, H, 0.13105, 0),
            (0, -H, 0.08535, 0),
            (0, 0, 0.0921, 0),
        ],
        [360] * 6,
        180,
    ),
    "ur5e": (
        [
            (0, H, 0.1625, 0),
            (-0.425, 0, 0, 0),
            (-0.3922, 0, 0, 0),
            (0, H, 0.1333, 0),
            (0, -H, 0.0997, 0),
            (0, 0, 0.0996, 0),
        ],
        [360, 360, 180, 360, 360, 360],
        180,
    ),
    "ur10e": (
        [
            (0, H, 0.1807, 0),
            (-0.6127, 0, 0, 0),
            (-0.57155, 0, 0, 0),
            (0, H, 0.17415, 0),
            (0, -H, 0.11985, 0),
            (0, 0, 0.11655, 0),
        ],
        [360, 360, 180, 360, 360, 360],
        120,
    ),
    "iiwa7": (
        [
            (0, -H, 0.34, 0),
            (0, H, 0, 0),
            (0, H, 0.4, 0),
            (0, -H, 0, 0),
            (0, -H, 0.4, 0),
            (0, H, 0, 0),
            (0, 0, 0.126, 0),
        ],
        [170, 120, 170, 120, 170, 120, 175],
        98,
    ),
    "iiwa14": (
        [
            (0, -H, 0.36, 0),
            (0, H, 0, 0),
            (0, H, 0.42, 0),
            (0, -H, 0, 0),
            (0, -H, 0.4, 0),
            (0, H, 0, 0),
            (0, 0, 0.126, 0),
        ],
        [170, 120, 170, 120, 170, 120, 175],
        85,
    ),
    "gen3": (
        [
            (0, H, 0.2848, 0),
            (0, H, -0.0118, math.pi),
            (0, H, 0.4208, math.pi),
            (0, H, -0.0128, math.pi),
            (0, H, 0.3143, math.pi),
            (0, H, 0, math.pi),
            (0, 0, 0.1674, math.pi),
        ],
        [360, 128, 360, 147, 360, 120, 360],
        50,
    ),
    "irb120": (
        [
            (0, -H, 0.29, 0),
            (0.27, 0, 0, -H),
            (0.07, -H, 0, 0),
            (0, H, 0.302, 0),
            (0, -H, 0, 0),
            (0, 0, 0.072, math.pi),
        ],
        [165, 110, 90, 160, 120, 400],
        250,
    ),
    "puma560": (
        [
            (0, H, 0.67, 0),
            (0.4318, 0, 0, 0),
            (0.0203, -H, 0.15005, 0),
            (0, H, 0.4318, 0),
            (0, -H, 0, 0),
            (0, 0, 0.0563, 0),
        ],
        [160, 180, 180, 180, 100, 266],
        90,
    ),
    "lrmate200id": (
        [
            (0.05, -H, 0.33, 0),
            (0.33, 0, 0, -H),
            (0.035, -H, 0, 0),
            (0, H, 0.335, 0),
            (0, -H, 0, 0),
            (0, 0, 0.08, math.pi),
        ],
        [170, 110, 140, 190, 120, 360],
        400,
    ),
    "xarm6": (
        [
            (0, -H, 0.267, 0),
            (0.28949, 0, 0, -1.3849),
            (0.0775, -H, 0, 1.3849),
            (0, H, 0.3425, 0),
            (0.076, -H, 0, 0),
            (0, 0, 0.097, 0),
        ],
        [360, 118, 225, 360, 180, 360],
        180,
    ),
}


def write_public_arm(folder: Path, name: str) -> Path:
    """The arm's URDF, its last link called flange; joint i turns about z of the row before it."""
    rows, travels, speed = PUBLIC_ARMS[name]
    parts, before, last = ['<link name="l0"/>'], (0.0, 0.0, 0.0), "l0"
    for i, ((a, alpha, d, offset), travel) in enumerate(zip(rows, travels, strict=True), 1):
        a_before, alpha_before, d_before = before
        limit = math.radians(travel)
        parts.append(
            f'<link name="l{i}"/><joint name="j{i}" type="revolute"><parent link="{last}"/>'
            f'<child link="l{i}"/><origin xyz="{a_before} 0 {d_before}" rpy="{alpha_before} 0 0"/>'
            f'<axis xyz="0 0 1"/><limit lower="{-limit}" upper="{limit}" effort="100" '
            f'velocity="{math.radians(speed)}"/></joint>'
        )
        mid = f"turn{i}"
        parts.append(
            f'<link name="{mid}"/><joint name="{mid}" type="fixed"><parent link="l{i}"/>'
            f'<child link="{mid}"/><origin rpy="0 0 {offset}"/></joint>'
        )
        before, last = (a, alpha, d), mid
    a, alpha, d = before
    parts.append(
        f'<link name="flange"/><joint name="end" type="fixed"><parent link="{last}"/>'
        f'<child link="flange"/><origin xyz="{a} 0 {d}" rpy="{alpha} 0 0"/></joint>'
    )
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="{name}">{"".join(parts)}</robot>')
    return path
