"""Search for a home configuration of an arm whose file has none: one that suits surgery."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from itertools import product

import numpy as np
import pinocchio as pin

from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm
from rcmqp.world.instrument import Instrument, Trocar
from rcmqp.world.start import Search, Start

HOMES_LOOKED_AT = 4
"""Starts, the best on each side and at each tilt, that are followed over tilts and depths."""

OUT, UP = (0.35, 0.5, 0.65), (-0.1, 0.15, 0.4)
"""Places of the flange in front of the arm: shares of its reach, from the first joint."""

SIDES = tuple(math.radians(each) for each in (0.0, 60.0, -60.0))
"""Directions from the base in which the patient may lie; the first is in front of it, along x."""

TILTS = tuple(math.radians(each) for each in (0.0, 25.0, 43.0))
"""Of the shaft, from straight down and away from the base."""

ASIDE = 0.7
"""What the score of a home is multiplied with whose patient lies not in front of the base."""

GOOD = 0.1
"""Score, a metre of reach, of a home that is good enough to look no further."""

POOL, SEEDS = 3000, 4
"""Random configurations, and how many of them each place is searched from."""


def find_home(arm: Arm, instrument: Instrument, depth: float = 0.1) -> Start | None:
    """Search for a home that suits surgery; None if there is none. Reruns give the same one.

    The shaft points downwards through a trocar in front of the base, above the floor, and the
    start is an easy one, see Ease. Sides and tilts of the shaft are tried until one is good; else
    the best of all is taken, where straight down and in front count for more.
    """
    pool = _Pool(arm)
    length = instrument.tip - depth
    margins = np.where(arm.turns, 0.1, np.minimum(0.01, 0.2 * (arm.upper - arm.lower)))
    search = Search(arm, instrument, margins, 0.02)
    best, best_score = None, 0.0
    for tilt, side in product(TILTS, SIDES):
        search.found = []
        for trocar in _trocars(arm, pool.reach, side, tilt, length):
            search.look(trocar, depth, pool.near(trocar, length))
        there = search.best(most=HOMES_LOOKED_AT)
        if there is None:
            continue
        score = there.ease.score * math.cos(tilt) ** 4 * (1.0 if side == 0.0 else ASIDE)
        if score > best_score:
            best, best_score = there, score
        if best_score > GOOD * pool.reach:
            break
    return best and dataclasses.replace(best, searches=search.searches, reached=search.reached)


class _Pool:
    """Random configurations of an arm, and where their flanges are."""

    def __init__(self, arm: Arm) -> None:
        rng = np.random.default_rng(0)
        flange = arm.with_effector(pin.SE3.Identity())
        self.angles = np.array([arm.random_angles(rng) for _ in range(POOL)])
        placements = [flange.state(arm.configuration(each)).oMe for each in self.angles]
        self.points = np.array([each.translation for each in placements])
        self.axes = np.array([each.rotation[:, 2] for each in placements])
        shoulder = np.array(arm.model.jointPlacements[1].translation)
        self.reach = float(np.linalg.norm(self.points - shoulder, axis=1).max())
        travel = arm.upper - arm.lower
        limited = np.isfinite(travel)
        room = arm.limit_margin(self.angles)[:, limited] / travel[limited]
        self.tight = 0.5 - room.min(axis=1, initial=0.5)

    def near(self, trocar: Trocar, length: float) -> Array:
        """Configurations (SEEDS, nv) whose shaft is near the trocar and its axis, and at ease."""
        axis = np.array(trocar.axis)
        flange = np.array(trocar.pivot) - length * axis
        away = np.linalg.norm(self.points - flange, axis=1) / self.reach
        turned = np.arccos(np.clip(self.axes @ axis, -1.0, 1.0)) / math.pi
        chosen: Array = self.angles[np.argsort(away + turned + self.tight)[:SEEDS]]
        return chosen


def _trocars(arm: Arm, reach: float, side: float, tilt: float, length: float) -> Iterator[Trocar]:
    """Trocars on one side of the base, ``length`` [m] from the flange."""
    shoulder = np.array(arm.model.jointPlacements[1].translation)
    out, up = np.array([math.cos(side), math.sin(side), 0.0]), np.array([0.0, 0.0, 1.0])
    axis = math.sin(tilt) * out - math.cos(tilt) * up
    for share, height in product(OUT, UP):
        pivot = shoulder + reach * (share * out + height * up) + length * axis
        yield Trocar(tuple(pivot), tuple(axis))


def home_of(arm: Arm) -> Array:
    """A home for an arm that has none: with the shaft downwards, or else where it is at ease."""
    found = find_home(arm, Instrument())
    return _comfortable(arm) if found is None else found.angles


def _comfortable(arm: Arm, samples: int = 4000) -> Array:
    """The best of many random configurations: far from its limits, and quick in every direction.

    Quick: how fast a point in the middle of an instrument can move and turn (the units of metre
    and radian mixed) before the first joint is at its speed limit.
    """
    rng = np.random.default_rng(0)
    middle = arm.with_effector(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.2])))
    candidates = np.array([arm.random_angles(rng) for _ in range(samples)])
    J = np.array([middle.state(arm.configuration(angles)).J_local for angles in candidates])
    effort = np.linalg.norm(np.linalg.pinv(J), axis=-1) / np.minimum(arm.velocity, 10.0)
    margin = np.minimum(arm.limit_margin(candidates).min(axis=1), 0.35)
    home: Array = candidates[int(np.argmax(margin / effort.max(axis=1)))]
    home.setflags(write=False)
    return home
