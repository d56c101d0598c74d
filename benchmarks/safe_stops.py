"""Safe stops of every arm from random states inside its limits, some of them with no room left.

    python benchmarks/safe_stops.py --states 100000 --jobs 2

A state has random angles, the joints moving at up to full speed and accelerating, without moving
the shaft across the trocar. In half of the states a joint is moved so near to a position limit
that a stop of this joint alone, as fast as acceleration and jerk allow, just ends before it. A
state counts if every joint alone stops inside its position limits, by a simulation of its own.

Printed for each arm: states; those in which the trocar can be kept; how far a joint goes over its
position limit; largest excess of acceleration and jerk, relative; how long the stop takes, as a
multiple of the time that the slowest joint needs alone; how far the shaft goes from where it was,
in the states in which the trocar can be kept and in all.

The trocar can be kept if a plain stop on it is inside all limits and within 0.05 mm of where the
shaft was: all accelerations go to zero in proportion, then all speeds, both with 0.7 of the
acceleration and jerk of the joint that allows least; in each cycle, the pseudo-inverse adds what
puts the shaft back by the end of it. Two such stops are tried: one goes all of the way back in a
cycle, the other three quarters.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed

from rcmqp import Arm, Insertion, Instrument, arm_names, load_arm
from rcmqp.controllers.braking import braking, nearest
from rcmqp.maths.dualquaternion import Array
from rcmqp.show.table import Table
from rcmqp.world.arm import ArmState

PERIODS = (0.001, 0.002, 0.004, 0.008)

SHARE = 0.7
"""Of acceleration and jerk in the plainest stop; the rest is for the way that the arm bends."""

NEAR = 5e-5
"""How far the shaft may move in a stop that keeps the trocar [m]."""


@dataclass(frozen=True)
class Stop:
    """What one safe stop did.

    Attributes:
        over: beyond a position limit [rad].
        excess: of acceleration and jerk, relative.
        longer: time over that of the slowest joint alone.
        shaft: largest distance from where it was [m].
        kept: whether the trocar can be kept.
    """

    over: float
    excess: float
    longer: float
    shaft: float
    kept: bool


def limited(name: str) -> Insertion:
    """An arm with the limits that it has or that are assumed, its instrument in a trocar."""
    return Insertion.on_shaft(load_arm(name), Instrument())


def across(state: ArmState, depth: float) -> Array:
    """Velocity (2, nv) of the shaft at ``depth`` [m], across it, in the effector's axes."""
    nu, omega = state.J_local[:3], state.J_local[3:]
    return np.array([nu[0] + depth * omega[1], nu[1] - depth * omega[0]])


def hardest(v: Array, arm: Arm, period: float) -> Array:
    """Deceleration (nv,) from which the speed |v| and the deceleration can end together."""
    step = arm.jerk * period
    m = np.arange(float(np.ceil(np.max(arm.acceleration / step))) + 1.0)[:, None]
    return np.asarray(((np.abs(v) / period + step * m * (m + 1.0) / 2.0) / (m + 1.0)).min(axis=0))


def alone(arm: Arm, v: Array, a: Array, period: float) -> tuple[Array, Array, int]:
    """How far (nv,) each joint goes down and up that stops by itself, and the slowest's cycles."""
    q = low = high = np.zeros(arm.nv)
    step, cycles = arm.jerk * period, 0
    while v.any() or a.any():
        q = q + period * v
        low, high = np.minimum(low, q), np.maximum(high, q)
        wanted = -np.sign(v) * np.minimum(arm.acceleration, hardest(v, arm, period))
        a = np.clip(wanted, a - step, a + step)
        v = v + period * a
        v = np.where(np.abs(v) < 1e-12, 0.0, v)
        a = np.where((v == 0.0) & (np.abs(a) <= step), 0.0, a)
        cycles += 1
    return low, high, cycles


def moving(
    insertion: Insertion, q: Array, depth: float, v: Array, a: Array
) -> tuple[Array, Array]:
    """The part of v and a that leaves the shaft's point at ``depth`` where it is."""
    arm, h = insertion.arm, 1e-6
    ahead, behind = (across(insertion.state(arm.integrate(q, v, by)), depth) for by in (h, -h))
    rows = across(insertion.state(q), depth)
    inverse = np.linalg.pinv(rows, rcond=1e-3)
    v = v - inverse @ rows @ v
    v = v / max(1.0, float(np.max(np.abs(v) / arm.velocity)))
    bent = (ahead - behind) @ v / (2.0 * h)
    a = a - inverse @ (rows @ a + bent)
    return v, a / max(1.0, float(np.max(np.abs(a) / arm.acceleration)))


def drawn(insertion: Insertion, rng: np.random.Generator, period: float) -> tuple[Array, ...]:
    """Angles, v, a and the trocar of a state from which every joint alone stops in time."""
    arm = insertion.arm
    while True:
        angles, depth = arm.random_angles(rng), float(rng.uniform(-0.05, 0.05))
        scale = 10.0 ** rng.uniform(-1.0, 0.2, 2)
        v0 = scale[0] * rng.uniform(-1.0, 1.0, arm.nv) * arm.velocity
        a0 = scale[1] * rng.uniform(-1.0, 1.0, arm.nv) * arm.acceleration
        tight, i = bool(rng.integers(2)), int(rng.integers(arm.nv))
        spare = 10.0 ** float(rng.uniform(-9.0, -2.0))
        for _ in range(4 if tight else 1):
            q = arm.configuration(angles)
            v, a = moving(insertion, q, depth, v0, a0)
            low, high, _ = alone(arm, v, a, period)
            end = arm.upper[i] - high[i] if v[i] > 0.0 else arm.lower[i] - low[i]
            if tight and np.isfinite(end):
                angles[i] = end - np.sign(v[i]) * spare
        fits = (angles + low >= arm.lower) & (angles + high <= arm.upper)
        if fits.all() and (np.abs(v + period * a) <= arm.velocity).all():
            return angles, v, a, insertion.state(q).oMe.act(np.array([0.0, 0.0, depth]))


def can_be_kept(
    insertion: Insertion,
    angles: Array,
    v: Array,
    a: Array,
    pivot: Array,
    period: float,
    back: float,
) -> bool:
    """Whether a plain stop keeps the trocar, see above; each pass takes ``back`` of the error."""
    arm, T = insertion.arm, period
    q = arm.integrate(arm.configuration(angles), v, T)
    angles = angles + T * v
    held = nearest(insertion.state(q), pivot)
    for plain in plainest(arm, v, a, T):
        before, v = v, plain
        for _ in range(2):  # the second pass sees the curvature
            state = insertion.state(arm.integrate(q, v, T))
            off = state.oMe.actInv(held)
            v = v + back * np.linalg.pinv(across(state, float(off[2])), rcond=1e-3) @ off[:2] / T
        change_before, a = a, (v - before) / T
        q, angles = arm.integrate(q, v, T), angles + T * v
        fits = (
            (np.abs(v) <= arm.velocity)
            & (np.abs(a) <= arm.acceleration)
            & (np.abs(a - change_before) <= T * arm.jerk)
            & (angles >= arm.lower)
            & (angles <= arm.upper)
        )
        off_by = float(np.linalg.norm(nearest(insertion.state(q), held) - held))
        if not fits.all() or off_by > NEAR:
            return False
    return True


def plainest(arm: Arm, v: Array, a: Array, period: float) -> Iterator[Array]:
    """Joint velocities: all accelerations to zero in proportion, then all speeds."""
    A, j, T = SHARE * arm.acceleration, SHARE * arm.jerk, period
    ramp = max(1, math.ceil(float(np.max(np.abs(a) / (j * T)))))
    for k in range(1, ramp + 1):
        v = v + T * a * (1.0 - k / ramp)
        yield v
    speed = np.maximum(np.abs(v), 1e-12)
    most, step = float(np.min(A / speed)), float(np.min(j / speed))
    rise = min(most, math.sqrt(step)) / step  # of the common deceleration, and its fall
    hold = max(0.0, 1.0 / (rise * step) - rise)
    for k in range(1, math.ceil((2.0 * rise + hold) / T) + 1):
        t = k * T
        left = 2.0 * rise + hold - t
        gone = 0.5 * step * (t**2 - max(0.0, t - rise) ** 2)
        share = 1.0 - gone if left > rise else 0.5 * step * max(0.0, left) ** 2
        yield share * v


def stop(insertion: Insertion, rng: np.random.Generator, period: float) -> Stop:
    """One safe stop from a random state."""
    arm = insertion.arm
    angles, v, a, pivot = drawn(insertion, rng, period)
    kept = any(can_be_kept(insertion, angles, v, a, pivot, period, by) for by in (1.0, 0.5))
    *_, least = alone(arm, v, a, period)
    q, cycles, over, excess, shaft = arm.configuration(angles), 0, 0.0, 0.0, 0.0
    angles, held = angles + period * v, None
    for after in braking(insertion, angles - period * v, v, period, pivot, a):
        q = arm.integrate(q, v, period)
        state = insertion.state(q)
        held = nearest(state, pivot) if held is None else held
        shaft = max(shaft, float(np.linalg.norm(nearest(state, held) - held)))
        change = (after - v) / period
        excess = max(
            excess,
            float(np.max(np.abs(change) / arm.acceleration)) - 1.0,
            float(np.max(np.abs(change - a) / (period * arm.jerk))) - 1.0,
        )
        v, a, cycles = after, change, cycles + 1
        angles = angles + period * v
        over = max(over, float(np.max(angles - arm.upper)), float(np.max(arm.lower - angles)))
    assert not v.any()
    return Stop(over, excess, cycles / least, shaft, kept)


def several(name: str, seed: int, count: int) -> list[Stop]:
    """Stops of one arm."""
    insertion, rng = limited(name), np.random.default_rng([seed, arm_names().index(name)])
    return [stop(insertion, rng, PERIODS[k % len(PERIODS)]) for k in range(count)]


def cells(found: list[Stop]) -> list[str]:
    """A line of the table."""
    kept = [1e3 * one.shaft for one in found if one.kept]
    return [
        str(len(found)),
        f"{np.mean([one.kept for one in found]):.0%}",
        f"{1e3 * max(one.over for one in found):.1e}",
        f"{max(one.excess for one in found):.1e}",
        f"{np.quantile([one.longer for one in found], 0.99):.2f}",
        f"{max(one.longer for one in found):.2f}",
        f"{np.quantile(kept, 0.999):.2g}" if kept else "",
        f"{max(kept, default=0.0):.2g}",
        f"{np.quantile([1e3 * one.shaft for one in found], 0.99):.2g}",
    ]


HEADS = (
    "arm",
    "states",
    "trocar can be kept",
    "over a position limit [mrad]",
    "excess of acceleration or jerk",
    "time, 99 %",
    "largest",
    "shaft [mm] where it can, 99.9 %",
    "largest",
    "in all, 99 %",
)


def main() -> None:
    """Print a Markdown table, one line an arm."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--states", type=int, default=800, help="in all")
    parser.add_argument("--jobs", type=int, default=1, help="processes; -1 for every core")
    given = parser.parse_args()
    each, size = given.states // len(arm_names()), 50
    chunks = Parallel(n_jobs=given.jobs)(
        delayed(several)(name, first, min(size, each - first))
        for name in arm_names()
        for first in range(0, each, size)
    )
    found: dict[str, list[Stop]] = {name: [] for name in arm_names()}
    names = [name for name in arm_names() for _ in range(0, each, size)]
    for name, stops in zip(names, chunks, strict=True):
        found[name] += stops
    everything = [one for stops in found.values() for one in stops]
    rows = [[name, *cells(stops)] for name, stops in [*found.items(), ("all", everything)]]
    print(Table(HEADS, rows).markdown(), end="")


if __name__ == "__main__":
    main()
