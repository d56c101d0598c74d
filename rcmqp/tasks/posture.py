"""A posture of the arm."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.errors import OptionError
from rcmqp.references.view import Reference
from rcmqp.tasks.base import Program, Residual, Task
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion


@dataclass(frozen=True, eq=False)
class PostureTask(Task):
    """Bring the joints to a posture: e = angles - posture, de/dt = v.

    made_for() takes the posture at the start and asks the model which joints are continuous.

    Attributes:
        posture: (nv,) joint angles [rad] or [m].
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
        """Copy and check the posture."""
        super().__post_init__()
        posture = np.array(self.posture, dtype=float)
        continuous = np.array(self.continuous, dtype=bool)
        if continuous.size == 0:
            continuous = np.zeros(posture.shape, dtype=bool)
        if posture.ndim != 1 or not np.isfinite(posture).all():
            raise OptionError(f"posture = {posture}; it must be one finite number a joint")
        if continuous.shape != posture.shape:
            raise OptionError(
                f"continuous has shape {continuous.shape}, posture {posture.shape}; give one "
                "truth value a joint"
            )
        for name, array in (("posture", posture), ("continuous", continuous)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def made_for(cls, insertion: Insertion, **options: Any) -> Self:
        """The posture at the start, unless another is given."""
        options.setdefault("posture", insertion.angles_start)
        options.setdefault("continuous", [j.nq == 2 for j in insertion.arm.model.joints[1:]])
        return cls(**options)

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        """Error (nv,) [rad] or [m].

        Raises:
            OptionError: the posture is that of another arm.
        """
        posture, nv = np.asarray(self.posture), state.angles.size
        if posture.size != nv:
            raise OptionError(f"a posture of {posture.size} joints for an arm of {nv}")
        error = state.angles - posture
        short = np.mod(error + np.pi, 2.0 * np.pi) - np.pi
        error = np.where(self.continuous, short, error)
        return Residual(error, np.eye(nv), np.zeros(nv))

    def program(self) -> Program:
        """For compiled code."""
        numbers = (_kernel.POSTURE, math.sqrt(self.weight), self.gain, 0.0)
        return numbers, (self.posture, self.continuous)
