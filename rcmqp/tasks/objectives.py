"""Tasks for the freedom that other tasks leave: a posture, or an objective's ascent.

The objectives c(theta) of equation (4) are better the larger they are. Singular values are those
of the effector's geometric Jacobian as it stands, in metres and radians: the number depends on
that choice of units.
"""

from __future__ import annotations

import abc
import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp._kernel import Block
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import finite, positive
from rcmqp.references.view import Reference
from rcmqp.tasks.base import CompiledTask, Residual, block_of
from rcmqp.world.arm import Arm, ArmState
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


class Objective(abc.ABC):
    """A function of the configuration to be raised in the nullspace of the main task."""

    @abc.abstractmethod
    def evaluate(self, state: ArmState) -> tuple[float, Array]:
        """Value c and gradient dc/dq (nv,) at ``state``."""


class CompiledObjective(Objective):
    """An objective whose value and gradient are compiled: those of its ``block``."""

    @property
    @abc.abstractmethod
    def block(self) -> Block:
        """Value and gradient, made once for the arm."""

    def evaluate(self, state: ArmState) -> tuple[float, Array]:
        """Value c and gradient dc/dq (nv,) at ``state``."""
        return self.block.value(state.J_local, state.angles)


class SingularityProduct(CompiledObjective):
    """Distance from the singularities of a spherical-revolute-spherical arm, 0 to 1.

        c = s4^2 (1 - c2^2 s3^2) (1 - c6^2 s5^2) (1 - c2^2 c6^2)

    with s and c the sine and cosine of the joint angles, counted so that the arm is straight at
    zero. It is zero exactly on the four singular sets of such an arm: elbow straight;
    s2 = c3 = 0; s6 = c5 = 0; s2 = s6 = 0.

    Departures: the paper takes c(theta) "as in" Chiaverini and Siciliano, ACC 1990, whose text
    could not be had. This product stands in for it: dimensionless, with best value 1, as the
    paper's c_d = 1 suggests.
    """

    def __init__(self, arm: Arm) -> None:
        """Take the arm's joint offsets.

        Raises:
            OptionError: the arm is not of this kind.
        """
        if arm.srs_offsets is None:
            raise OptionError(
                f"{arm.name} is no spherical-revolute-spherical arm (robot.toml gives no "
                "srs_offsets); manipulability and least_singular_value are for any arm"
            )
        self._offsets = arm.srs_offsets

    @functools.cached_property
    def block(self) -> Block:
        """Value c in [0, 1] and gradient (7,) [1/rad]."""
        return Block("singularity_product", offsets=self._offsets)


class Manipulability(CompiledObjective):
    """Yoshikawa's measure: the product of the Jacobian's singular values.

    Its gradient is dm/dq_k = m tr((dJ/dq_k) J^+) (Kim et al. 2004).
    """

    @functools.cached_property
    def block(self) -> Block:
        """Value m and gradient (nv,)."""
        return Block("manipulability")


class LeastSingularValue(CompiledObjective):
    """The Jacobian's least singular value; its gradient, u^T (dJ/dq_k) v, jumps where two meet."""

    @functools.cached_property
    def block(self) -> Block:
        """Value sigma_min and gradient (nv,)."""
        return Block("least_singular_value")


class JointCentring(CompiledObjective):
    """How near the joints are to the middle of their ranges: 1 in the middle, 0 at every limit.

    c = 1 - mean(((q - middle) / half range)^2), after Liegeois 1977; continuous joints do not
    count.
    """

    def __init__(self, arm: Arm) -> None:
        """Take the arm's position limits."""
        limited = np.isfinite(arm.upper - arm.lower)
        if not limited.any():
            raise OptionError(f"{arm.name} has no position limits; there is nothing to centre")
        self._middle = arm.middle
        self._half = np.where(limited, (arm.upper - arm.lower) / 2, np.inf)

    @functools.cached_property
    def block(self) -> Block:
        """Value c and gradient (nv,) [1/rad]."""
        return Block("joint_centring", middle=self._middle, half_range=self._half)


def _of_six(objective: Objective, arm: Arm) -> Objective:
    """An objective that is always zero on an arm of fewer joints than six.

    Raises:
        OptionError: this is such an arm.
    """
    if arm.nv < 6:
        raise OptionError(
            f"{arm.name} has {arm.nv} joints, and of fewer than six no singular value says "
            "anything; use the objective joint_centring"
        )
    return objective


OBJECTIVES: dict[str, Callable[[Arm], Objective]] = {
    "singularity_product": SingularityProduct,
    "manipulability": lambda arm: _of_six(Manipulability(), arm),
    "least_singular_value": lambda arm: _of_six(LeastSingularValue(), arm),
    "joint_centring": JointCentring,
}


def own_objective(arm: Arm) -> str:
    """Name of an arm's default objective.

    It is that of the paper's controller: singularity_product on arms of that kind, manipulability
    on others; and joint_centring where there are fewer than six joints.
    """
    if arm.nv < 6:
        return "joint_centring"
    return "manipulability" if arm.srs_offsets is None else "singularity_product"


def make_objective(name: str, arm: Arm) -> Objective:
    """Make an objective for an arm.

    Raises:
        UnknownName: there is no such objective.
        OptionError: the arm is not of the kind that the objective is for.
    """
    if name not in OBJECTIVES:
        raise UnknownName("objective", name, OBJECTIVES)
    return OBJECTIVES[name](arm)


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
    c_d: float = field(default=1.0, metadata=finite())
    K_c: float = field(default=7.0, metadata=positive())
    gain: float = field(default=60.0, init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.objective, Objective):
            raise OptionError(
                f"objective = {self.objective!r}; it must be an Objective, as made by "
                "make_objective(name, arm)"
            )

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
