"""The RCM first, the tip second: Azimian, Patel and Naish 2010; and Kim's task reconstruction."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rcmqp.controllers.base import Command, Controller
from rcmqp.controllers.checks import at_rest, bounded_gain
from rcmqp.controllers.pseudoinverse import in_order
from rcmqp.controllers.task_reconstruction import (
    TaskReconstruction,
    manipulability,
    shaft_jacobian,
)
from rcmqp.maths.dualquaternion import translation
from rcmqp.maths.options import at_least, between, finite
from rcmqp.references.view import Reference
from rcmqp.tasks import ObjectiveTask, RcmTask, TipTask
from rcmqp.tasks.objectives import make_objective
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class TaskPriority(Controller):
    """RCM Jacobian at the first priority, the tip in its nullspace.

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
        _ = self._tip, self._objective, self._reconstruction  # made before the first cycle

    @functools.cached_property
    def _tip(self) -> TipTask:
        return TipTask.made_for(self.insertion, gain=self.gain)

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
        rcm, tip = RcmTask().evaluate(state, reference), self._tip.level(state, reference)
        b_rcm, b_tip = -self.rcm_gain * rcm.error - rcm.drift, tip.b
        rest, diagnostics = np.zeros(state.angles.size), {}
        if self._reconstruction is not None:
            b_tip, m = self._reconstruction.of_tip(state, reference, b_tip)
            diagnostics["manipulability"] = m
        if self._objective is not None:
            rest = self._objective.level(state, reference).b
        v, least = in_order([(rcm.jacobian, b_rcm), (tip.A, b_tip)], rest, self.tolerance)
        return Command(v, {**diagnostics, "least_singular_value": least})

    def _manipulability_at_start(self) -> float:
        insertion = self.insertion
        still = Reference(insertion.x_rcm, np.zeros(8), translation(insertion.x_rcm), np.zeros(3))
        return manipulability(*shaft_jacobian(insertion.state(insertion.q_start), still))[0]


@dataclass(frozen=True, eq=False)
class TaskReconstructionLaw(TaskPriority):
    """TaskPriority with the tip's task reconstructed near singularities (Kim et al. 2004).

    Below ``reconstruct_from`` times the manipulability at the insertion's start, what leads the
    tip further into a singularity is taken out of its task, see
    rcmqp.controllers.task_reconstruction; the RCM's rows are left as they are. Elsewhere it is
    TaskPriority to the bit.

    Chosen here: half of the start's manipulability, and TaskPriority as the law it is put on.

    Attributes:
        reconstruct_from: see TaskPriority.
    """

    name: ClassVar[str] = "task_reconstruction"

    reconstruct_from: float = 0.5
