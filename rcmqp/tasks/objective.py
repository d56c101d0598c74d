"""A secondary objective, by gradient ascent."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from rcmqp._kernel import Block
from rcmqp.errors import OptionError
from rcmqp.references.view import Reference
from rcmqp.tasks.base import CompiledTask, Residual, block_of, check_finite, check_positive
from rcmqp.tasks.objectives import Objective, make_objective, own_objective
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion


@dataclass(frozen=True, eq=False)
class ObjectiveTask(CompiledTask):
    """Move the joints up an objective's gradient: v = K_c (c_d - c) J_c^T, equation (4).

    A velocity is wanted, not a value, so the rows are the joints': jacobian identity, drift
    minus the wanted velocity, and an error that is zero by definition. ``gain`` has nothing to
    act on and cannot be given. On the level below others, the least-squares answer is the
    projection of v onto what they leave, as P does in equation (4).

    The obvious task of one row, bring c to c_d, J_c v = K (c_d - c), is not for use: where the
    gradient vanishes, as in every maximum short of c_d, it asks for a speed that grows without
    bound, as 1 / |J_c|. The ascent's speed goes to zero with the gradient.

    made_for() takes the objective of the paper's controller: singularity_product on arms of
    that kind, manipulability on others, and joint_centring where there are fewer than six joints,
    whose manipulability is always zero; or one of OBJECTIVES by its name.

    Attributes:
        objective: c and its gradient J_c.
        c_d: desired value; the paper's 1.
        K_c: [1/s times the inverse of the gradient squared]; the paper's 7.
    """

    name: ClassVar[str] = "objective"
    unit: ClassVar[str] = "rad"

    damping: float | None = field(default=0.0, kw_only=True)

    objective: Objective
    c_d: float = 1.0
    K_c: float = 7.0
    gain: float = field(default=60.0, init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        if not isinstance(self.objective, Objective):
            raise OptionError(
                f"objective = {self.objective!r}; it must be an Objective, as made by "
                "make_objective(name, arm)"
            )
        check_finite("c_d", self.c_d)
        check_positive("K_c", self.K_c)

    @classmethod
    def made_for(cls, insertion: Insertion, **options: Any) -> Self:
        """The arm's own objective, unless another, or the name of one, is given."""
        objective = options.pop("objective", own_objective(insertion.arm))
        if isinstance(objective, str):
            objective = make_objective(objective, insertion.arm)
        return cls(objective, **options)

    @functools.cached_property
    def block(self) -> Block | None:
        """The rows, where the objective is compiled."""
        inner = block_of(self.objective)
        if inner is None:
            return None
        return Block("objective", K_c=self.K_c, c_d=self.c_d, objective=inner)

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error (nv,) zero; drift (nv,) minus the wanted joint velocity."""
        if self.block is not None:
            return super().evaluate(state, reference)
        c, J_c = self.objective.evaluate(state)
        nv = J_c.size
        return Residual(np.zeros(nv), np.eye(nv), -self.K_c * (self.c_d - c) * J_c)
