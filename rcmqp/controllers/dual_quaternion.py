"""The paper's controller: Marinho, Bernardes and Bo's dual-quaternion law, equation (6)."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rcmqp import _kernel
from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import bounded_gain
from rcmqp.controllers.given import Given
from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import at_least, between, finite, one_of, positive
from rcmqp.references.view import Reference
from rcmqp.tasks.base import block_of
from rcmqp.tasks.objectives import Objective, make_objective, own_objective
from rcmqp.world.arm import ArmState

VELOCITY_LIMITS = ("none", "scale", "clip")
RANK_TOLERANCE = 1e-12
"""Share of s_1 above which a direction of N is real, and no nullspace, if N^+ gives it up too."""


class Compiled(NamedTuple):
    """What compiled code needs besides state and reference.

    Attributes:
        objective: its compiled form; None where only Python knows it.
        numbers: (7,) the options and RANK_TOLERANCE, in the order that the kernel reads.
        speeds: (nv,) speed limits of the joints [rad/s].
        velocity_limit: index of the option in VELOCITY_LIMITS.
    """

    objective: _kernel.Block | None
    numbers: Array
    speeds: Array
    velocity_limit: int


@dataclass(frozen=True, eq=False)
class DualQuaternion(Controller):
    """RCM and camera at one priority, through references that obey the RCM.

        e     = vec(1 - x_eff* x_d),   N = H-(x_d) C_8 J                    (3)
        theta_dot = K N^+ e + P K_c J_c^T (c_d - c(theta)),  P = I - N^+ N  (4), (6)

    and theta(k+1) = theta(k) + T theta_dot, which is the plant's part.

    Mended, where the paper as printed does not work: the sampling period T, missing in (6),
    multiplies the whole step (K T = 60 would diverge in three steps); P is n x n, so N^+ N and
    not N N^+; J_c is a row and is transposed; (c - c_d) would run away from c_d and is turned
    round; of x_d and -x_d, one pose, the one on x_eff's side is taken, also in N, or the arm
    would unwind the long way.

    Read: the paper, as a transcript, with K, K_c and c_d. Not given there: the sampling period,
    c(theta) and the inverse's cut-off, which are chosen here.

    N is 8 x n and has rank 6 at most: N^+ keeps at most six singular values, those above
    ``tolerance`` times the largest. Its singular values are half of those of the effector's
    geometric Jacobian.

    Departures: c(theta) is SingularityProduct (see there) on arms of that kind and
    manipulability on others, where ``objective`` is not given. All options from ``feed_forward``
    on are extensions, off by default.

    Attributes:
        gain: K [1/s]; the paper's 60. K T must be below 2, and below 1 for no overshoot.
        K_c: gain of the objective [1/s times the inverse of c's gradient squared]; the
            paper's 7. 0 leaves the nullspace alone.
        c_d: desired value of the objective; the paper's 1.
        objective: singularity_product, manipulability, least_singular_value or joint_centring;
            empty for the arm's own, as above; ``options`` has its name.
        tolerance: relative cut-off of N^+: a direction whose singular value is below
            ``tolerance`` times the largest is given up. It keeps numbers finite and no more: the
            pose error's share of v stays below K |e| / (tolerance s_1), which no arm can follow
            near a singularity. A larger one is not a remedy: the direction's error grows while it
            is given up, and is then answered at once.
        feed_forward: add -vec(x_eff* x_d') to K e, which takes the lag of speed / K away.
        damping: largest lambda in N^+ = V diag(s / (s^2 + lambda^2)) U^T, with lambda^2 =
            damping^2 (1 - (s_6 / damping_from)^2) where the least singular value s_6 of N is
            below ``damping_from``, else 0: a variable damping of the kind that the paper's [15]
            (Chiaverini 1997) sums up.
        damping_from: see ``damping``.
        velocity_limit: what to do above the joints' speed limits: ``none``; ``scale`` the whole
            velocity, which keeps its direction; ``clip`` each joint, which does not, and lets
            the RCM go.
    """

    name: ClassVar[str] = "dual_quaternion"
    enforces: ClassVar[tuple[str, ...] | None] = ()
    holds_roll: ClassVar[bool | None] = True
    remark: ClassVar[str] = (
        "the objective of the redundant joints starts at full gain in the first cycle. On a slow "
        "path from rest this is its largest acceleration and jerk; K_c=0 leaves it out."
    )
    diagnostics: ClassVar[Mapping[str, tuple[str, str]]] = {
        "objective": ("1", "value of the objective c(theta)"),
        "sigma_6_of_N": ("m, rad", "sixth singular value of N: about half of singular_value"),
        "rank": ("1", "singular values of N that N^+ keeps, six away from singularities"),
        "scale": ("1", "share of the wished speed that velocity_limit left"),
    }

    gain: float = field(default=60.0, metadata=bounded_gain())
    K_c: float = field(default=7.0, metadata=at_least(0.0))
    c_d: float = field(default=1.0, metadata=finite())
    objective: str = ""
    tolerance: float = field(default=1e-7, metadata=between(0.0, 1.0))
    feed_forward: bool = False
    damping: float = field(default=0.0, metadata=at_least(0.0))
    damping_from: float = field(default=0.02, metadata=positive())
    velocity_limit: str = field(default="none", metadata=one_of("velocity_limit", VELOCITY_LIMITS))

    def __post_init__(self) -> None:
        """Check the options and the arm, and make the objective.

        Raises:
            OptionError: an option's value is not allowed.
            UnknownName: there is no such objective.
        """
        super().__post_init__()
        arm = self.insertion.arm
        if arm.nv < 6:
            raise OptionError(
                f"{arm.name} has {arm.nv} joints; {self.name} controls position and orientation "
                "at one priority and needs six or more; hierarchical_qp does with fewer"
            )
        _ = self._objective, self._compiled  # made before the first cycle

    @property
    def options(self) -> dict[str, Any]:
        """The options; the default objective is the arm's own."""
        return super().options | {"objective": self._objective_name}

    @property
    def _objective_name(self) -> str:
        return self.objective or own_objective(self.insertion.arm)

    @functools.cached_property
    def _objective(self) -> Objective:
        return make_objective(self._objective_name, self.insertion.arm)

    @functools.cached_property
    def _compiled(self) -> Compiled:
        options = (self.gain, self.K_c, self.c_d, self.tolerance, self.damping, self.damping_from)
        return Compiled(
            block_of(self._objective),
            np.array([*options, RANK_TOLERANCE]),
            self.insertion.arm.velocity,
            VELOCITY_LIMITS.index(self.velocity_limit),
        )

    @property
    def given(self) -> Given:
        """Speed limits are enforced if ``velocity_limit`` says how."""
        way = {"scale": "by scaling", "clip": "by clipping"}.get(self.velocity_limit, "")
        return dataclasses.replace(super().given, limits=("speed",) if way else (), way=way)

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """One evaluation of the law at ``state``, compiled; see Controller.step()."""
        law = self._compiled
        v, c, sigma_6, rank, scale = _kernel.law(
            state.x,
            state.J_local,
            state.angles,
            reference.x_d,
            reference.x_d_dot,
            law.objective or self._objective.evaluate(state),
            law.numbers,
            law.speeds,
            self.feed_forward,
            law.velocity_limit,
        )
        numbers = {"objective": c, "sigma_6_of_N": sigma_6, "rank": rank, "scale": scale}
        return Command.of(v, numbers)
