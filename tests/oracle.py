"""Oracles for hierarchies that share nothing with the solver.

The certificate takes the answer and the raw problem and asks scipy's non-negative least squares
for multipliers that prove each level's optimality (necessary and sufficient, as every level is
convex). The primal oracle solves each level in the nullspace of those above, inside the box, as a
least-distance problem by the same non-negative least squares. The damped oracle does the same with
the rows of speed and exchange that rcmqp/kernel/cascade.h defines stacked below the level's own.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.optimize import lsq_linear, nnls

import rcmqp
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp.levels import Bounds, Level

AT_BOUND = 1e-9


def constant(name: str) -> float:
    """A number that compiled code is built with, from its sources."""
    kernel = Path(rcmqp.__file__).parent / "kernel"
    text = "".join(path.read_text(encoding="utf-8") for path in sorted(kernel.glob("*.[ch]")))
    (found,) = re.findall(rf"#define {name} (\S+)", text)
    return float(found)


@dataclass(frozen=True)
class Problem:
    levels: list[Level]
    bounds: Bounds
    sluggish: bool = False


def stack(p: Problem, exceeded: Array) -> list[tuple[Array, Array]]:
    """Every level as (A, b), the exceeded hard rows first and the rest last."""
    n = p.bounds.lower.size
    top = (p.bounds.C[exceeded > AT_BOUND], p.bounds.d[exceeded > AT_BOUND])
    return [top, *((x.A, x.b) for x in p.levels), (np.eye(n), np.zeros(n))]


def certificate(p: Problem, v: Array) -> list[float]:
    """For each level, how far the best multipliers are from proving v optimal."""
    n, box = v.size, p.bounds
    excess = box.C @ v - box.d
    at_box = np.vstack(
        [np.eye(n)[v >= box.upper - AT_BOUND], -np.eye(n)[v <= box.lower + AT_BOUND]]
    )
    active = np.vstack([at_box, box.C[excess >= -AT_BOUND]])
    fixed, found = np.zeros((0, n)), []
    for k, (A, b) in enumerate(stack(p, excess)):
        free = null_space(fixed, rcond=1e-11) if len(fixed) else np.eye(n)
        gradient = free.T @ (A.T @ (A @ v - b))
        normals = free.T @ (at_box if k == 0 else active).T
        if normals.size:
            found.append(float(nnls(normals, -gradient, maxiter=1000)[1]))
        else:
            found.append(float(np.linalg.norm(gradient)))
        fixed = np.vstack([fixed, A])
    return found


def bounded(A: Array, b: Array, lower: Array, upper: Array) -> Array:
    """min |A v - b| in a box, by BVLS."""
    found = lsq_linear(A, b, (lower, upper), method="bvls", tol=1e-14, max_iter=500)
    return np.asarray(found.x, dtype=np.float64)


def primal_norms(p: Problem) -> list[float]:
    """Residual norms of the lexicographic optimum, level by level; box only.

    A level is v + Z y, with Z a basis of what the levels above leave free, inside the box.
    """
    lower, upper = p.bounds.lower, p.bounds.upper
    v, Z, norms = np.clip(np.zeros(lower.size), lower, upper), np.eye(lower.size), []
    for A, b in stack(p, np.zeros(0))[1:]:
        M = A @ Z
        size, largest = np.linalg.norm(A, 2), np.linalg.norm(M, 2) if Z.size else 0.0
        if largest > 1e-10 * size:
            room = np.concatenate([upper - v, v - lower])
            v = v + Z @ inequality(M, b - A @ v, np.vstack([Z, -Z]), room)
            Z = Z @ null_space(M, rcond=1e-10 * float(size / largest))
        norms.append(float(np.linalg.norm(A @ v - b)))
    return norms


def inequality(M: Array, c: Array, G: Array, h: Array) -> Array:
    """min |M y - c| over G y <= h, where y = 0 is inside: the best of several attempts.

    The best that is inside to rounding, if none that is a little outside is better by more than
    that can bring.
    """

    def norm(y: Array) -> float:
        return float(np.linalg.norm(M @ y - c))

    h = np.maximum(h, 0.0)
    size, found = float(np.linalg.norm(M, 2)), [np.zeros(M.shape[1])]
    for share in (1e-3, 1e-2, 1e-4, 1e-1, 1e-5):
        found += least_distance(M, c, G, h, share * size)
        best, inside = (
            min((y for y in found if (G @ y <= h + slack).all()), key=norm)
            for slack in (1e-10, 1e-14)
        )
        if norm(inside) <= norm(best) + 1e-5:
            return inside
    return best


def least_distance(M: Array, c: Array, G: Array, h: Array, eps: float) -> list[Array]:
    """Lawson and Hanson's least-distance programming, and the same to rounding.

    With [M; eps I] = Q R and z = R y - d, the shortest z inside is one non-negative least
    squares. Proximal steps take away what eps does; and what rounding does, the optimum on the
    rows found active, in closed form.
    """
    r = M.shape[1]
    Q, R = np.linalg.qr(np.vstack([M, eps * np.eye(r)]))
    W, last = np.linalg.solve(R.T, G.T), np.eye(r + 1)[-1]
    y, u, room = np.zeros(r), np.zeros(len(h)), np.maximum(h, 0.0) + 1e-11
    for _ in range(100):
        d = Q.T @ np.concatenate([c, eps * y])
        unit = max(1e-3, float(np.linalg.norm(d)))
        E = np.vstack([-W, (d @ W - room) / unit])
        E = E / np.linalg.norm(E, axis=0)
        u, _ = nnls(E, last, maxiter=1000)
        rest = E @ u - last
        if abs(rest[-1]) < 0.1:  # at least a half, but for rounding: z / unit is at most 1
            break
        y, before = np.linalg.solve(R, d - unit * rest[:-1] / rest[-1]), y
        if np.abs(y - before).max() < 1e-10:
            break
    found = [y]
    for share in (0.0, 1e-8, 1e-5):
        active = u > share * u.max()
        free = null_space(G[active]) if active.any() else np.eye(r)
        exact = y + np.linalg.lstsq(G[active], h[active] - G[active] @ y)[0]
        found.append(exact + free @ np.linalg.lstsq(M @ free, c - M @ exact, rcond=1e-9)[0])
    return found


@dataclass(frozen=True)
class Stacked:
    """One level of a damped hierarchy, as plain least squares over what is free.

    Attributes:
        M: (rows, n) the level's rows, those of the speed, those of the damped levels above.
        c: (rows,)
        Z: (n, free) basis of what strict levels above left free.
        v: (n,) the optimum.
    """

    M: Array
    c: Array
    Z: Array
    v: Array


def speed_rows(A: Array, Z: Array, damping: float, above: Array) -> Array:
    """L Z^T, from the singular values s of A Z / d on the rows above: d / (1 + s^2)."""
    if damping == 0.0:
        return np.zeros((0, len(Z)))
    _, s, Vt = np.linalg.svd(np.vstack([A / damping, above]) @ Z)
    s = np.concatenate([s, np.zeros(len(Vt) - len(s))])
    return np.asarray((Vt.T * (damping / (1.0 + s**2))) @ Vt @ Z.T)


def damped_levels(p: Problem, guarded: int) -> list[Stacked]:
    """Every level of a damped hierarchy, and the rest.

    Without bounds, where the answer keeps the box; otherwise inside it.
    """
    n = p.bounds.lower.size
    free = one_by_one(Problem(p.levels, Bounds(np.full(n, -np.inf), np.full(n, np.inf))), guarded)
    inside = (free[-1].v <= p.bounds.upper + 1e-12) & (free[-1].v >= p.bounds.lower - 1e-12)
    return free if inside.all() else one_by_one(p, guarded, free)


def one_by_one(p: Problem, guarded: int, free: list[Stacked] | None = None) -> list[Stacked]:
    """Every level of a damped hierarchy in a box, and the rest, solved one after the other.

    ``free`` are the levels without a box, from which those in one start.
    """
    lower, upper = np.array(p.bounds.lower), np.array(p.bounds.upper)
    crossed = lower > upper
    lower[crossed] = upper[crossed] = 0.5 * (lower[crossed] + upper[crossed])
    n, exchange, found = lower.size, constant("EXCHANGE"), list[Stacked]()
    v, Z = np.clip(np.zeros(n), lower, upper), np.eye(n)[:, lower < upper]
    H, h, shift = np.zeros((0, n)), np.zeros(0), np.zeros(0)
    strict, above, aims = np.zeros((0, n)), list[Level](), list[Array]()

    def solved(*rows: tuple[Array, Array]) -> Stacked:
        M, c = np.vstack([A for A, _ in rows]), np.concatenate([b for _, b in rows])
        best, moves = np.array(v), lower < upper
        if Z.size and Z.shape[1] == moves.sum():  # nothing but the box
            rest = c - M[:, ~moves] @ v[~moves]
            best[moves] = bounded(M[:, moves], rest, lower[moves], upper[moves])
        elif Z.size and np.linalg.norm(M @ Z) > 0.0:
            room = np.concatenate([upper - v, v - lower])
            if np.isinf(room).all():
                y = np.linalg.lstsq(M @ Z, c - M @ v)[0]
            else:
                y = proved(M @ Z, c - M @ v, np.vstack([Z, -Z]), room)
            best = v + Z @ y
        return Stacked(M, c, Z, best)

    def unserved(asked: list[Array], at: Array) -> float:
        """How far v is from what the damped levels above ask for, over their damping."""
        missing = [(x.A @ at - b) / x.damping for x, b in zip(above, asked, strict=True)]
        return float(np.linalg.norm(np.concatenate([np.zeros(1), *missing])))

    def wished(level: Level, at: Array) -> Array:
        """b, less where the damped levels above are not served."""
        left = unserved([x.b for x in above], at)
        return np.asarray(level.b / (1.0 + left / constant("GIVES_WAY")))

    def held_back(by: float) -> float:
        return max(by - constant("KEPT_FROM"), 0.0) / constant("HELD_BACK")

    for k, level in enumerate((*p.levels, Level(np.eye(n), np.zeros(n)))):
        d, still = level.damping, np.zeros(n if level.damping else 0)
        if d == 0.0:
            change = free[k - 1].v - free[-1].v if free and k else np.zeros(n)
            b = level.b if k < guarded else wished(level, v + change)
            one = solved((level.A, b), (H, h + shift))
            left = float(np.linalg.norm(level.A @ one.v - level.b))
            if k < guarded and left > constant("REACHED_TOL"):
                d = constant("UNREACHED_DAMPING") * left / (left + constant("UNREACHED"))
                speed = speed_rows(level.A, Z, d, H[:0])
                one = solved((level.A, level.b), (speed, np.zeros(len(speed))), (H, h))
            strict = np.vstack([strict, level.A])
        elif free is None:
            speed = speed_rows(level.A, Z, d, exchange * H)
            one = solved((level.A, level.b), (speed, still[: len(speed)]), (H, h))
        else:
            start = free[-1].v
            out = float(np.linalg.norm(start - np.clip(start, lower, upper)))
            x, aim = 0.0, level.A @ start
            for _ in range(2 if p.sluggish else 1):
                held = speed_rows(level.A, Z, d * math.sqrt(x), exchange * H)
                rows = np.vstack([d * Z.T, held])
                one = Stacked(Z.T, still, Z, start / (1.0 + out / constant("FAR_OUT")))
                for _ in range(int(constant("PROXIMAL"))):
                    one = solved((level.A, aim), (rows, rows @ one.v), (H, h))
                x = held_back(float(np.linalg.norm(level.A @ one.v - aim)) / d)
                if not x > 0.0:
                    break
                aim = level.A @ start / (1.0 + held_back(unserved(aims, v)) * x / (1.0 + x))
        found.append(one)
        v = one.v
        if level.damping > 0.0:
            rows = level.A / (exchange * d)
            H, h = np.vstack([H, rows]), np.concatenate([h, rows @ v])
            moved = free[k].v - free[-1].v if free else np.zeros(n)
            shift = np.concatenate([shift, rows @ moved])
            if k >= guarded:
                above.append(level)
                aims.append(level.b if free is None else aim)
        else:
            Z = nothing_of(strict, lower < upper)
    return found


def nothing_of(rows: Array, movable: NDArray[np.bool_]) -> Array:
    """Orthonormal basis of what changes no row; joints that are in no row stand alone in it."""
    count = rows.shape[1]
    used = movable & (np.abs(rows).max(axis=0, initial=0.0) > constant("RESOLUTION"))
    Z = np.eye(count)[:, movable & ~used]
    largest = float(np.linalg.norm(rows[:, used], 2)) if used.any() else 0.0
    if largest == 0.0:
        return Z
    inner = null_space(rows[:, used], rcond=constant("RESOLUTION") / largest)
    return np.hstack([np.eye(count)[:, used] @ inner, Z])


def proved(M: Array, c: Array, G: Array, h: Array) -> Array:
    """min |M y - c| over G y <= h, where y = 0 is inside: the attempt with the best proof.

    Heavy rows hide a wrong active set from the proof; so rows are taken in and out, one at a time,
    as long as that makes |M y - c| smaller.
    """
    h, size = np.maximum(h, 0.0), float(np.linalg.norm(M, 2))
    found = [np.zeros(M.shape[1]), inequality(M, c, G, h)]
    for share in (1e-4, 1e-6, 1e-8):
        found += least_distance(M, c, G, h, share * size)
    inside = [y for y in found if (G @ y <= h + 1e-11).all()]
    best = min(inside, key=lambda y: gap(M, M @ y - c, G[G @ y >= h - AT_BOUND]))
    active = G @ best >= h - AT_BOUND
    for _ in range(len(h)):
        others = [active ^ (np.arange(len(h)) == i) for i in range(len(h))]
        made = [(on_rows(M, c, G[other], h[other]), other) for other in others]
        fits = [(y, other) for y, other in made if (G @ y <= h + 1e-11).all()]
        if not fits:
            break
        y, other = min(fits, key=lambda pair: float(np.linalg.norm(M @ pair[0] - c)))
        if not np.linalg.norm(M @ y - c) < np.linalg.norm(M @ best - c):
            break
        best, active = y, other
    return best


def on_rows(M: Array, c: Array, G: Array, h: Array) -> Array:
    """min |M y - c| over G y = h, least squares of those that cannot all hold."""
    if not len(G):
        return np.asarray(np.linalg.lstsq(M, c, rcond=1e-12)[0])
    at, free = np.linalg.lstsq(G, h)[0], null_space(G)
    return np.asarray(at + free @ np.linalg.lstsq(M @ free, c - M @ at, rcond=1e-12)[0])


def gap(M: Array, residual: Array, normals: Array) -> float:
    """How far the best multipliers are from balancing the gradient, over the size of M."""
    gradient = M.T @ residual / max(1.0, float(np.linalg.norm(M, 2)))
    if not normals.size:
        return float(np.linalg.norm(gradient))
    return float(nnls(normals.T, -gradient, maxiter=1000)[1])


def unproved(level: Stacked, v: Array, lower: Array, upper: Array) -> float:
    """How far the best multipliers are from proving v optimal for a level of a box."""
    n = v.size
    at_box = [np.eye(n)[v >= upper - AT_BOUND], -np.eye(n)[v <= lower + AT_BOUND]]
    return gap(level.M @ level.Z, level.M @ v - level.c, np.vstack(at_box) @ level.Z)
