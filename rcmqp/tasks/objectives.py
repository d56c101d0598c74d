"""Secondary objectives c(theta) of equation (4), and their gradients J_c.

Each is better the larger it is. Singular values are those of the effector's geometric Jacobian
as it stands, in metres and radians: the number depends on that choice of units.
"""

from __future__ import annotations

import abc
import functools
from collections.abc import Callable

import numpy as np

from rcmqp._kernel import Block
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm, ArmState


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
                "srs_offsets); use objective=manipulability or least_singular_value"
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
            "anything; use objective=joint_centring"
        )
    return objective


OBJECTIVES: dict[str, Callable[[Arm], Objective]] = {
    "singularity_product": SingularityProduct,
    "manipulability": lambda arm: _of_six(Manipulability(), arm),
    "least_singular_value": lambda arm: _of_six(LeastSingularValue(), arm),
    "joint_centring": JointCentring,
}


def own_objective(arm: Arm) -> str:
    """Name of the objective that an arm has where none is asked for.

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
