"""Finding a starting configuration: the shaft through a wished trocar, at ease on its way."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from rcmqp.errors import NoStartFound
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm
from rcmqp.world.ease import DEEPER, LOW, Ease, ease_of, floor_of
from rcmqp.world.geometry import Collisions
from rcmqp.world.instrument import Instrument, Trocar

STEP = 0.3
"""Longest step of the search [rad]."""

CONVERGED = 1e-12
"""Where the search stops: residual [m, rad]."""

HOPELESS, FAR = 30, 0.05
"""Iterations after which a search that is farther off than this [m, rad] is given up."""

HELD = 1e-9
"""Residual of what counts as reached [m, rad]."""

LOOKED_AT = 12
"""Starts, the best of those found, that are followed over tilts and depths."""

_Found = tuple[float, Array, float]
"""How good a start is by itself, its joint angles, and the depth of the tip."""


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A start, how easy it is, and the result of the other searches.

    Attributes:
        angles: (nv,) joint angles [rad].
        ease: how easily the arm gets about from there.
        searches: how many were made.
        reached: how many of them reached the trocar.
        refused: why starts that reached it were not taken, and how many.
    """

    angles: Array
    ease: Ease
    searches: int
    reached: int
    refused: Counter[str]

    def __str__(self) -> str:
        """What was found, and what became of the rest."""
        text = f"{self.ease}; {self.reached} of {self.searches} searches reached the trocar"
        if self.refused:
            reasons = (f"{count} for {reason}" for reason, count in self.refused.most_common())
            text += f", refused were {', '.join(reasons)}"
        return text


def find_start(
    arm: Arm,
    instrument: Instrument,
    trocar: Trocar,
    *,
    depth: float = 0.1,
    margin: float = 0.1,
    stroke_margin: float = 0.01,
    singular_value: float = 0.02,
    attempts: int = 60,
    seed: int = 0,
) -> Array:
    """Joint angles (nv,) [rad] that put the shaft through the trocar, along its axis.

    See search_start(), whose angles these are.
    """
    return search_start(
        arm,
        instrument,
        trocar,
        depth=depth,
        margin=margin,
        stroke_margin=stroke_margin,
        singular_value=singular_value,
        attempts=attempts,
        seed=seed,
    ).angles


def search_start(
    arm: Arm,
    instrument: Instrument,
    trocar: Trocar,
    *,
    depth: float = 0.1,
    margin: float = 0.1,
    stroke_margin: float = 0.01,
    singular_value: float = 0.02,
    attempts: int = 60,
    seed: int = 0,
) -> Start:
    """The best start with the shaft through the trocar, along its axis; the same each time.

    Inverse kinematics by damped least squares on five rows, the pivot's position and the
    direction of the axis, so that the roll about the shaft is free; from the arm's home and
    from random configurations. Starts where the arm touches itself or the instrument are refused.
    Of the others the easiest is taken, see Ease: over tilts to all sides and a deeper tip it is
    far from limits and singularities, without collisions, and above the floor.

    Args:
        arm: its flange carries the instrument.
        instrument: the endoscope.
        trocar: wished pivot and axis.
        depth: how far the tip is to be beyond the pivot [m].
        margin: least distance of every turning joint from its limits [rad].
        stroke_margin: the same of sliding joints [m].
        singular_value: least singular value of the effector's Jacobian [m, rad].
        attempts: how many random configurations to search from.
        seed: of those.

    Raises:
        NoStartFound: there is no start; the message says why the nearest one fails.
    """
    rng = np.random.default_rng(seed)
    seeds = [arm.home, *(arm.random_angles(rng) for _ in range(attempts))]
    margins = np.where(arm.turns, margin, stroke_margin)
    search = Search(arm, instrument, margins, singular_value)
    search.look(trocar, depth, seeds)
    best = search.best()
    if best is None:
        raise NoStartFound(search.reason(trocar))
    return best


class Search:
    """Searches for starts of one arm, and their results."""

    def __init__(
        self, arm: Arm, instrument: Instrument, margins: Array, singular_value: float
    ) -> None:
        self.arm, self.instrument = arm, instrument
        self.lower, self.upper = arm.lower + margins, arm.upper - margins
        self.margins, self.singular_value = margins, singular_value
        self.nearest = (math.inf, math.inf)
        self.searches, self.reached = 0, 0
        self.refused: Counter[str] = Counter()
        self.collisions = Collisions(arm, instrument)
        self.found: list[_Found] = []

    def look(self, trocar: Trocar, depth: float, seeds: Iterable[Array]) -> None:
        """Search from each of the seeds, and keep what reaches the trocar."""
        on_shaft = self.instrument.on_shaft(self.instrument.tip - depth)
        effector = self.arm.with_effector(on_shaft)
        for angles in seeds:
            self.searches += 1
            angles = np.clip(angles, self.lower, np.maximum(self.lower, self.upper))
            angles, gap = _solve(effector, trocar, angles, self.lower, self.upper)
            self.nearest = min(self.nearest, gap)
            if max(gap) > HELD:
                continue
            self.reached += 1
            angles = self._unwound(angles)
            J = effector.state(self.arm.configuration(angles)).J_local
            least = float(np.linalg.svd(J, compute_uv=False)[-1])
            if least < self.singular_value:
                self.refused["a singularity nearby"] += 1
            elif touching := self.collisions.first(angles):
                self.refused[f"{touching} touching"] += 1
            else:
                room = float(np.min(self.arm.limit_margin(angles) / self.margins))
                low = trocar.pivot[2] < floor_of(self.arm) + depth + DEEPER
                found = least * min(room, 8.0) * (LOW if low else 1.0)
                self.found.append((found, angles, depth))

    def _unwound(self, angles: Array) -> Array:
        """The same pose with each turning joint as near to the middle of its travel as it goes."""
        turn = 2.0 * math.pi
        middle = self.arm.middle
        nearer = angles - turn * np.round((angles - middle) / turn)
        fits = self.arm.turns & (nearer >= self.lower) & (nearer <= self.upper)
        return np.where(fits, nearer, angles)

    def best(self, most: int = LOOKED_AT) -> Start | None:
        """The easiest of the starts that look ``most`` easy by themselves; None without any."""
        self.found.sort(key=lambda each: -each[0])
        best = None
        for _, angles, depth in _different(self.found, most):
            ease = ease_of(self.arm, self.instrument, angles, depth, self.collisions)
            if best is None or ease.score > best.ease.score:
                best = Start(angles, ease, self.searches, self.reached, self.refused)
        return best

    def reason(self, trocar: Trocar) -> str:
        """Say why there is no start."""
        arm = self.arm
        where = f"trocar at {trocar.pivot} m, axis {trocar.axis}"
        for joint in np.flatnonzero(self.upper <= self.lower):
            unit = "rad" if arm.turns[joint] else "m"
            return (
                f"{arm.name} has no start: {arm.joints[joint]} moves only from "
                f"{arm.lower[joint]:g} to {arm.upper[joint]:g} {unit}, and is to stay "
                f"{self.margins[joint]:g} {unit} inside; give a smaller margin"
            )
        if not self.reached:
            return (
                f"{arm.name} cannot put the shaft through the {where}: the nearest it comes is "
                f"{1e3 * self.nearest[0]:.1f} mm and {math.degrees(self.nearest[1]):.1f} deg off, "
                f"with joints {self.margins[0]:g} {'rad' if arm.turns[0] else 'm'} inside their "
                f"limits (its flange reaches {arm.reach:.2f} m); move the trocar or the arm's "
                "base, or turn the axis"
            )
        reason, count = self.refused.most_common(1)[0]
        if reason.startswith("a singularity"):
            return (
                f"{arm.name} reaches the {where} only near a singularity: every solution's least "
                f"singular value is below {self.singular_value}; move the trocar or lower "
                "singular_value"
            )
        return (
            f"{arm.name} reaches the {where} in {self.reached} of {self.searches} searches, but "
            f"with {reason} in {count} of them; move the trocar, turn the axis, or mount the "
            "instrument at another angle"
        )


def _different(found: list[_Found], most: int) -> Iterator[_Found]:
    """The first ``most`` that are not the same start again."""
    taken: list[Array] = []
    for each in found:
        if all(np.abs(each[1] - other).max() > 1e-3 for other in taken):
            taken.append(each[1])
            yield each
        if len(taken) == most:
            return


def _solve(
    arm: Arm, trocar: Trocar, angles: Array, lower: Array, upper: Array
) -> tuple[Array, tuple[float, float]]:
    """Angles (nv,) reached from ``angles``, and what is left: distance [m] and angle [rad]."""
    pivot, axis = np.array(trocar.pivot), np.array(trocar.axis)
    gap = (math.inf, math.inf)
    for i in range(100):
        state = arm.state(arm.configuration(angles))
        R = state.oMe.rotation
        seen = R.T @ axis
        across = math.hypot(seen[0], seen[1])
        tilt = math.atan2(across, seen[2])
        ratio = tilt / across if across > 0.0 else 1.0
        offset = R.T @ (pivot - state.oMe.translation)
        error = np.array([*offset, -seen[1] * ratio, seen[0] * ratio])
        gap = float(np.linalg.norm(offset)), tilt
        if max(gap) < CONVERGED or (i == HOPELESS and max(gap) > FAR):
            break
        J = state.J_local[:5]
        damping = 1e-3 * float(error @ error) + 1e-12
        step = J.T @ np.linalg.solve(J @ J.T + damping * np.eye(5), error)
        step *= min(1.0, STEP / max(float(np.abs(step).max()), 1e-300))
        angles = np.clip(angles + step, lower, upper)
    return angles, gap
