"""The law that the paper improves upon: equation (2), on the difference of two poses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import at_rest, bounded_gain
from rcmqp.controllers.pseudoinverse import SingularValues
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.options import between
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class PoseError(Controller):
    """The whole pose by the difference of two dual quaternions.

    H.-L. Pham, V. Perdereau, B. V. Adorno and P. Fraisse, "Position and orientation control of
    robot manipulators using dual quaternion feedback", IROS 2010, pp. 658-663; equation (2) of
    Marinho, Bernardes and Bo:

        theta_dot = K J^+ vec(x_d - x_eff),   vec(x_eff)' = J theta_dot         (2)

    Mended: (2) is printed with x_eff - x_d, which runs away from x_d.

    Read: equation (2) in Marinho, Bernardes and Bo; Marinho's early code of it (dqrobotics/cpp,
    OrdinaryPoseController), which has this sign and a damped inverse.

    Not read: the paper of 2010.

    Chosen here: the inverse and every number. J is 8 x n of rank 6 at the most, so J^+ keeps at
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

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """One evaluation of the law."""
        reference = reference if self.feed_forward else at_rest(reference)
        side = -1.0 if dq.P(state.x) @ dq.P(reference.x_d) < 0.0 else 1.0
        wanted = self.gain * (side * reference.x_d - state.x) + side * reference.x_d_dot
        svd = SingularValues.of(state.J_dq, rank=6)
        v = svd.solve(svd.truncated(svd.kept(self.tolerance)), wanted)
        return Command(v, {"least_singular_value": float(svd.s[-1])})
