"""Eight colours that can be told apart, by the colour-blind too, on white and on dark."""

from __future__ import annotations

import itertools
import re

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.maths.dualquaternion import Array
from rcmqp.show.labels import COLOURS, DASHES, colour, dash
from rcmqp.show.viewer.build import asset

SEEN: dict[str, ArrayLike] = {
    "all three": np.eye(3),
    "no red": [[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]],
    "no green": [[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]],
    "no blue": [[1.2553, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]],
}
"""Linear RGB as people see it who lack cones: Machado, Oliveira, Fernandes (2009), severity 1."""

XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(colour: str) -> Array:
    channel = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(channel <= 0.04045, channel / 12.92, ((channel + 0.055) / 1.055) ** 2.4)


def lab(rgb: Array) -> Array:
    """CIE L*a*b* of linear RGB, white D65."""
    x, y, z = np.cbrt(XYZ @ np.clip(rgb, 0.0, 1.0) / [0.9505, 1.0, 1.089])
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def test_any_two_colours_differ_for_everyone() -> None:
    for a, b in itertools.combinations(COLOURS, 2):
        for who, seen in SEEN.items():
            far = np.linalg.norm(
                lab(np.asarray(seen) @ linear(a)) - lab(np.asarray(seen) @ linear(b))
            )
            assert far > 15.0, (a, b, who)


def test_runs_of_one_colour_have_other_dashes() -> None:
    looks = [(colour(i), dash(i)) for i in range(len(COLOURS) * len(DASHES))]
    assert len(set(looks)) == len(looks)
    assert [dash(i) for i in range(4)] == list(DASHES)


def test_each_colour_stands_out_from_white_and_dark_pages() -> None:
    papers = re.findall(r"--paper: (#\w{6})", asset("look.css"))
    assert len(papers) == 2
    for ink, paper in itertools.product(COLOURS, papers):
        darker, lighter = sorted(XYZ[1] @ linear(each) for each in (ink, paper))
        assert (lighter + 0.05) / (darker + 0.05) > 2.2, (ink, paper)
