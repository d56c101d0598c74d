"""The shaft parameter lambda as one more joint: Aghakhani et al. 2013."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from rcmqp._kernel import Block
from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import at_rest, bounded_gain
from rcmqp.controllers.pseudoinverse import Levels, in_order, inverse
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import between
from rcmqp.references.view import Reference, cycle
from rcmqp.tasks import TipTask
from rcmqp.world.arm import ArmState


class ShaftParameter:
    """The state of the law.

    Attributes:
        value: lambda at the next step; None if that step starts from the projection.
    """

    __slots__ = ("value",)

    def __init__(self) -> None:
        self.value: float | None = None


@dataclass(frozen=True, eq=False)
class Aghakhani(Controller):
    """RCM and tip at the same priority; where the trocar is on the shaft is an unknown, too.

    N. Aghakhani, M. Geravand, N. Shahriari, M. Vendittelli and G. Oriolo, "Task control with
    remote center of motion constraint for minimally invasive robotic surgery", ICRA 2013. With
    p_i and p_i+1 the two ends of the link that goes through the trocar,

        p_rcm = p_i + lambda (p_i+1 - p_i),
        J_rcm = [J_i + lambda (J_i+1 - J_i),  p_i+1 - p_i]                 3 x (n + 1),
        [theta_dot; lambda_dot] = J^+ [K_t (p_tip,d - p_tip); K_rcm (p_trocar - p_rcm)]
                                  + (I - J^+ J) w,   J = [J_t 0; J_rcm].

    Here the link is the shaft: p_i where it begins, p_i+1 its tip.

    lambda is a state. It starts where the trocar projects on the shaft at the first step after
    reset(), lambda = (p_trocar - p_i)^T (p_i+1 - p_i) / |p_i+1 - p_i|^2, and is then integrated
    with the period T: a step depends on this state as others depend on a solver's warm start,
    and a loop that skips cycles should call reset().

    Read: the paper's abstract and introduction; RViMLab/rcm, a code of others after its equations
    1, 3, 6 and 7. That code has K_t = 1, K_rcm = 100, 10 ms, an inverse damped with 0.01, and
    lambda starting at 0.5. Two slips of it are not copied: w is not set to zero before its last
    entry is, and the integral of the error lacks the period.

    Not read: the rest of the paper, with its numbers.

    Chosen here: one gain for both, that of all controllers; a truncated inverse; lambda's start;
    w = [0; lambda_gain (lambda_rest - lambda)]. Tip and RCM together fix the depth, and so
    lambda_dot: where J has its full rank 6, w moves lambda not at all, and only turns the arm
    about what is free; it comes into its own where J loses rank.

    Departures: ``rcm_first`` and ``reproject`` are not in the paper (both are in RViMLab/rcm,
    whose RCM-first mode projects J_t^+ instead of inverting J_t P).
    ``feed_forward`` is off, as in the other controllers, though implementations of the paper
    have such a term for the task.

    Attributes:
        gain: K_t of the tip [1/s].
        rcm_gain: K_rcm [1/s].
        lambda_gain: how hard w pulls lambda [1/s]; 0 for not at all.
        lambda_rest: where to: 0 is where the shaft begins, 1 the tip.
        tolerance: relative cut-off of J^+.
        rcm_first: the RCM's rows first and the tip in their nullspace.
        reproject: start every step from the projection, so that lambda is not a state.
        feed_forward: know the velocities of the reference and of the trocar.
    """

    name: ClassVar[str] = "aghakhani"
    enforces: ClassVar[tuple[str, ...] | None] = ()
    holds_roll: ClassVar[bool | None] = False

    gain: float = field(default=60.0, metadata=bounded_gain())
    rcm_gain: float = field(default=60.0, metadata=bounded_gain())
    lambda_gain: float = field(default=0.0, metadata=bounded_gain(or_zero=True))
    lambda_rest: float = field(default=0.5, metadata=between(0.0, 1.0))
    tolerance: float = field(default=1e-3, metadata=between(0.0, 1.0))
    rcm_first: bool = False
    reproject: bool = False
    feed_forward: bool = False

    @functools.cached_property
    def _lambda(self) -> ShaftParameter:
        return ShaftParameter()

    @functools.cached_property
    def _tip(self) -> TipTask:
        return TipTask()

    @functools.cached_property
    def _at_trocar(self) -> Block:
        return Block("at_trocar")

    @functools.cached_property
    def _inverse(self) -> Array:
        return inverse(self.tolerance)

    def reset(self) -> None:
        """Forget lambda; the next step starts it from the projection."""
        self._lambda.value = None

    def safe_stop(self, *args: Any, **kwargs: Any) -> Command:
        """See Controller.safe_stop(); lambda then starts anew, from the projection."""
        self.reset()
        return super().safe_stop(*args, **kwargs)

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """One evaluation of the law."""
        reference = reference if self.feed_forward else at_rest(reference)
        length, tip = self.insertion.instrument.length, state.tool_at[0]
        first, z, lam = tip - length, state.oMe.rotation[:, 2], self._lambda.value
        if self.reproject or lam is None:
            lam = (float((reference.pivot - state.oMe.translation) @ z) - first) / length
        known, at = cycle(state, reference), (first + lam * length,)
        J_t, b_t = self._tip.block.goal(*known, self.gain)
        J_i, b_rcm = self._at_trocar.goal(*known[:-1], at, self.rcm_gain)
        n = state.angles.size
        J, w = np.zeros((6, n + 1)), np.zeros(n + 1)
        J[:3, :n], J[3:, :n], J[3:, n] = J_t, J_i, length * z
        w[n] = self.lambda_gain * (self.lambda_rest - lam)
        if self.rcm_first:
            levels: Levels = (J[3:], b_rcm), (J[:3], b_t)
        else:
            levels = ((J, np.concatenate([b_t, b_rcm])),)
        u, least = in_order(levels, self._inverse, w)
        self._lambda.value = lam + self.period * float(u[-1])
        return Command.of(u[:-1].copy(), {"lambda": lam, "least_singular_value": least})
