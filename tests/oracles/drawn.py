"""The tip of a drawn path, from its formula."""

from __future__ import annotations

import math

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.smooth import step
from rcmqp.references.paths import Circle, ConicalHelix, Lissajous


def progress(t: float, duration: float, ramp: float) -> tuple[float, float]:
    """How far something has come at ``t`` [s], s in [0, 1], and s' [1/s].

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


def tip_of(
    path: Circle | ConicalHelix | Lissajous, t: float, tip_depth: float
) -> tuple[Array, Array]:
    """Tip (3,) [m] and its velocity (3,) [m/s] seen from the trocar, in x_d(0)'s axes."""
    match path:
        case Circle():
            return _circle(path, t, tip_depth)
        case ConicalHelix():
            return _helix(path, t, tip_depth)
        case Lissajous():
            return _lissajous(path, t, tip_depth)


def _circle(path: Circle, t: float, tip_depth: float) -> tuple[Array, Array]:
    s, s_dot = progress(t, path.duration, path.ramp)
    turn, turn_dot = 2.0 * math.pi * path.turns * s, 2.0 * math.pi * path.turns * s_dot
    cos, sin = math.cos(turn), math.sin(turn)
    p = np.array([path.radius * (cos - 1.0), path.radius * sin, tip_depth])
    return p, path.radius * turn_dot * np.array([-sin, cos, 0.0])


def _helix(path: ConicalHelix, t: float, tip_depth: float) -> tuple[Array, Array]:
    _, (r_0, r_1, pitch, n) = path.figure(tip_depth)
    s, s_dot = progress(t, path.duration, path.ramp)
    turn, r = 2.0 * math.pi * n * s, r_0 + (r_1 - r_0) * s
    cos, sin, swing = math.cos(turn), math.sin(turn), 2.0 * math.pi * n * r
    L = math.sqrt(tip_depth**2 - r_0**2)
    x, y, z = r * cos, r * sin, L + n * pitch * s
    u, v = (r_1 - r_0) * cos - swing * sin, (r_1 - r_0) * sin + swing * cos  # dp/ds
    w = n * pitch
    c, d = L / tip_depth, -r_0 / tip_depth  # of the tilt, -asin(r_0 / tip_depth) about y
    velocity = s_dot * np.array([c * u + d * w, v, c * w - d * u])
    return np.array([c * x + d * z, y, c * z - d * x]), velocity


def _lissajous(path: Lissajous, t: float, tip_depth: float) -> tuple[Array, Array]:
    _, (a, b, c, n) = path.figure(tip_depth)
    s, s_dot = progress(t, path.duration, path.ramp)
    u, u_dot = 2.0 * math.pi * n * s, 2.0 * math.pi * n * s_dot
    cos_2u, sin_2u = math.cos(2.0 * u), math.sin(2.0 * u)
    p = np.array([a * math.sin(u), -b * sin_2u, tip_depth + c * (cos_2u - 1.0)])
    dp_du = np.array([a * math.cos(u), -2.0 * b * cos_2u, -2.0 * c * sin_2u])
    return p, u_dot * dp_du
