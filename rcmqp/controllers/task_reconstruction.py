"""Task reconstruction near singularities: Kim, Marani, Chung and Yuh 2004, for the tip's rows.

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

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import at_least, options, positive, refused
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState, kinematic_hessian

SINGULAR = 1e-12
"""Below this share of the largest, a singular value is taken for this when J^+ shows the way."""


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
        """Check that it begins before it is complete."""
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
        m, g = manipulability(*shaft_jacobian(state, reference))
        return self.reconstruct(wanted, m, state.oMe.rotation @ g[2:]), m


def shaft_jacobian(state: ArmState, reference: Reference) -> tuple[Array, Array]:
    """Jacobian J (5, nv) of the RCM's rows and the tip, and its derivative (5, nv, nv).

    In the effector's axes: two rows of RcmTask, d(pivot, x and y)/dq; then three rows, the
    tip's velocity. The last axis of the derivative is the joint that moves.
    """
    H = kinematic_hessian(state.J_local)
    r = state.oMe.actInv(reference.pivot)
    nu, omega = state.J_local[:3], state.J_local[3:]
    shaft = np.diag([1.0, 1.0, 0.0])  # takes the spin out, as RcmTask does
    r_dot, turned = pin.skew(r) @ omega - nu, shaft @ omega
    seen = pin.skew(r) @ turned - nu
    seen_dot = np.cross(r_dot[:, None, :], turned[:, :, None], axis=0)
    seen_dot = seen_dot + np.einsum("ab,bij->aij", pin.skew(r) @ shaft, H[3:]) - H[:3]
    a = pin.skew(state.oMe.actInv(state.tool.oMt.translation))
    tip, tip_dot = nu - a @ omega, H[:3] - np.einsum("ab,bij->aij", a, H[3:])
    return np.vstack([seen[:2], tip]), np.concatenate([seen_dot[:2], tip_dot])


def manipulability(J: Array, dJ: Array) -> tuple[float, Array]:
    """Measure m = sqrt(det J J^T) and g = J^(+T) grad m (k,), of J (k, nv), dJ/dq (k, nv, nv).

    The gradient is built without dividing by m, so it is right at a singularity, too, where
    J^+ is not: there the direction that J has lost is what g points along.
    """
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    others = np.prod(np.where(np.eye(len(s)), 1.0, s), axis=1)  # m / s_i, also where s_i = 0
    gradient = np.einsum("ri,rik->k", (U * others) @ Vt, dJ)
    g = U @ ((Vt @ gradient) / np.maximum(s, SINGULAR * s[0]))
    return float(np.prod(s)), np.asarray(g)
