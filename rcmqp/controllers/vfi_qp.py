"""The RCM as an entry sphere: the vector-field inequality of Marinho et al. 2019."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import at_rest, bounded_gain
from rcmqp.controllers.given import Given
from rcmqp.limits import KeepOut, combine
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import between, positive
from rcmqp.qp import Bounds, Hierarchy, Level, get_solver
from rcmqp.references.view import Reference
from rcmqp.tasks import PoseTask, RcmTask, TipTask
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class VfiQP(Controller):
    """The tool's pose as objective, the shaft through a sphere as a hard inequality.

    M. M. Marinho, B. V. Adorno, K. Harada, K. Deie, A. Deguet, P. Kazanzides, R. H. Taylor and
    M. Mitsuishi, "A unified framework for the teleoperation of surgical robots in constrained
    workspaces", ICRA 2019, pp. 2721-2727:

        min_u  alpha |J_t u + eta e_t|^2 + (1 - alpha) |N_r u + eta e_r|^2 + lambda^2 |u|^2
        s.t.   J_l,p u <= eta_d (d_safe^2 - D_l,p),   eta_q (q_lo - q) <= u <= eta_q (q_hi - q)

    with e_t = t - t_d of the tool's tip, e_r = vec(r* r_d) - 1 and N_r = H-(r_d) C_4 J_r of its
    rotation, and D_l,p the squared distance of the trocar from the shaft's line, J_l,p its
    derivative. Within the sphere the RCM is free: its error is whatever the objective leaves.

    D_l,p(k+1) <= (1 - eta_d T) D_l,p(k) + eta_d T d_safe^2, except for second order in T, so with
    eta_d T <= 1 a shaft inside stays inside and one outside comes back at eta_d. The row is
    divided by 2 d_safe here, into m/s, which changes no solution.

    Each obstacle of the scene is a further row of this kind, as in the paper, on the distance
    itself: J_o u >= -eta_d (distance - radii), by KeepOut, for tip and shaft.

    The QP is solved as a hierarchy of one level: whatever the backend proposes is computed again
    in closed form and verified, so the answer is the optimum, and the same bits each time.

    It also ends in the safe stop where the inequalities cannot all hold, the diagnostic
    ``infeasible`` is then 1, and where no optimum was found that passes the verification.

    Read: the formulas, in the paper's preprint (arXiv 1809.07907, its beginning) and in Marinho's
    own later code, ``ICRA19TaskSpaceController`` of marinholab-working-needlemanipulation. That
    code has vfi_gain 2 by default, and its examples have alpha 0.999, damping 0.01, a period of
    8 ms, gain 1 or 10. Its joint rows are q_lo - q <= u <= q_hi - q, so their gain is 1/s, the
    task's where that is 1. Two slips of it are not copied: the right-hand side of the entry
    sphere's row is set to 0 after it was computed, so that D_l,p must never grow, whatever
    d_safe is; and the joint rows do not follow ``gain``.

    Not read: the numbers of the paper's own experiments.

    Chosen here: gain is the K of the other controllers; joint_gain is the task's, because joint
    rows slower than the task stop the arm in the middle of its range: at 60 and 1 1/s the RCM
    error of ``fast_helix`` is 5.6 mm in place of 0.05; d_safe is 1 mm; damping is 0.001, because
    with 0.01 the rotation lags behind the tip, and takes the shaft as far off the trocar as the
    sphere allows. docs/controllers.md has both settings measured side by side.

    Departures: of r_d and -r_d the one on r's side is taken, as the code does. ``velocity_limits``
    and ``feed_forward`` are extensions, off by default. With ``velocity_limits`` a reference that
    is too fast takes the shaft to the sphere, where joints switch between their speed limits from
    cycle to cycle, and beyond it by what is of second order in T: 0.4 mm on ``fast_helix`` at
    1 ms, 0.1 mm at 0.25 ms.

    Attributes:
        gain: eta [1/s].
        alpha: share of the translation, in 1/m^2, against the rotation.
        damping: lambda [m].
        d_safe: radius of the entry sphere, about the trocar [m]; of the shaft's axis.
        vfi_gain: eta_d [1/s].
        joint_gain: how fast a joint may approach its limits of position [1/s]; 0 for ``gain``.
        velocity_limits: keep the joints' speed limits, too.
        solver: name of the QP backend, see ``rcmqp.qp.solver_names()``.
        feed_forward: know the velocities of the reference and of the trocar.
    """

    name: ClassVar[str] = "vfi_qp"
    enforces: ClassVar[tuple[str, ...] | None] = ("position",)
    holds_roll: ClassVar[bool | None] = True
    remark: ClassVar[str] = (
        "within d_safe, 1 mm, of the trocar the shaft is free. The RCM error there is what the "
        "errors of tip and rotation leave, and the damping makes the rotation lag."
    )

    gain: float = field(default=60.0, metadata=bounded_gain())
    alpha: float = field(default=0.999, metadata=between(0.0, 1.0))
    damping: float = field(default=1e-3, metadata=positive("m"))
    d_safe: float = field(default=1e-3, metadata=positive("m"))
    vfi_gain: float = field(default=2.0, metadata=bounded_gain(up_to=1.0))
    joint_gain: float = field(default=0.0, metadata=bounded_gain(up_to=1.0, or_zero=True))
    velocity_limits: bool = False
    solver: str = "proxqp"
    feed_forward: bool = False

    def __post_init__(self) -> None:
        """Check the options and make the solver.

        Raises:
            OptionError: an option's value is not allowed.
            UnknownName: no solver has that name.
            SolverNotInstalled: its package is missing.
        """
        super().__post_init__()
        get_solver(self.solver)  # says what is wrong with the name
        _ = self._tip, self._obstacles, self._hierarchy  # made before the first cycle

    @property
    def _joint_rate(self) -> float:
        return min(self.joint_gain or self.gain, 1.0 / self.period)

    @functools.cached_property
    def _tip(self) -> TipTask:
        return TipTask.made_for(self.insertion)

    @functools.cached_property
    def _obstacles(self) -> tuple[KeepOut, ...]:
        return KeepOut.obstacles(self.insertion, gain=self.vfi_gain)

    @functools.cached_property
    def _hierarchy(self) -> Hierarchy:
        return Hierarchy(self.solver)

    @property
    def given(self) -> Given:
        """Position limits are enforced; speed limits, too, with ``velocity_limits``."""
        limits = ("position", "speed") if self.velocity_limits else ("position",)
        return dataclasses.replace(super().given, limits=limits)

    def reset(self) -> None:
        """Forget the solver's warm start."""
        self._hierarchy.reset()

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """Solve the QP once."""
        reference = reference if self.feed_forward else at_rest(reference)
        C, d = self._entry_sphere(state, reference)
        lower, upper = self._box(state)
        out = combine(self._obstacles, state, reference)
        bounds = Bounds(
            lower,
            upper,
            np.vstack([C, out.C]),
            np.concatenate([d, out.d]),
            (*self.insertion.arm.joints, "entry sphere", *out.names[lower.size :]),
        )
        solution = self._hierarchy.solve([self._objective(state, reference)], bounds)
        infeasible = not solution.limits_hold
        if infeasible or not solution.exact:
            reason = "the inequalities cannot all hold" if infeasible else "no verified optimum"
            numbers = {"infeasible": float(infeasible)}
            return self.safe_stop(state, reason, numbers, solution)
        slack = float((d - C @ solution.v)[0])
        return Command(solution.v.copy(), {"infeasible": 0.0, "sphere_slack": slack}, solution)

    def _objective(self, state: ArmState, reference: Reference) -> Level:
        """The three terms as the rows of one sum of squares."""
        tip, pose = self._tip.evaluate(state, reference), PoseTask().evaluate(state, reference)
        J_t, b_t = tip.jacobian, -self.gain * tip.error - tip.drift
        N_r, e_r = -pose.jacobian[:4], -pose.error[:4]  # PoseTask's error is 1 - r* r_d = -e_r
        b_r = -self.gain * e_r + pose.drift[:4]
        root, rest, n = math.sqrt(self.alpha), math.sqrt(1.0 - self.alpha), state.angles.size
        return Level(
            np.vstack([root * J_t, rest * N_r, self.damping * np.eye(n)]),
            np.concatenate([root * b_t, rest * b_r, np.zeros(n)]),
            "tool",
        )

    def _entry_sphere(self, state: ArmState, reference: Reference) -> tuple[Array, Array]:
        """The row J_l,p u <= eta_d (d_safe^2 - D_l,p) - dD_l,p/dt, over 2 d_safe."""
        rcm = RcmTask().evaluate(state, reference)
        D, J_D = rcm.error @ rcm.error, 2.0 * rcm.error @ rcm.jacobian
        room = self.vfi_gain * (self.d_safe**2 - D) - 2.0 * rcm.error @ rcm.drift
        return J_D[None] / (2.0 * self.d_safe), np.array([room / (2.0 * self.d_safe)])

    def _box(self, state: ArmState) -> tuple[Array, Array]:
        """Bounds (n,) of u [rad/s]."""
        arm = self.insertion.arm
        lower = self._joint_rate * (arm.lower - state.angles)
        upper = self._joint_rate * (arm.upper - state.angles)
        if self.velocity_limits:
            return np.maximum(lower, -arm.velocity), np.minimum(upper, arm.velocity)
        return lower, upper
