"""Secondary objectives c(theta) of equation (4), and their gradients J_c.

Each is better the larger it is. Singular values are those of the effector's geometric Jacobian
as it stands, in metres and radians: the number depends on that choice of units.

The two that the paper's law uses by itself are compiled; their ``formula()`` is the same in
numpy, to be read and to be tested against.
"""

from __future__ import annotations

import abc
from collections.abc import Callable

import numpy as np

from rcmqp import _kernel
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm, ArmState, kinematic_hessian


class Objective(abc.ABC):
    """A function of the configuration to be raised in the nullspace of the main task."""

    @abc.abstractmethod
    def evaluate(self, state: ArmState) -> tuple[float, Array]:
        """Value c and gradient dc/dq (nv,) at ``state``."""

    def program(self) -> tuple[int, tuple[Array, ...]] | None:
        """Kind and vectors for compiled code, see rcmqp/kernel/rows.h; None: not in it."""
        return None


class SingularityProduct(Objective):
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

    def evaluate(self, state: ArmState) -> tuple[float, Array]:
        """Value c in [0, 1] and gradient (7,) [1/rad]."""
        return _kernel.singularity_product(state.angles, self._offsets)

    def formula(self, state: ArmState) -> tuple[float, Array]:
        """What evaluate() computes."""
        theta = state.angles + self._offsets
        s, c = np.sin(theta), np.cos(theta)
        s3, s4, s5 = s[2], s[3], s[4]
        c2, c6 = c[1], c[5]
        elbow = s4**2
        shoulder, wrist = 1.0 - (c2 * s3) ** 2, 1.0 - (c6 * s5) ** 2
        both = 1.0 - (c2 * c6) ** 2
        twice = np.sin(2.0 * theta)  # d(sin^2) = sin 2 theta = -d(cos^2)
        gradient = np.array(
            [
                0.0,
                elbow * wrist * twice[1] * (s3**2 * both + shoulder * c6**2),
                -elbow * wrist * both * c2**2 * twice[2],
                shoulder * wrist * both * twice[3],
                -elbow * shoulder * both * c6**2 * twice[4],
                elbow * shoulder * twice[5] * (s5**2 * both + wrist * c2**2),
                0.0,
            ]
        )
        return float(elbow * shoulder * wrist * both), gradient

    def program(self) -> tuple[int, tuple[Array, ...]]:
        """For compiled code."""
        return _kernel.SRS_PRODUCT, (self._offsets,)


class Manipulability(Objective):
    """Yoshikawa's measure: the product of the Jacobian's singular values.

    Its gradient is dm/dq_k = m tr((dJ/dq_k) J^+) (Kim et al. 2004).
    """

    def evaluate(self, state: ArmState) -> tuple[float, Array]:
        """Value m and gradient (nv,)."""
        if state.J_local.shape[1] < 6:
            return self.formula(state)
        return _kernel.manipulability_measure(state.J_local)

    def formula(self, state: ArmState) -> tuple[float, Array]:
        """What evaluate() computes."""
        U, s, Vt = np.linalg.svd(state.J_local, full_matrices=False)
        others = np.prod(np.where(np.eye(len(s)), 1.0, s), axis=1)  # m / s_i, also where s_i = 0
        weighted = (U * others) @ Vt
        gradient = np.einsum("ri,rik->k", weighted, kinematic_hessian(state.J_local))
        return float(np.prod(s)), gradient

    def program(self) -> tuple[int, tuple[Array, ...]]:
        """For compiled code."""
        return _kernel.MANIPULABILITY, ()


class LeastSingularValue(Objective):
    """The Jacobian's least singular value; its gradient, u^T (dJ/dq_k) v, jumps where two meet."""

    def evaluate(self, state: ArmState) -> tuple[float, Array]:
        """Value sigma_min and gradient (nv,)."""
        U, s, Vt = np.linalg.svd(state.J_local, full_matrices=False)
        hessian = kinematic_hessian(state.J_local)
        return float(s[-1]), np.einsum("r,rik,i->k", U[:, -1], hessian, Vt[-1])


class JointCentring(Objective):
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
        self._count = int(limited.sum())

    def evaluate(self, state: ArmState) -> tuple[float, Array]:
        """Value c and gradient (nv,) [1/rad]."""
        offset = (state.angles - self._middle) / self._half
        gradient = -2.0 * offset / (self._half * self._count)
        return 1.0 - float(offset @ offset) / self._count, gradient


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


def make_objective(name: str, arm: Arm) -> Objective:
    """Make an objective for an arm.

    Raises:
        UnknownName: there is no such objective.
        OptionError: the arm is not of the kind that the objective is for.
    """
    if name not in OBJECTIVES:
        raise UnknownName("objective", name, OBJECTIVES)
    return OBJECTIVES[name](arm)
