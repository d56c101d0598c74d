"""A posture of the arm."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp._kernel import Block
from rcmqp.errors import OptionError
from rcmqp.references.view import Reference
from rcmqp.tasks.base import CompiledTask, Residual
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion


@dataclass(frozen=True, eq=False)
class PostureTask(CompiledTask):
    """Bring the joints to a posture: e = angles - posture, de/dt = v.

    made_for() takes the posture at the start and asks the model which joints are continuous.

    Attributes:
        posture: (nv,) joint angles [rad] or [m]; copied.
        continuous: (nv,) which joints turn without end and take the short way round; none, if
            not given.

    Raises:
        OptionError: the posture is not finite, or the two differ in size.
    """

    name: ClassVar[str] = "posture"
    unit: ClassVar[str] = "rad"

    damping: float | None = field(default=0.0, kw_only=True)

    posture: ArrayLike
    continuous: ArrayLike = ()

    def __post_init__(self) -> None:
        """Check the posture and copy it into the block."""
        posture, continuous = np.array(self.posture, dtype=float), np.array(self.continuous)
        if posture.ndim != 1 or not posture.size or not np.isfinite(posture).all():
            raise OptionError(f"posture = {posture}; it must be one finite number a joint")
        if continuous.size and continuous.shape != posture.shape:
            raise OptionError(
                f"continuous has shape {continuous.shape}, posture {posture.shape}; give one "
                "truth value a joint"
            )
        super().__post_init__()

    @classmethod
    def made_for(cls, insertion: Insertion, **options: Any) -> Self:
        """The posture at the start, unless another is given."""
        options.setdefault("posture", insertion.angles_start)
        options.setdefault("continuous", [j.nq == 2 for j in insertion.arm.model.joints[1:]])
        return cls(**options)

    @functools.cached_property
    def block(self) -> Block:
        """Error (nv,) [rad] or [m]."""
        turning = np.asarray(self.continuous, dtype=bool)
        if not turning.size:
            turning = np.zeros(np.shape(self.posture), dtype=bool)
        return Block("posture", posture=self.posture, continuous=turning)

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error (nv,) [rad] or [m].

        Raises:
            OptionError: the posture is that of another arm.
        """
        posture, nv = self.block.joints, state.angles.size
        if posture != nv:
            raise OptionError(f"a posture of {posture} joints for an arm of {nv}")
        return super().evaluate(state, reference)
