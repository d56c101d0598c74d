"""The law as equations (3), (4) and (6) have it, in numpy: what DualQuaternion.step() computes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from oracles.pseudoinverse import SingularValues
from rcmqp import ArmState, Command, Reference
from rcmqp.controllers import DualQuaternion
from rcmqp.controllers.dual_quaternion import RANK_TOLERANCE
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import C8, Array


def law(controller: DualQuaternion, state: ArmState, reference: Reference) -> Command:
    """The command at ``state``."""
    x_d = dq.align_sign(reference.x_d, state.x)
    x_d_dot = reference.x_d_dot if x_d @ reference.x_d > 0.0 else -reference.x_d_dot

    x_conj = dq.conj(state.x)
    wanted = controller.gain * (dq.IDENTITY - dq.mul(x_conj, x_d))
    if controller.feed_forward:
        wanted = wanted - dq.mul(x_conj, x_d_dot)
    N = dq.H8_minus(x_d) @ C8 @ state.J_dq

    svd = SingularValues.of(N, rank=6)
    kept = svd.kept(controller.tolerance)
    v = svd.solve(_inverse(controller, svd.s, kept), wanted)

    c, J_c = controller._objective.evaluate(state)
    v_0 = controller.K_c * (controller.c_d - c) * J_c
    v = v + svd.remainder(v_0, svd.kept(RANK_TOLERANCE))  # P v_0, P = I - N^+ N

    v, scale = _limit(controller, v)
    numbers = (c, float(svd.s[-1]), float(kept.sum()), scale)
    return Command(v, dict(zip(controller.diagnostics, numbers, strict=True)))


def _inverse(controller: DualQuaternion, s: Array, kept: NDArray[np.bool_]) -> Array:
    """Inverse of N's singular values (6,): truncated, or damped where the option says so."""
    if controller.damping == 0.0 or s[-1] >= controller.damping_from:
        lambda_2 = 0.0
    else:
        lambda_2 = controller.damping**2 * (1.0 - (s[-1] / controller.damping_from) ** 2)
    return np.divide(s, s**2 + lambda_2, out=np.zeros_like(s), where=kept)


def _limit(controller: DualQuaternion, v: Array) -> tuple[Array, float]:
    """Velocity (nv,) within the limits as the option says, and the share kept of it."""
    limits = controller.insertion.arm.velocity
    excess = float(np.max(np.abs(v) / limits))
    if controller.velocity_limit == "none" or excess <= 1.0:
        return v, 1.0
    if controller.velocity_limit == "scale":
        v = v / excess  # what np.clip takes from this is rounding
    return np.clip(v, -limits, limits), 1.0 / excess
