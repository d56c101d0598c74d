"""How easily an arm gets about from a start: over tilts to all sides, and with the tip deeper."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm
from rcmqp.world.geometry import Collisions
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Instrument

TILT, SIDES, DEEPER = math.radians(20.0), 8, 0.04
"""What is looked at: tilts [rad] to so many sides, with the tip so much deeper [m]."""

AT_EASE = (math.pi / 4, 0.1)
"""Distance from a limit beyond which a joint is at ease [rad], [m]; or a quarter of its travel."""

FOLLOWED = 1e-5
"""Residual of a pose that counts as reached [m, rad]."""

TOUCHING, LOW = 0.01, 0.1
"""What the score of a start is multiplied with that leads to a collision, or below the floor."""


@dataclass(frozen=True, slots=True)
class Ease:
    """What a start is like over tilts to all sides with the tip deeper.

    Attributes:
        tilt: of the shaft at the start from straight down [rad].
        reached: share of the tilts that the arm reaches inside its limits.
        margin: least distance of a joint from a limit [rad], or [m] where it slides.
        share: the same as a share of what puts the joint at ease, at most 1.
        joint: name of that joint.
        unit: of the margin.
        singular_value: least one of the effector's Jacobian [m, rad].
        touching: two parts that touch on the way; empty if none do.
        low: whether a joint or the tip is below the floor, z = 0 or the base where that is lower.
    """

    tilt: float
    reached: float
    margin: float
    share: float
    joint: str
    unit: str
    singular_value: float
    touching: str
    low: bool

    @property
    def score(self) -> float:
        """The more the better."""
        score = self.reached**2 * max(self.share, 1e-3) * self.singular_value
        return score * (TOUCHING if self.touching else 1.0) * (LOW if self.low else 1.0)

    def __str__(self) -> str:
        faults = [f"{self.touching} touch there"] if self.touching else []
        faults += ["part of the arm is below the floor"] if self.low else []
        if self.reached < 1.0:
            faults.append(f"only {100 * self.reached:.0f} % of these are reached")
        return (
            f"shaft {math.degrees(self.tilt):.0f} deg from straight down; over tilts of "
            f"{math.degrees(TILT):.0f} deg to all sides, {100 * DEEPER:.0f} cm deeper, "
            f"{self.joint} stays {self.margin:.2g} {self.unit} from its limits, the least "
            f"singular value is {self.singular_value:.2g}, "
            f"{', '.join(faults) or 'nothing touches'}"
        )


def ease_of(
    arm: Arm,
    instrument: Instrument,
    angles: Array,
    depth: float,
    collisions: Collisions,
) -> Ease:
    """The ease of a start.

    Args:
        arm: its flange carries the instrument.
        instrument: the endoscope.
        angles: (nv,) the start [rad].
        depth: of the tip beyond the trocar [m].
        collisions: of the arm with the instrument.
    """
    effector = arm.with_effector(instrument.on_shaft(instrument.tip - depth))
    start = effector.state(arm.configuration(angles)).oMe
    targets = [start, *_targets(start)]
    room = np.minimum(np.where(arm.turns, *AT_EASE), (arm.upper - arm.lower) / 4.0)
    touching, low, reached, singular = "", False, 0, math.inf
    margins = np.full(arm.nv, np.inf)
    at, before = angles, angles
    for i, target in enumerate(targets):
        at, there = _follow(effector, target, angles if i <= 1 else before)
        before = at
        state = effector.state(arm.configuration(at))
        reached += there
        singular = min(singular, float(np.linalg.svd(state.J_local, compute_uv=False)[-1]))
        margins = np.minimum(margins, arm.limit_margin(at))
        touching = touching or collisions.first(at)
        low = low or _is_low(arm, state.q, state.oMe, depth)
    worst = int(np.argmin(margins / room))
    down = float(-start.rotation[2, 2])
    return Ease(
        tilt=math.acos(min(1.0, max(-1.0, down))),
        reached=reached / len(targets),
        margin=float(margins[worst]),
        share=float(min(1.0, max(0.0, margins[worst] / room[worst]))),
        joint=arm.joints[worst],
        unit="rad" if arm.turns[worst] else "m",
        singular_value=singular,
        touching=touching,
        low=low,
    )


def ease_at(insertion: Insertion) -> Ease:
    """The ease of an insertion's start."""
    arm, instrument = insertion.arm, insertion.instrument
    collisions = Collisions(arm, instrument)
    angles, depth = insertion.angles_start, insertion.tip_depth
    return ease_of(arm, instrument, angles, depth, collisions)


def _targets(start: pin.SE3) -> list[pin.SE3]:
    """The effector's placements: tilted to each side about where it is, and moved inwards."""
    targets = []
    for side in 2.0 * math.pi * np.arange(SIDES) / SIDES:
        turn = pin.exp3(TILT * np.array([math.cos(side), math.sin(side), 0.0]))
        R = start.rotation @ turn
        targets.append(pin.SE3(R, start.translation + DEEPER * R[:, 2]))
    return targets


def _follow(effector: Arm, target: pin.SE3, angles: Array) -> tuple[Array, bool]:
    """Angles (nv,) that reach a placement, in its limits, and whether they do.

    The image stays upright, except for arms of five joints, which cannot.
    """
    rows = 6 if effector.nv >= 6 else 5
    lower, upper = effector.lower, effector.upper
    for _ in range(25):
        state = effector.state(effector.configuration(angles))
        error = pin.log6(state.oMe.actInv(target)).vector[:rows]
        if float(np.abs(error).max()) < FOLLOWED:
            return angles, True
        J = state.J_local[:rows]
        damping = 1e-3 * float(error @ error) + 1e-12
        step = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(rows), error)
        step *= min(1.0, 0.3 / max(float(np.abs(step).max()), 1e-300))
        angles = np.clip(angles + step, lower, upper)
    return angles, False


def floor_of(arm: Arm) -> float:
    """Height of the floor [m]: the world's origin, or the first joint where that is lower."""
    return min(0.0, float(arm.model.jointPlacements[1].translation[2]))


def _is_low(arm: Arm, q: Array, oMe: pin.SE3, depth: float) -> bool:
    """Whether a joint beyond the first, or the tip, is below the floor."""
    tip = oMe.act(np.array([0.0, 0.0, depth]))
    heights = [*arm.skeleton(q)[2:, 2], tip[2]]
    return bool(min(heights) < floor_of(arm) - 1e-3)
