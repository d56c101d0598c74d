"""The RCM as an entry sphere: the vector-field inequality of Marinho et al. 2019."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rcmqp import _kernel
from rcmqp._kernel import Block
from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import at_rest, bounded_gain
from rcmqp.controllers.given import Given
from rcmqp.controllers.one_level import INFEASIBLE, OneLevel, Still
from rcmqp.controllers.stack import Evaluated
from rcmqp.limits import Constraint, KeepOut, Limit
from rcmqp.limits.base import CompiledLimit
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import between, positive
from rcmqp.references.view import Reference, cycle
from rcmqp.tasks import TipTask
from rcmqp.tasks.base import CompiledTask
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class Rotation(CompiledTask):
    """Turn the effector as x_d: the rotation's part of PoseTask, e = 1 - vec(r* r_d)."""

    name: ClassVar[str] = "rotation"

    @functools.cached_property
    def block(self) -> Block:
        """Error (4,), no unit."""
        return Block("rotation")


@dataclass(frozen=True, eq=False)
class JointRows(CompiledLimit):
    """Keep rate (lower - q) <= v <= rate (upper - q), and |v| <= speed.

    JointLimits of joints that may stop within a cycle, with 1 / rate for the period.

    Attributes:
        lower, upper: (nv,) position limits [rad] or [m].
        speed: (nv,) speed limits, inf for none.
        rate: [1/s].
    """

    name: ClassVar[str] = "joint_rows"

    lower: Array
    upper: Array
    speed: Array
    rate: float

    @functools.cached_property
    def block(self) -> Block:
        """The compiled box: limits of position and speed, none of acceleration and jerk."""
        free = np.full(self.speed.size, np.inf)
        others = dict.fromkeys(("acceleration", "jerk", "braking", "easing"), free)
        own = {"lowest": self.lower, "highest": self.upper, "velocity": self.speed}
        return Block("joints", period=1.0 / self.rate, **own, **others)


@dataclass(frozen=True, eq=False)
class EntryRow(Limit):
    """The shaft's line through a sphere about the trocar, as VfiQP has it.

    It is the row of a task with the error (D - d_safe^2) / (2 d_safe), as an inequality.

    Attributes:
        d_safe: radius [m].
        gain: eta_d [1/s].
        nv: joints.
    """

    name: ClassVar[str] = "entry_row"

    d_safe: float
    gain: float
    nv: int

    @functools.cached_property
    def _free(self) -> Array:
        free = np.array([[-np.inf], [np.inf]]).repeat(self.nv, axis=1)
        free.setflags(write=False)
        return free

    @functools.cached_property
    def _row(self) -> Block:
        return Block("entry", reach=self.d_safe)

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """The row J_l,p u <= eta_d (d_safe^2 - D_l,p) - dD_l,p/dt, over 2 d_safe [m/s]."""
        C, d = self._row.goal(*cycle(state, reference), self.gain)
        return _kernel.record(Constraint, *self._free, C, d, ("entry sphere",))


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
        solver: ``active_set``, the hierarchy's own, or any of the QP solvers, see Hierarchy.
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
    solver: str = "active_set"
    feed_forward: bool = False

    def __post_init__(self) -> None:
        """Check the options and make the solver.

        Raises:
            OptionError: an option's value is not allowed.
            UnknownName: no solver has that name.
            SolverNotInstalled: its package is missing.
        """
        super().__post_init__()
        _ = self._sphere, self._qp  # made before the first cycle

    @property
    def _joint_rate(self) -> float:
        return min(self.joint_gain or self.gain, 1.0 / self.period)

    @functools.cached_property
    def _sphere(self) -> EntryRow:
        return EntryRow(self.d_safe, self.vfi_gain, self.insertion.arm.nv)

    @functools.cached_property
    def _qp(self) -> OneLevel:
        strict: dict[str, float] = {"gain": self.gain, "damping": 0.0}
        tasks = (
            TipTask(weight=self.alpha, **strict),
            Rotation(weight=1.0 - self.alpha, **strict),
            Still(weight=self.damping**2, damping=0.0),
        )
        arm = self.insertion.arm
        speed = arm.velocity if self.velocity_limits else np.full(arm.nv, np.inf)
        limits = (
            self._sphere,
            JointRows(arm.lower, arm.upper, speed, self._joint_rate),
            *KeepOut.obstacles(self.insertion, gain=self.vfi_gain),
        )
        return OneLevel(tasks, limits, arm, self.period, self.solver)

    @property
    def given(self) -> Given:
        """Position limits are enforced; speed limits, too, with ``velocity_limits``."""
        limits = ("position", "speed") if self.velocity_limits else ("position",)
        return dataclasses.replace(super().given, limits=limits)

    def reset(self) -> None:
        """Forget the solver's warm start."""
        self._qp.reset()

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """Solve the QP once."""
        reference = reference if self.feed_forward else at_rest(reference)
        if self.velocity_limits and (joints := self._too_far(state)):
            why = f"{', '.join(joints)} too far beyond a position limit to come back at its rate"
            return self.safe_stop(state, why, {"infeasible": 1.0})
        row = self._sphere.evaluate(state, reference)
        given: Evaluated = [], [row], [(row.lower, row.upper, row.C, row.d)]
        solution, wrong = self._qp.solve(state, reference, given)
        if wrong:
            numbers = {"infeasible": float(wrong == INFEASIBLE)}
            return self.safe_stop(state, wrong, numbers, solution)
        slack = float(row.d[0] - row.C[0] @ solution.v)
        return Command.of(solution.v, {"infeasible": 0.0, "sphere_slack": slack}, solution)

    def _too_far(self, state: ArmState) -> list[str]:
        """Joints so far beyond a limit that they cannot come back at their rate."""
        arm, way = self.insertion.arm, state.angles
        back = self._joint_rate * np.maximum(arm.lower - way, way - arm.upper)
        if not (back > arm.velocity).any():
            return []
        return [name for name, far in zip(arm.joints, back > arm.velocity, strict=True) if far]
