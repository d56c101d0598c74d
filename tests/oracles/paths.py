"""Tips of drawn paths in numpy, as their docstrings have them."""

from __future__ import annotations

import functools
import math

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.smooth import step
from rcmqp.references.paths import Circle, ConicalHelix, Lissajous
from rcmqp.references.paths.drawn import Drawn


def progress(t: float, duration: float, ramp: float) -> tuple[float, float]:
    """How far a path has come at ``t`` [s], s in [0, 1], and s' [1/s].

    s' rises as step() during ``ramp`` [s], is constant in between, and falls likewise, so that
    s reaches 1 at ``duration`` [s].
    """
    if t > duration / 2:
        s, s_dot = progress(duration - min(t, duration), duration, ramp)
        return 1.0 - s, s_dot
    cruise = 1.0 / (duration - ramp)
    if t >= ramp:
        return cruise * (t - ramp / 2), cruise
    u = max(t, 0.0) / ramp
    return cruise * ramp * u**4 * (2.5 - 3.0 * u + u**2), cruise * step(u)[0]


def tip(path: Drawn, t: float, depth: float) -> tuple[Array, Array]:
    """Tip (3,) [m] and its velocity (3,) [m/s] seen from the trocar; ``depth`` at the start."""
    s, s_dot = progress(t, path.duration, path.ramp)
    p, dp_ds = draw(path, s, depth)
    return p, s_dot * dp_ds


@functools.singledispatch
def draw(path: Drawn, s: float, depth: float) -> tuple[Array, Array]:
    """Tip (3,) [m] at s, from 0 to 1, and its derivative by s."""
    raise TypeError(f"no oracle for {type(path).__name__}; register one here")


@draw.register
def circle(path: Circle, s: float, depth: float) -> tuple[Array, Array]:
    """See Circle."""
    swing = 2.0 * math.pi * path.turns
    cos, sin = math.cos(swing * s), math.sin(swing * s)
    p = np.array([path.radius * (cos - 1.0), path.radius * sin, depth])
    return p, path.radius * swing * np.array([-sin, cos, 0.0])


@draw.register
def helix(path: ConicalHelix, s: float, depth: float) -> tuple[Array, Array]:
    """See ConicalHelix: on the cone, then tilted so that p(0) is where the tip starts."""
    r_0, rise, swing = path.radius_start, path.turns * path.pitch, 2.0 * math.pi * path.turns
    widening, L = path.radius_end - r_0, math.sqrt(depth**2 - r_0**2)
    r, cos, sin = r_0 + widening * s, math.cos(swing * s), math.sin(swing * s)
    on_cone = np.array([r * cos, r * sin, L + rise * s])
    along = np.array([widening * cos - swing * r * sin, widening * sin + swing * r * cos, rise])
    tilt = np.array([[L, 0.0, -r_0], [0.0, depth, 0.0], [r_0, 0.0, L]]) / depth
    return tilt @ on_cone, tilt @ along


@draw.register
def lissajous(path: Lissajous, s: float, depth: float) -> tuple[Array, Array]:
    """See Lissajous."""
    (a, b, c), swing = path.size, 2.0 * math.pi * path.turns
    u = swing * s
    p = np.array([a * math.sin(u), -b * math.sin(2 * u), depth + c * (math.cos(2 * u) - 1.0)])
    dp_du = [a * math.cos(u), -2.0 * b * math.cos(2 * u), -2.0 * c * math.sin(2 * u)]
    return p, swing * np.array(dp_du)
