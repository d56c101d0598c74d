"""A quadratic program, its solution, and residuals that trust nobody's flag."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.errors import InvalidProblem, WrongShape
from rcmqp.maths.dualquaternion import Array


class Status(enum.Enum):
    """A backend's own verdict on a QP; check it with kkt_residuals()."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    STOPPED = "stopped"
    """Iterations ran out, numbers overflowed, or the backend raised: see the message."""


def checked(value: ArrayLike, shape: tuple[int, ...], name: str, infinite: float = 0.0) -> Array:
    """A read-only float copy of ``value``, checked at the door.

    Args:
        value: anything numpy reads as numbers.
        shape: the shape wanted; -1 stands for any length.
        name: what to call it in the message.
        infinite: the one infinity that is allowed (its sign counts), 0 for none.

    Raises:
        WrongShape: it is not numbers, or has another shape.
        InvalidProblem: a NaN, or an infinity that is not allowed.
    """
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise WrongShape(f"{name} is not an array of numbers: {error}") from error
    if array.ndim != len(shape) or any(
        n not in (-1, m) for n, m in zip(shape, array.shape, strict=True)
    ):
        wanted = str(shape).replace("-1", "any")
        raise WrongShape(f"{name} has shape {array.shape}, expected {wanted}")
    if not np.isfinite(array).all():
        bad = ~(np.isfinite(array) | (array == infinite if infinite else False))
        if bad.any():
            at = tuple(int(i) for i in np.argwhere(bad)[0])
            allowed = f"finite or {infinite}" if infinite else "finite"
            raise InvalidProblem(f"{name}{list(at)} is {array[at]}; it must be {allowed}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True, eq=False)
class QP:
    """min 1/2 v^T H v + g^T v  subject to  A v = b,  C v <= d,  lb <= v <= ub.

    Attributes:
        H: (n, n) symmetric, positive semidefinite.
        g: (n,).
        A: (n_eq, n), n_eq = 0 for no equalities.
        b: (n_eq,).
        C: (n_in, n), n_in = 0 for no inequalities.
        d: (n_in,); inf switches a row off.
        lb: (n,), -inf for none.
        ub: (n,), inf for none.
    """

    H: Array
    g: Array
    A: Array
    b: Array
    C: Array
    d: Array
    lb: Array
    ub: Array

    @classmethod
    def build(
        cls,
        H: ArrayLike,
        g: ArrayLike,
        A: ArrayLike | None = None,
        b: ArrayLike | None = None,
        C: ArrayLike | None = None,
        d: ArrayLike | None = None,
        lb: ArrayLike | None = None,
        ub: ArrayLike | None = None,
    ) -> QP:
        """A checked QP from anything array-like; what is left out does not constrain.

        Raises:
            WrongShape: shapes differ.
            InvalidProblem: a NaN, or an infinity where none is allowed.
        """
        g = checked(g, (-1,), "g")
        n = g.size
        A = np.zeros((0, n)) if A is None else checked(A, (-1, n), "A")
        C = np.zeros((0, n)) if C is None else checked(C, (-1, n), "C")
        return cls(
            checked(H, (n, n), "H"),
            g,
            A,
            checked(np.zeros(0) if b is None else b, (len(A),), "b"),
            C,
            checked(np.zeros(0) if d is None else d, (len(C),), "d", np.inf),
            checked(np.full(n, -np.inf) if lb is None else lb, (n,), "lb", -np.inf),
            checked(np.full(n, np.inf) if ub is None else ub, (n,), "ub", np.inf),
        )


@dataclass(frozen=True, slots=True, eq=False)
class QPSolution:
    """A backend's answer to a QP.

    The multipliers make H v + g + A^T y + C^T z + z_box = 0 at an optimum.

    Attributes:
        v: (n,) the minimiser; NaN where the backend has none.
        y: (n_eq,) multipliers of the equalities.
        z: (n_in,) multipliers of the inequalities, at least zero.
        z_box: (n,) multipliers of the box: positive at ub, negative at lb.
        status: the backend's own verdict.
        solve_time: wall-clock time of the call [s]; not reproducible, everything else is.
        message: what the backend said, where it did not solve.
    """

    v: Array
    y: Array
    z: Array
    z_box: Array
    status: Status
    solve_time: float
    message: str = ""

    @classmethod
    def failed(cls, qp: QP, status: Status, solve_time: float, message: str) -> QPSolution:
        """An answer without numbers, so that nobody takes a stale vector for one."""
        nan = [np.full(k, np.nan) for k in (qp.g.size, qp.b.size, qp.d.size, qp.g.size)]
        return cls(nan[0], nan[1], nan[2], nan[3], status, solve_time, message)


@dataclass(frozen=True, slots=True)
class KKTResiduals:
    """How far a point and its multipliers are from the optimality conditions.

    Attributes:
        primal: largest violation of an equality, inequality or bound.
        dual: largest component of H v + g + A^T y + C^T z + z_box, or multiplier of the wrong
            sign.
        complementarity: largest product of a multiplier and its slack.
    """

    primal: float
    dual: float
    complementarity: float

    def max(self) -> float:
        """The worst of the three; inf if a number is not finite."""
        worst = max(self.primal, self.dual, self.complementarity)
        return worst if np.isfinite(worst) else np.inf


class QPSolver(Protocol):
    """Anything that solves a QP; it may keep a warm start between calls."""

    def solve(self, qp: QP) -> QPSolution:
        """Answer ``qp``; a failure is a status, never an exception."""
        ...

    def reset(self) -> None:
        """Forget earlier calls: the next answers are those of a new solver, bit by bit."""
        ...


def kkt_residuals(qp: QP, solution: QPSolution) -> KKTResiduals:
    """Residuals of the optimality conditions, from the problem and the numbers alone."""
    v, y, z, z_box = solution.v, solution.y, solution.z, solution.z_box
    if not all(np.isfinite(x).all() for x in (v, y, z, z_box)):
        return KKTResiduals(np.inf, np.inf, np.inf)
    slack = np.concatenate([qp.d - qp.C @ v, qp.ub - v, v - qp.lb])
    multiplier = np.concatenate([z, np.maximum(z_box, 0.0), np.maximum(-z_box, 0.0)])
    gradient = qp.H @ v + qp.g + qp.A.T @ y + qp.C.T @ z + z_box
    off = np.isinf(slack)  # a bound at infinity must have no multiplier
    product = np.where(off, 0.0, multiplier) * np.where(off, 0.0, slack)

    def worst(*parts: Array) -> float:
        return max((float(part.max()) for part in parts if part.size), default=0.0)

    return KKTResiduals(
        primal=max(0.0, worst(np.abs(qp.A @ v - qp.b), -slack)),
        dual=max(0.0, worst(np.abs(gradient), -multiplier, np.abs(multiplier[off]))),
        complementarity=worst(np.abs(product)),
    )
