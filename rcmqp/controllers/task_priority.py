"""The RCM first, the tip second: Azimian, Patel and Naish 2010; and Kim's task reconstruction.

J. Kim, G. Marani, W. K. Chung and J. Yuh, "A general singularity avoidance framework for robot
manipulators: task reconstruction method", ICRA 2004. With m = sqrt(det J J^T) the manipulability
of the task's Jacobian J, and theta_dot = J^+ x',

    dm/dq_k = m tr((dJ/dq_k) J^+),   m' = g^T x',   g = J^(+T) grad m,   n = g / |g|,

so n is the direction of the task that leads away from the singularity. Where m is small and the
task wants to go the other way, n^T x' < 0, that component is taken out of it:

    x'_new = x' - k(m) n min(n^T x', 0) + k_2(m) n,

with k rising from 0 at m_1 to 1 at m_2 < m_1, and k_2, the escape, beginning at m_2.

The task is changed, which an RCM must never be. So J is that of the RCM's two rows and the tip's
three, m measures both together, and n is made of g's part for the tip alone: what the RCM's rows
contribute to m' is left as it is.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rcmqp import _kernel
from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import at_rest, bounded_gain
from rcmqp.controllers.pseudoinverse import in_order, inverse
from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array, translation
from rcmqp.maths.options import at_least, between, finite, options, positive, refused
from rcmqp.references.view import STILL, Reference, cycle
from rcmqp.tasks import ObjectiveTask, RcmTask, TipTask
from rcmqp.tasks.objectives import make_objective
from rcmqp.world.arm import ArmState


@options
@dataclass(frozen=True, slots=True)
class TaskReconstruction:
    """Takes out of a wanted velocity what leads into a singularity.

    Read: a code of others after this method (J. Woolfrey, SerialLink.singularityAvoidance), which
    has the same gradient of m; it takes the component of the joint velocity along the gradient
    out, all at once below m = 0.01.

    Remembered: the relations of this module's docstring. The paper itself was not read.

    Chosen here: k and k_2 are straight lines, k = (m_1 - m) / (m_1 - m_2) and
    k_2 = escape (1 - m / m_2), cut off at 0, and k at 1.

    Attributes:
        m_1: manipulability below which it begins, in m's unit.
        m_2: manipulability below which the whole component is gone.
        escape: speed away from the singularity at m = 0 [m/s]; 0 for none.

    Raises:
        OptionError: not 0 < m_2 < m_1, or the escape is negative.
    """

    m_1: float = field(metadata=positive())
    m_2: float = field(metadata=positive())
    escape: float = field(default=0.0, metadata=at_least(0.0, "m/s"))

    def __post_init__(self) -> None:
        if not self.m_2 < self.m_1:
            raise refused("m_2", self.m_2, f"below m_1 = {self.m_1}")

    def reconstruct(self, wanted: Array, m: float, g: Array) -> Array:
        """x'_new (k,) of the wanted velocity x' (k,), the manipulability and g = dm'/dx' (k,)."""
        size = float(np.linalg.norm(g))
        if m >= self.m_1 or size == 0.0:
            return wanted
        n = g / size
        k = min((self.m_1 - m) / (self.m_1 - self.m_2), 1.0)
        k_2 = self.escape * max(1.0 - m / self.m_2, 0.0)
        return np.asarray(wanted - (k * min(float(n @ wanted), 0.0) - k_2) * n)

    def of_tip(self, state: ArmState, reference: Reference, wanted: Array) -> tuple[Array, float]:
        """The tip's wanted velocity (3,) in the world [m/s], reconstructed, and m.

        For the right-hand side of any rows of the tip: TipTask's level, and so a level of a
        hierarchy below the RCM's.
        """
        m, g = manipulability(state, reference)
        return self.reconstruct(wanted, m, g[2:]), m


def manipulability(state: ArmState, reference: Reference) -> tuple[float, Array]:
    """Measure m = sqrt(det J J^T) and g = J^(+T) grad m (5,), J the rows of RcmTask and TipTask.

    The gradient is built without dividing by m, so it is right at a singularity, too, where
    J^+ is not: there the direction that J has lost is what g points along.

    Raises:
        OptionError: the instrument has a wrist.
    """
    if len(state.tool_at) > 1:
        raise OptionError(
            "the manipulability of RCM and tip is for a tool that is fixed to the shaft; this "
            "instrument has a wrist"
        )
    return _kernel.manipulability(*cycle(state, reference))


@dataclass(frozen=True, eq=False)
class TaskPriority(Controller):
    """The RCM first, the tip in its nullspace: Azimian, Patel and Naish 2010.

    H. Azimian, R. V. Patel and M. D. Naish, "On constrained manipulation in robotics-assisted
    minimally invasive surgery", BioRob 2010, pp. 650-655. The shaft's point at the trocar must
    not move sideways, which is two rows; the tip's position is three:

        theta_dot = J_rcm^+ b_rcm + (J_tip P)^+ (b_tip - J_tip J_rcm^+ b_rcm),
        P = I - J_rcm^+ J_rcm,   b_tip = K (p_tip,d - p_tip)

    The roll about the shaft is left to the inverse.

    Read: its description in Marinho, Bernardes and Bo: task priority, an RCM Jacobian, a
    negligible RCM error, considerable deviations of the tip, a roll left to the inverses.

    Not read: the paper itself, and no public code of it was found.

    Chosen here: the lateral rows of RcmTask. Position feedback of the RCM, b_rcm = K_rcm e_rcm,
    for with b_rcm = 0 the RCM drifts (``rcm_gain`` = 0). Nothing in the rest nullspace, unless
    ``K_c`` is given. Truncated inverses, and every number.

    Departures: all options from ``K_c`` on are extensions, off by default.

    Attributes:
        gain: K of the tip [1/s].
        rcm_gain: K_rcm [1/s]; 0 for velocities only.
        tolerance: a direction of J_rcm, and of the tip in its nullspace, is given up where its
            singular value is below this share of the largest of J_rcm, or J_tip.
        K_c: gain of the objective in the nullspace of both, see ObjectiveTask; 0 for none.
        c_d: desired value of the objective.
        objective: its name in OBJECTIVES; empty for the arm's own.
        reconstruct_from: share of the manipulability at the insertion's start below which the
            tip's rows go through TaskReconstruction (Kim et al. 2004); 0 for never. The RCM's
            rows never do. The measure also falls to 0 as the tip nears the trocar, and grows as
            it goes deeper, so shares above 1 make sense.
        reconstruct_full: share of that again, below which the component that leads towards the
            singularity is gone altogether.
        escape: [m/s] of TaskReconstruction.
        feed_forward: know the velocities of the reference and of the trocar; not in the paper.
    """

    name: ClassVar[str] = "task_priority"
    enforces: ClassVar[tuple[str, ...] | None] = ()
    holds_roll: ClassVar[bool | None] = False

    gain: float = field(default=60.0, metadata=bounded_gain())
    rcm_gain: float = field(default=60.0, metadata=bounded_gain(or_zero=True))
    tolerance: float = field(default=1e-3, metadata=between(0.0, 1.0))
    K_c: float = field(default=0.0, metadata=at_least(0.0))
    c_d: float = field(default=1.0, metadata=finite())
    objective: str = ""
    reconstruct_from: float = field(default=0.0, metadata=at_least(0.0))
    reconstruct_full: float = field(default=0.5, metadata=between(0.0, 1.0))
    escape: float = field(default=0.0, metadata=at_least(0.0, "m/s"))
    feed_forward: bool = False

    def __post_init__(self) -> None:
        """Check the options and make the tasks.

        Raises:
            OptionError: an option's value is not allowed.
            UnknownName: there is no such objective.
        """
        super().__post_init__()
        if self.objective:
            make_objective(self.objective, self.insertion.arm)  # refuses an unknown name
        _ = (
            self._rcm,
            self._tip,
            self._objective,
            self._reconstruction,
        )  # made before the first cycle

    @functools.cached_property
    def _rcm(self) -> RcmTask:
        return RcmTask()

    @functools.cached_property
    def _tip(self) -> TipTask:
        return TipTask()

    @functools.cached_property
    def _inverse(self) -> Array:
        return inverse(self.tolerance)

    @functools.cached_property
    def _objective(self) -> ObjectiveTask | None:
        if not self.K_c:
            return None
        named = {"objective": self.objective} if self.objective else {}
        return ObjectiveTask.made_for(self.insertion, c_d=self.c_d, K_c=self.K_c, **named)

    @functools.cached_property
    def _reconstruction(self) -> TaskReconstruction | None:
        if not self.reconstruct_from:
            return None
        m_1 = self.reconstruct_from * self._manipulability_at_start()
        return TaskReconstruction(m_1, self.reconstruct_full * m_1, self.escape)

    def _step(self, state: ArmState, reference: Reference) -> Command:
        """One evaluation of the law."""
        reference = reference if self.feed_forward else at_rest(reference)
        known = cycle(state, reference)
        rcm = self._rcm.block.goal(*known, self.rcm_gain)
        J_tip, b_tip = self._tip.block.goal(*known, self.gain)
        rest, diagnostics = None, {}
        if self._reconstruction is not None:
            b_tip, m = self._reconstruction.of_tip(state, reference, b_tip)
            diagnostics["manipulability"] = m
        if self._objective is not None:
            rest = -self._objective.evaluate(state, reference).drift
        v, least = in_order((rcm, (J_tip, b_tip)), self._inverse, rest)
        return Command.of(v, {**diagnostics, "least_singular_value": least})

    def _manipulability_at_start(self) -> float:
        insertion = self.insertion
        still = Reference(insertion.x_rcm, np.zeros(8), translation(insertion.x_rcm), STILL)
        return manipulability(insertion.state(insertion.q_start), still)[0]


@dataclass(frozen=True, eq=False)
class TaskReconstructionLaw(TaskPriority):
    """task_priority, with the tip's task reconstructed near singularities (Kim et al. 2004).

    Below ``reconstruct_from`` times the manipulability at the insertion's start, what leads the
    tip further into a singularity is taken out of its task, see
    rcmqp.controllers.task_priority; the RCM's rows are left as they are. Elsewhere it is
    TaskPriority to the bit.

    Chosen here: half of the start's manipulability, and TaskPriority as the law it is put on.

    Attributes:
        reconstruct_from: see TaskPriority.
    """

    name: ClassVar[str] = "task_reconstruction"

    reconstruct_from: float = 0.5
