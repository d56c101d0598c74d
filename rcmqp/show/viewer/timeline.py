"""The data of a run that a page plays: frames, curves and safe stops."""

from __future__ import annotations

import itertools
import math

import numpy as np

from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.run import Run

FRAME_RATE = 60.0
"""Frames a second that the scene is played from, at least, where the run has as many."""

BINS = 800
"""Stretches of time that a curve is cut into; each keeps its least and its largest value."""


def frames(run: Run) -> dict[str, Array]:
    """Every k-th sampling instant of a run, and the last: what the scene is posed from.

    Returns:
        ``time`` (f,) [s]; ``angles`` (f, nv) [rad], without jumps where joints are continuous;
        ``tip``, ``tip_d``, ``pivot`` (f, 3) in the world [m]; ``slip`` (f, 3), from the trocar
        to the nearest point of the shaft's axis [m], its length the RCM error; ``tip_error``,
        ``depth`` (f,) [m].
    """
    k = max(1, math.floor(1.0 / (FRAME_RATE * run.period) + 1e-9))
    rows = np.unique(np.append(np.arange(0, run.time.size, k), run.time.size - 1))
    continuous = ~np.isfinite(run.upper)
    angles = run.angles.copy()
    angles[:, continuous] = np.unwrap(angles[:, continuous], axis=0)
    channels = {
        "time": run.time,
        "angles": angles,
        "tip": run.tip,
        "tip_d": run.tip_d,
        "pivot": run.pivot,
        "slip": slip(run.x, run.pivot),
        "tip_error": run.tip_error,
        "depth": run.depth,
    }
    return {name: array[rows] for name, array in channels.items()}


def slip(x: Array, pivot: Array) -> Array:
    """From the trocar to the nearest point of the shaft's axis, (..., 3) in the world [m].

    Args:
        x: (..., 8) the effector's poses.
        pivot: (..., 3) the trocar [m].
    """
    z = dq.rotate(dq.P(x), np.array([0.0, 0.0, 1.0]))
    seen = dq.translation(x) - pivot
    return np.asarray(seen - np.sum(seen * z, axis=-1, keepdims=True) * z)


def curves(run: Run) -> dict[str, tuple[Array, Array]]:
    """Time [s] and value of each plot: errors [mm], joint speed over limit, singular value."""
    values = {
        "tip_error": 1e3 * run.tip_error,
        "rcm_error": 1e3 * run.rcm_error,
        "speed_ratio": np.abs(run.v / run.velocity_limit).max(axis=-1),
        "singular_value": run.singular_value,
    }
    return {name: envelope(run.time, value) for name, value in values.items()}


def stopped(run: Run) -> Array:
    """When the controller was in its safe stop: (s, 2) begin and end of each stretch [s].

    Stretches that are too near each other to be drawn apart become one.
    """
    times = run.time[sorted(row for cycles in run.stops.values() for row in cycles)]
    apart = max(1.5 * run.period, run.time[-1] / BINS)
    first = np.diff(times, prepend=-np.inf) > apart
    last = np.diff(times, append=np.inf) > apart
    return np.column_stack([times[first], times[last] + run.period])


def envelope(time: Array, values: Array) -> tuple[Array, Array]:
    """Fewer points of a curve, with every extreme: least and largest value of each bin.

    Args:
        time: (n,) rising.
        values: (n,).

    Returns:
        Time and value (m,) of the points kept, m <= 2 BINS + 2; first and last are among them.
    """
    n = values.size
    if n <= 2 * BINS:
        return time, values
    edges = np.linspace(0, n, BINS + 1).astype(int)
    kept = {0, n - 1}
    missing = np.isnan(values)
    least, largest = np.where(missing, np.inf, values), np.where(missing, -np.inf, values)
    for low, high in itertools.pairwise(edges):
        kept.add(low + int(least[low:high].argmin()))
        kept.add(low + int(largest[low:high].argmax()))
    rows = np.array(sorted(kept))
    return time[rows], values[rows]
