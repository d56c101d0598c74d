"""Dual quaternions as plain float64 arrays, in the paper's notation.

A quaternion is (..., 4), w first: ``[w, x, y, z]``. A dual quaternion is (..., 8): the primary
part P(x), then the dual part D(x). A unit dual quaternion stands for the placement of a frame b
in a frame a,

    x = r + eps * (1/2) t r,

with r the rotation from b to a and t the origin of b in a [m], as a pure quaternion. Products
are Hamilton's, poses compose left to right, conj() conjugates both halves, and x and -x are one
pose.

Products, parts, log, exp and power take leading axes and broadcast over them; the Hamilton
operators and the way from and to Pinocchio take one element. Pinocchio stores quaternions
xyzw: only from_se3() and to_se3() convert.

log() and exp() are the paper's: they treat rotation and translation apart, and are each other's
inverse, but they are not the logarithm and exponential of the Lie group SE(3). For pure
rotations, which is all that equation (9) needs, the two agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from rcmqp.errors import InvalidCommand

Array: TypeAlias = NDArray[np.float64]

C4: Array = np.diag([1.0, -1.0, -1.0, -1.0])
"""(4, 4): vec(conj(q)) = C4 vec(q)."""

C8: Array = np.diag([1.0, -1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0])
"""(8, 8): vec(conj(x)) = C8 vec(x); C_8 of equation (3)."""

IDENTITY: Array = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
"""(8,): no rotation, no translation."""

for _constant in (C4, C8, IDENTITY):
    _constant.setflags(write=False)


T = TypeVar("T", float, Array)


def _hamilton(a: Sequence[T], b: Sequence[T]) -> tuple[T, T, T, T]:
    """Hamilton's product, number by number or array by array: ij = k, jk = i, ki = j."""
    a0, a1, a2, a3 = a
    b0, b1, b2, b3 = b
    return (
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    )


def _conjugate(r: Sequence[T]) -> list[T]:
    """R*, number by number or array by array."""
    r0, r1, r2, r3 = r
    return [r0, -r1, -r2, -r3]


def _turned(r: Sequence[T], p: Sequence[T]) -> tuple[T, T, T]:
    """R p r*, number by number or array by array."""
    p1, p2, p3 = p
    return _hamilton(_hamilton(r, [0.0 * r[0], p1, p2, p3]), _conjugate(r))[1:]


def _translation(x: Sequence[T]) -> tuple[T, T, T]:
    """T = 2 D(x) P(x)*, number by number or array by array."""
    _, t0, t1, t2 = _hamilton(x[4:], _conjugate(x[:4]))
    return 2.0 * t0, 2.0 * t1, 2.0 * t2


def _placed(x: Sequence[T], p: Sequence[T]) -> tuple[T, T, T]:
    """T + r p r*, number by number or array by array."""
    (t0, t1, t2), (p0, p1, p2) = _translation(x), _turned(x[:4], p)
    return t0 + p0, t1 + p1, t2 + p2


def _apply(formula: Callable[..., tuple[Any, ...]], *operands: ArrayLike) -> Array:
    """A formula of the last axis' numbers.

    Single elements are computed with Python floats, which is faster.
    """
    arrays = [np.asarray(operand, dtype=float) for operand in operands]
    if all(array.ndim == 1 for array in arrays):
        return np.array(formula(*[array.tolist() for array in arrays]))
    return np.stack(formula(*[np.moveaxis(array, -1, 0) for array in arrays]), axis=-1)


def _quaternion_table() -> Array:
    """Hamilton's product as an array (4, 4, 4): e_j e_k = sum_i table[i, j, k] e_i."""
    units = np.eye(4).tolist()
    return np.array([[_hamilton(e_j, e_k) for e_k in units] for e_j in units]).transpose(2, 0, 1)


def _dual_table(table: Array) -> Array:
    """The same for dual quaternions (8, 8, 8), with eps^2 = 0."""
    dual = np.zeros((8, 8, 8))
    dual[:4, :4, :4] = dual[4:, :4, 4:] = dual[4:, 4:, :4] = table
    return dual


_CONJ4, _CONJ8 = np.diag(C4), np.diag(C8)
_T8 = _dual_table(_quaternion_table())


# Quaternions -------------------------------------------------------------------------------


def quaternion_mul(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product of two quaternions, each (..., 4)."""
    return _apply(_hamilton, a, b)


def quaternion_conj(q: ArrayLike) -> Array:
    """Conjugate of a quaternion (..., 4)."""
    return np.asarray(q, dtype=float) * _CONJ4


def rotation(axis: ArrayLike, angle: float) -> Array:
    """Unit quaternion (4,) of a rotation by ``angle`` [rad] about the unit vector ``axis`` (3,).

    r = cos(theta/2) + n sin(theta/2), section II-A.
    """
    n = np.asarray(axis, dtype=float)
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * n)])


def rotate(r: ArrayLike, p: ArrayLike) -> Array:
    """The vector ``p`` (..., 3) turned by the unit quaternion ``r`` (..., 4): r p r*."""
    return _apply(_turned, r, p)


def quaternion_exp(v: ArrayLike) -> Array:
    """Unit quaternion (..., 4) whose logarithm is the pure quaternion of ``v`` (..., 3).

    P(exp x) of section II-A. The angle of rotation is 2 |v|.
    """
    v = np.asarray(v, dtype=float)
    half = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), np.sinc(half / np.pi) * v], axis=-1)


def quaternion_log(r: ArrayLike) -> Array:
    """Logarithm (..., 3) of a unit quaternion (..., 4): n theta/2, with theta/2 in [0, pi].

    The half angle comes from atan2(|v|, w), exact from 1e-300 to pi; 2 acos(w) would lose half
    of the digits near the identity and be NaN for w just above 1. At r = -1, where any axis
    will do, the axis is x. exp(log(r)) = r on every branch: r and -r, though one rotation, have
    different logarithms. Where the short way is meant, bring r to w >= 0 first.
    """
    r = np.asarray(r, dtype=float)
    w, v = r[..., 0], r[..., 1:]
    scale = np.max(np.abs(v), axis=-1, initial=0.0)
    safe = np.where(scale > 0.0, scale, 1.0)
    s = safe * np.linalg.norm(v / safe[..., None], axis=-1)  # no underflow for tiny v
    half = np.arctan2(s, w)
    factor = half / np.where(s > 0.0, s, 1.0)
    turned = np.where((s == 0.0) & (w < 0.0), np.pi, 0.0)
    log: Array = factor[..., None] * v + turned[..., None] * np.array([1.0, 0.0, 0.0])
    return log


# Dual quaternions --------------------------------------------------------------------------


def P(x: ArrayLike) -> Array:
    """Primary part (..., 4) of a dual quaternion (..., 8): the rotation r of a pose."""
    return np.asarray(x, dtype=float)[..., :4]


def D(x: ArrayLike) -> Array:
    """Dual part (..., 4) of a dual quaternion (..., 8): (1/2) t r of a pose."""
    return np.asarray(x, dtype=float)[..., 4:]


def mul(x: ArrayLike, y: ArrayLike) -> Array:
    """Product of two dual quaternions, each (..., 8): poses compose left to right."""
    return _contract("ijk,...j,...k->...i", _T8, x, y)


def conj(x: ArrayLike) -> Array:
    """Conjugate x* of a dual quaternion (..., 8), of both halves: the inverse of a pose."""
    return np.asarray(x, dtype=float) * _CONJ8


def norm(x: ArrayLike) -> Array:
    """Norm ||x|| = sqrt(x x*) as a dual number (..., 2): [|P|, P.D / |P|]; a pose has [1, 0]."""
    primary = np.linalg.norm(P(x), axis=-1)
    return np.stack([primary, np.sum(P(x) * D(x), axis=-1) / primary], axis=-1)


def vec(x: ArrayLike) -> Array:
    """The paper's vec operator: here a dual quaternion is its own vector (..., 8)."""
    return np.asarray(x, dtype=float)


def translation(x: ArrayLike) -> Array:
    """Translation t (..., 3) [m] of a pose (..., 8): t = 2 D(x) P(x)*."""
    return _apply(_translation, x)


def place(x: ArrayLike, p: ArrayLike) -> Array:
    """The point ``p`` (..., 3) [m], given in the axes of the pose x (..., 8), in the world."""
    return _apply(_placed, x, p)


def pose(r: ArrayLike, t: ArrayLike) -> Array:
    """Unit dual quaternion (..., 8) of a rotation r (..., 4) and a translation t (..., 3) [m]."""
    r, half_t = np.broadcast_arrays(np.asarray(r, dtype=float), 0.5 * _pure(t))
    return np.concatenate([r, quaternion_mul(half_t, r)], axis=-1)


def from_rotation(r: ArrayLike) -> Array:
    """The quaternion r (..., 4) as a dual quaternion (..., 8) with no dual part."""
    r = np.asarray(r, dtype=float)
    return np.concatenate([r, np.zeros_like(r)], axis=-1)


def from_translation(t: ArrayLike) -> Array:
    """The translation 1 + eps t/2 (..., 8) by t (..., 3) [m]."""
    half_t = 0.5 * _pure(t)
    one = np.zeros_like(half_t)
    one[..., 0] = 1.0
    return np.concatenate([one, half_t], axis=-1)


def log(x: ArrayLike) -> Array:
    """The paper's logarithm (..., 8) of a pose (..., 8): n theta/2 + eps t/2."""
    return np.concatenate(
        [_pure(quaternion_log(P(x))), 0.5 * _pure(translation(x))],
        axis=-1,
    )


def exp(y: ArrayLike) -> Array:
    """The paper's exponential (..., 8): P(exp y) + eps D(y) P(exp y); inverse of log()."""
    r = quaternion_exp(P(y)[..., 1:])
    return np.concatenate([r, quaternion_mul(D(y), r)], axis=-1)


def power(x: ArrayLike, s: float) -> Array:
    """x^{s} = exp(s log x) (..., 8), as equation (11) uses it: angle and translation times s."""
    return exp(s * log(x))


def H8_plus(x: ArrayLike) -> Array:
    """Hamilton operator (..., 8, 8) of left factors x (..., 8): vec(x y) = H8+(x) vec(y)."""
    return np.asarray((np.asarray(x, dtype=float)[..., None, None, :] @ _T8)[..., 0, :])


def H8_minus(y: ArrayLike) -> Array:
    """Hamilton operator (..., 8, 8) of right factors y (..., 8): vec(x y) = H8-(y) vec(x).

    H-bar of equation (3).
    """
    return np.asarray((_T8 @ np.asarray(y, dtype=float)[..., None, :, None])[..., 0])


def align_sign(x: ArrayLike, like: ArrayLike) -> Array:
    """X or -x (..., 8), one pose: the one whose rotation is the shorter way from ``like``."""
    x = np.asarray(x, dtype=float)
    dot = np.sum(P(x) * P(like), axis=-1, keepdims=True)
    return np.where(dot < 0.0, -x, x)


def angle_between(x: ArrayLike, y: ArrayLike) -> Array:
    """Angle of the rotation from pose x to pose y (...) [rad], in [0, pi], each (..., 8)."""
    r = quaternion_mul(quaternion_conj(P(x)), P(y))
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(r[..., 1:], axis=-1), np.abs(r[..., 0])))


def is_unit(x: ArrayLike, tolerance: float = 1e-9) -> bool:
    """Whether x (8,) is a pose: shape right, finite, |P| = 1 and P.D = 0 within tolerance."""
    x = np.asarray(x, dtype=float)
    if x.shape != (8,) or not np.isfinite(x).all():
        return False
    return bool(abs(np.linalg.norm(P(x)) - 1.0) <= tolerance and abs(P(x) @ D(x)) <= tolerance)


def check_unit(x: ArrayLike, what: str = "dual quaternion", tolerance: float = 1e-9) -> Array:
    """Return x (8,) as an array if it is a pose.

    Raises:
        InvalidCommand: it is not; the message says by how much.
    """
    x = np.asarray(x, dtype=float)
    if is_unit(x, tolerance):
        return x
    if x.shape != (8,):
        raise InvalidCommand(f"{what} has shape {x.shape}, it must be (8,)")
    if not np.isfinite(x).all():
        raise InvalidCommand(f"{what} is not finite: {x}")
    raise InvalidCommand(
        f"{what} is not a pose: |P| - 1 = {np.linalg.norm(P(x)) - 1.0:.3g} and "
        f"P.D = {P(x) @ D(x):.3g}, allowed {tolerance:g}; build it with pose() or from_se3(), or, "
        "if it was rounded, with normalized()"
    )


def normalized(x: ArrayLike, tolerance: float = 1e-2) -> Array:
    """The unit dual quaternion nearest to x (8,), which may be a rounded one.

    The rotation is P over its norm; the part of D along P, which no pose has, is left out.

    Raises:
        InvalidCommand: x is farther from a pose than ``tolerance``, so it is something else.
    """
    x = check_unit(x, tolerance=tolerance)
    scale = float(np.linalg.norm(P(x)))
    r, d = P(x) / scale, D(x) / scale
    return np.concatenate([r, d - (r @ d) * r])


def from_se3(aMb: pin.SE3) -> Array:
    """Unit dual quaternion (8,) of a placement, with w >= 0."""
    x, y, z, *xyzw = pin.SE3ToXYZQUAT(aMb)
    r = np.array([xyzw[3], *xyzw[:3]])  # xyzw to wxyz, here and nowhere else
    r /= math.copysign(math.hypot(*r), r[0])
    return pose(r, [x, y, z])


def to_se3(x: ArrayLike) -> pin.SE3:
    """Placement of a unit dual quaternion (8,).

    Raises:
        InvalidCommand: x is not a unit dual quaternion.
    """
    x = check_unit(x)
    return pin.SE3(pin.Quaternion(np.roll(P(x), -1)).matrix(), translation(x))


def _pure(v: ArrayLike) -> Array:
    v = np.asarray(v, dtype=float)
    return np.concatenate([np.zeros((*v.shape[:-1], 1)), v], axis=-1)


def _contract(subscripts: str, *operands: ArrayLike) -> Array:
    arrays = [np.asarray(operand, dtype=float) for operand in operands]
    result: Array = np.einsum(subscripts, *arrays)
    return result
