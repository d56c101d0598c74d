"""Two laws on the error of the pose: the one that the paper improves upon, and a damped one."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import ClassVar

from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import at_rest, bounded_gain
from rcmqp.controllers.pseudoinverse import in_order, inverse
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import between, positive
from rcmqp.references.view import Reference, cycle
from rcmqp.tasks import PoseTask
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class PoseError(Controller):
    """The law that the paper improves upon: the difference of two dual quaternions (Pham 2010).

    H.-L. Pham, V. Perdereau, B. V. Adorno and P. Fraisse, "Position and orientation control of
    robot manipulators using dual quaternion feedback", IROS 2010, pp. 658-663; equation (2) of
    Marinho, Bernardes and Bo:

        theta_dot = K J^+ vec(x_d - x_eff),   vec(x_eff)' = J theta_dot         (2)

    Mended: (2) is printed with x_eff - x_d, which runs away from x_d.

    Read: equation (2) in Marinho, Bernardes and Bo; Marinho's early code of it (dqrobotics/cpp,
    OrdinaryPoseController), which has this sign and a damped inverse.

    Not read: the paper of 2010.

    Chosen here: the inverse and every number. J is 8 x n of rank 6 at most, so J^+ keeps at
    most six singular values, those above ``tolerance`` times the largest, as in the paper's own
    controller.

    Departures: of x_d and -x_d, one pose, the one on x_eff's side is taken. The difference is
    not invariant: the dual parts are measured from the world's origin, so J's singular values,
    and which direction is given up near a singularity, depend on where that is.

    Attributes:
        gain: K [1/s].
        tolerance: relative cut-off of J^+.
        feed_forward: add vec(x_d'), which takes the lag of speed / K away; not in the papers.
    """

    name: ClassVar[str] = "pose_error"
    enforces: ClassVar[tuple[str, ...] | None] = ()
    holds_roll: ClassVar[bool | None] = True

    gain: float = field(default=60.0, metadata=bounded_gain())
    tolerance: float = field(default=1e-3, metadata=between(0.0, 1.0))
    feed_forward: bool = False

    @functools.cached_property
    def _inverse(self) -> Array:
        return inverse(self.tolerance)

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """One evaluation of the law."""
        x_d, x_d_dot = reference.x_d, reference.x_d_dot
        if state.x[:4] @ x_d[:4] < 0.0:
            x_d, x_d_dot = -x_d, -x_d_dot
        wanted = self.gain * (x_d - state.x)
        if self.feed_forward:
            wanted += x_d_dot
        v, least = in_order(((state.J_dq, wanted),), self._inverse)
        return Command.of(v, {"least_singular_value": least})


@dataclass(frozen=True, eq=False)
class Damped(Controller):
    """The paper's error (3) by damped least squares, always on (Chiaverini 1997).

    S. Chiaverini, "Singularity-robust task-priority redundancy resolution for real-time
    kinematic control of robot manipulators", IEEE Trans. Robotics and Automation 13(3), 1997,
    pp. 398-410: variable damping with numerical filtering, which damps the direction of the
    least singular value and leaves the others nearly alone:

        theta_dot = N* K e,   N* = N^T (N N^T + beta^2 I + lambda^2 u_6 u_6^T)^-1
                                 = sum_(i < 6) s_i / (s_i^2 + beta^2) v_i u_i^T
                                   + s_6 / (s_6^2 + beta^2 + lambda^2) v_6 u_6^T,
        lambda^2 = lambda_max^2 (1 - (s_6 / epsilon)^2) where s_6 < epsilon, else 0.

    With e = vec(1 - x_eff* x_d) and N of equation (3). Nothing is truncated but the two
    singular values that a matrix of rank 6 does not have. Neither is there a nullspace term:
    with a damped inverse I - N* N is not a projector.

    Read: Marinho's own early code (dqrobotics/cpp, DampedNumericalFilteredController, 2012 and
    2013), which has this matrix on J and on the difference of the poses, equation (2); an example
    of it with lambda_max 0.01, beta 0.01, epsilon 0.001 and a gain of 0.8 a step. Two slips of
    it are not copied: epsilon is never stored, and lambda^2 is squared once more. His code of
    2022 damps every singular value below epsilon.

    Not read: Chiaverini's paper.

    Chosen here: the invariant error (3), as in the paper's own law, and the three numbers. With
    lambda_max at least epsilon / sqrt(2), no multiple of e's component along u_6 is above
    1 / epsilon; two small singular values at once are held by beta alone, at 1 / (2 beta). beta
    is not the example's 0.01, which slows directions down unevenly: 0.058 mm in place of 0.003
    at the trocar on ``fast_helix``.

    Departures: s_6 and u_6 are those of this cycle's singular value decomposition; the 1990s
    estimated them recursively to save time.

    Attributes:
        gain: K [1/s].
        lambda_max: largest damping of the least singular value; of N, whose singular values are
            half of those of the effector's geometric Jacobian.
        epsilon: size of the singular region: damping begins where s_6 is below.
        beta: damping of all directions, everywhere.
        feed_forward: add -vec(x_eff* x_d') to K e; not in the papers.
    """

    name: ClassVar[str] = "damped"
    enforces: ClassVar[tuple[str, ...] | None] = ()
    holds_roll: ClassVar[bool | None] = True

    gain: float = field(default=60.0, metadata=bounded_gain())
    lambda_max: float = field(default=0.05, metadata=positive())
    epsilon: float = field(default=0.02, metadata=positive())
    beta: float = field(default=1e-3, metadata=positive())
    feed_forward: bool = False

    @functools.cached_property
    def _pose(self) -> PoseTask:
        return PoseTask()

    @functools.cached_property
    def _inverse(self) -> Array:
        return inverse(beta=self.beta, lambda_max=self.lambda_max, epsilon=self.epsilon)

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """One evaluation of the law."""
        reference = reference if self.feed_forward else at_rest(reference)
        level = self._pose.block.goal(*cycle(state, reference), self.gain)  # -N v = -K e
        v, least = in_order((level,), self._inverse)
        return Command.of(v, {"least_singular_value": least})
