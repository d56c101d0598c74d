"""The paper's controller: Marinho, Bernardes and Bo's dual-quaternion law, equation (6)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rcmqp import _kernel
from rcmqp._kernel import Block
from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import check_gain, check_not_negative
from rcmqp.controllers.given import Given
from rcmqp.controllers.pseudoinverse import SingularValues
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import C8, Array
from rcmqp.references.view import Reference
from rcmqp.tasks.base import block_of
from rcmqp.tasks.objectives import Objective, make_objective
from rcmqp.world.arm import ArmState

VELOCITY_LIMITS = ("none", "scale", "clip")
RANK_TOLERANCE = 1e-12
"""Share of s_1 above which a direction of N is real, and no nullspace, if N^+ gives it up too."""


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

    N is 8 x n and has rank 6 at the most: N^+ keeps at most six singular values, those above
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
            empty for the arm's own, as above.
        tolerance: relative cut-off of N^+: a direction whose singular value is below
            ``tolerance`` times the largest is given up. It keeps numbers finite and no more: the
            pose error's share of v stays below K |e| / (tolerance s_1), which no arm can follow
            near a singularity. A larger one is no remedy: the direction's error grows while it
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
    diagnostics: ClassVar[Mapping[str, tuple[str, str]]] = {
        "objective": ("1", "value of the objective c(theta)"),
        "sigma_6_of_N": ("m, rad", "sixth singular value of N: about half of singular_value"),
        "rank": ("1", "singular values of N that N^+ keeps, six away from singularities"),
        "scale": ("1", "share of the wished speed that velocity_limit left"),
    }

    gain: float = 60.0
    K_c: float = 7.0
    c_d: float = 1.0
    objective: str = ""
    tolerance: float = 1e-7
    feed_forward: bool = False
    damping: float = 0.0
    damping_from: float = 0.02
    velocity_limit: str = "none"
    _objective: Objective = field(init=False, repr=False)
    _aim: Block | None = field(init=False, repr=False)
    _numbers: Array = field(init=False, repr=False)
    _speeds: Array = field(init=False, repr=False)
    _limited: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the options and make the objective.

        Raises:
            OptionError: an option's value is not allowed.
            UnknownName: there is no such objective.
        """
        super().__post_init__()
        check_gain("gain", self.gain, self.period)
        check_not_negative("K_c", self.K_c)
        check_not_negative("damping", self.damping)
        if not math.isfinite(self.c_d):
            raise OptionError(f"c_d = {self.c_d}, it must be finite")
        if not 0.0 < self.tolerance < 1.0:
            raise OptionError(f"tolerance = {self.tolerance}, it must lie between 0 and 1")
        if not self.damping_from > 0.0:
            raise OptionError(f"damping_from = {self.damping_from}, it must be positive")
        if self.velocity_limit not in VELOCITY_LIMITS:
            raise UnknownName("velocity_limit", self.velocity_limit, VELOCITY_LIMITS)
        arm = self.insertion.arm
        if arm.nv < 6:
            raise OptionError(
                f"{arm.name} has {arm.nv} joints; the law controls position and orientation at "
                "one priority and needs six or more"
            )
        own = "manipulability" if arm.srs_offsets is None else "singularity_product"
        object.__setattr__(self, "objective", self.objective or own)
        objective = make_objective(self.objective, arm)
        object.__setattr__(self, "_objective", objective)
        object.__setattr__(self, "_aim", block_of(objective))
        object.__setattr__(self, "_speeds", arm.velocity)
        options = (self.gain, self.K_c, self.c_d, self.tolerance, self.damping, self.damping_from)
        numbers = np.array([*options, RANK_TOLERANCE])
        numbers.setflags(write=False)
        object.__setattr__(self, "_numbers", numbers)
        object.__setattr__(self, "_limited", VELOCITY_LIMITS.index(self.velocity_limit))

    @property
    def given(self) -> Given:
        """Speed limits are enforced if ``velocity_limit`` says how."""
        way = {"scale": "by scaling", "clip": "by clipping"}.get(self.velocity_limit, "")
        return dataclasses.replace(super().given, limits=("speed",) if way else (), way=way)

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """One evaluation of the law at ``state``, compiled; see Controller.step()."""
        v, c, sigma_6, rank, scale = _kernel.law(
            state.x,
            state.J_local,
            state.angles,
            reference.x_d,
            reference.x_d_dot,
            self._aim or self._objective.evaluate(state),
            self._numbers,
            self._speeds,
            self.feed_forward,
            self._limited,
        )
        numbers = {"objective": c, "sigma_6_of_N": sigma_6, "rank": rank, "scale": scale}
        return Command.of(v, numbers)

    def law(self, state: ArmState, reference: Reference) -> Command:
        """The law as equations (3), (4) and (6) have it, in numpy: what step() computes."""
        x_d = dq.align_sign(reference.x_d, state.x)
        x_d_dot = reference.x_d_dot if x_d @ reference.x_d > 0.0 else -reference.x_d_dot

        x_conj = dq.conj(state.x)
        wanted = self.gain * (dq.IDENTITY - dq.mul(x_conj, x_d))
        if self.feed_forward:
            wanted = wanted - dq.mul(x_conj, x_d_dot)
        N = dq.H8_minus(x_d) @ C8 @ state.J_dq

        svd = SingularValues.of(N, rank=6)
        kept = svd.kept(self.tolerance)
        v = svd.solve(self._inverse(svd.s, kept), wanted)

        c, J_c = self._objective.evaluate(state)
        v_0 = self.K_c * (self.c_d - c) * J_c
        v = v + svd.remainder(v_0, svd.kept(RANK_TOLERANCE))  # P v_0, P = I - N^+ N

        v, scale = self._limit(v)
        numbers = (c, float(svd.s[-1]), float(kept.sum()), scale)
        return Command(v, dict(zip(self.diagnostics, numbers, strict=True)))

    def _inverse(self, s: Array, kept: NDArray[np.bool_]) -> Array:
        """Inverse of N's singular values (6,): truncated, or damped where the option says so."""
        if self.damping == 0.0 or s[-1] >= self.damping_from:
            lambda_2 = 0.0
        else:
            lambda_2 = self.damping**2 * (1.0 - (s[-1] / self.damping_from) ** 2)
        return np.divide(s, s**2 + lambda_2, out=np.zeros_like(s), where=kept)

    def _limit(self, v: Array) -> tuple[Array, float]:
        """Velocity (nv,) within the limits as the option says, and the share kept of it."""
        limits = self.insertion.arm.velocity
        excess = float(np.max(np.abs(v) / limits))
        if self.velocity_limit == "none" or excess <= 1.0:
            return v, 1.0
        if self.velocity_limit == "scale":
            v = v / excess  # what np.clip takes from this is rounding
        return np.clip(v, -limits, limits), 1.0 / excess
