"""The paper's path planner: from where the effector is to a far view, always through the RCM.

Section III-C. Every pose that obeys the RCM is x_rcm r (1 + eps t_z k / 2): a rotation about
the trocar, then a translation along the shaft. The planner brings the starting pose x_l into that
form, (7)-(8): it keeps the rotation, r_l = P(x_rcm* x_l), and of translation((x_rcm r_l)* x_l) the
part t_l along the shaft; the trocar's two offsets from the shaft are dropped. Then it moves
rotation and depth in N + 1 equal parts:

    r_inc = exp(log(r_l* r_d) / (N + 1)),   t_inc = (t_d - t_l) / (N + 1)      (9), (10)
    c(m)  = r_l r_inc^m (1 + eps (t_l + m t_inc) k / 2),   m = 0 .. N + 1      (11)

Mended: for (x_rcm r_l)* x_l the paper prints x_rcm^l, which gives another vector; for c(m) it
prints c(i); t_inc, printed as a power, is multiplied by m; m runs from 0, the start, not 1. The
sign of r_d is chosen so that the turn is the short way round.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import allowed, whole
from rcmqp.references.view import Reference

FAR_ANGLE = 0.01
"""A reference that turns further than this from the last one is planned [rad]."""

FAR_DEPTH = 1e-3
"""A reference that goes in or out further than this is planned [m]."""


class Part(NamedTuple):
    """One part of the way to a reference.

    Attributes:
        x: (8,) where it ends, as seen from the trocar.
        target: (8,) where the way leads, likewise.
        left: parts that follow.
        x_d: (8,) where it ends, in the world.
        x_d_dot: (8,) derivative of x_d.
        moved: whether x_d is another pose than the reference's.
    """

    x: Array
    target: Array
    left: int
    x_d: Array
    x_d_dot: Array
    moved: bool


class Planner:
    """Feeds a far reference to the controller in N + 1 equal parts, one for each cycle.

    A reference near the last one passes through. A far one is approached in equal parts from
    the last reference, so that no tracking error runs back into the reference; or, as the paper
    has it, from the measured pose, where step() is given that. While a target moves a little
    each cycle, what remains is divided anew; a target that stands still is reached in equal
    parts, after N + 1 cycles; one that jumps is approached in N + 1 parts from where the
    reference is, or the measured pose.

    All of it is planned as seen from the trocar, in axes parallel to the world's: a trocar that
    moves carries the plan along, and however far it goes, that alone makes no reference far.
    """

    def __init__(self, x_rcm: ArrayLike, points: int, period: float) -> None:
        """Start at x_rcm (8,), with ``points`` = N and one part every ``period`` [s]."""
        self.points, self.period = allowed("points", points, whole(1)), period
        self.x_rcm = dq.check_unit(x_rcm, "x_rcm")
        self._pivot = dq.translation(self.x_rcm)
        self.reset()

    def reset(self) -> None:
        """Forget the last reference: the next one is approached from x_rcm."""
        self._x, self._target, self._left = self.x_rcm, self.x_rcm, 0

    def step(self, reference: Reference, x: ArrayLike | None = None) -> Reference:
        """The reference of this cycle, on the way to ``reference``.

        Where a plan begins in this cycle and ``x`` is given, it begins at ``x``, the measured
        pose (8,) of the effector, brought to the nearest one that obeys the RCM. If ``x`` is not
        finite, it begins at the last reference.

        Its derivative is the velocity of the part that follows: zero at the last one. A reference
        that is not a pose or not finite, such as that of a trocar that was not seen, is returned
        unchanged, so that the controller stops; the next one continues from where the last was.
        """
        part = self._approach(reference, self._x)
        begins = part.moved and part.left == self.points
        if begins and x is not None and np.isfinite(x := np.asarray(x, dtype=float)).all():
            carried_back = dq.from_translation(self._pivot - reference.pivot)
            part = self._approach(reference, dq.mul(carried_back, x))
        self._x, self._target, self._left = part.x, part.target, part.left
        if not part.moved:
            return reference
        rest = reference.pivot, reference.pivot_dot
        return _kernel.record(Reference, part.x_d, part.x_d_dot, *rest)

    def _approach(self, reference: Reference, x: Array) -> Part:
        """One part of the way from x (8,), as seen from the trocar; see step()."""
        return Part(
            *_kernel.approach(
                self.x_rcm,
                self._pivot,
                x,
                self._target,
                self._left,
                self.points + 1,
                self.period,
                reference.x_d,
                reference.pivot,
                reference.pivot_dot,
                FAR_ANGLE,
                FAR_DEPTH,
            )
        )
