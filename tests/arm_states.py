"""Random states of real arms, and what an independent oracle says of hierarchical_qp there."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from oracle import Problem, damped_levels, stack, unproved

from rcmqp import ArmState, Insertion, Reference, load_scenario
from rcmqp.controllers import HierarchicalQP
from rcmqp.limits import JointLimits
from rcmqp.maths.dualquaternion import P, from_se3, mul, quaternion_mul
from rcmqp.qp import HierarchySolution

ARMS = ("lwa3", "panda", "ur5", "kinova")
LEVELS = ("rcm", "tip", "roll", "objective", "rest")
PERIOD = 1e-3


@dataclass(frozen=True)
class Verdict:
    """What the oracle says of one step.

    Attributes:
        active: whether a joint is at a bound.
        reached: whether the RCM's level is reached; if not, its second, damped answer is compared.
        alone: whether that is all that is compared: the kinova's joint 6 spins the shaft, but for
            an entry of 1e-12 in the RCM's rows, and whether an RCM that is not reached leaves that
            joint to the levels below is a matter of rounding.
        apart: largest difference from the oracle's joint speeds, which are unique [rad/s].
        differences: of each level's residual norm, from the oracle's [m/s], [rad/s].
        unproved: how far the best multipliers are from proving the oracle right, the worst level.
        kkt: the account's own worst residual.
        answered: finite, inside the box, no safe stop, and exact by its own account.
    """

    active: bool
    reached: bool
    alone: bool
    apart: float
    differences: tuple[float, ...]
    unproved: float
    kkt: float
    answered: bool

    @property
    def decided(self) -> bool:
        """Whether the oracle knows the answer."""
        return self.unproved < 1e-7


@functools.cache
def controllers(arm: str) -> tuple[HierarchicalQP, HierarchicalQP]:
    """Inside the limits of position and speed; and of acceleration, too."""
    insertion = load_scenario("conical_helix", arm).insertion()
    free, limited = (
        HierarchicalQP(
            insertion,
            PERIOD,
            approach=0.0,
            limits=[JointLimits(insertion.arm, PERIOD, acceleration=limited)],
        )
        for limited in (False, True)
    )
    return free, limited


def drawn(insertion: Insertion, rng: np.random.Generator) -> tuple[ArmState, Reference]:
    """Anywhere inside the joint limits, moving; the view from 1 mm to a third of a metre away."""
    arm = insertion.arm
    angles = arm.random_angles(rng)
    state = insertion.state(arm.configuration(angles), rng.uniform(-0.5, 0.5) * arm.velocity)
    away = 10.0 ** rng.uniform(-3.0, -0.5)
    x_d = from_se3(state.oMe * pin.exp6(away * rng.normal(size=6)))
    pivot = state.oMe.act(np.array([*(0.1 * away * rng.normal(size=2)), rng.normal(scale=0.03)]))
    pivot_dot, (omega, nu) = 0.02 * rng.normal(size=3), away * rng.normal(size=(2, 3))
    x_d_dot = 0.5 * mul(x_d, np.array([0.0, *omega, 0.0, *nu]))
    x_d_dot[4:] += 0.5 * quaternion_mul([0.0, *pivot_dot], P(x_d))
    return state, Reference(x_d, x_d_dot, pivot, pivot_dot)


def verdict(arm: str, seed: int) -> Verdict:
    """One step at a state drawn with ``seed``, against the oracle."""
    free, limited = controllers(arm)
    controller = limited if seed % 2 else free
    insertion, rng = controller.insertion, np.random.default_rng([seed, ARMS.index(arm)])
    state, reference = drawn(insertion, rng)
    if controller is limited:  # as if it had followed, up to now
        gain = PERIOD * insertion.arm.acceleration
        gain = np.where(np.isfinite(gain), gain, 0.1)
        before = free.step(state, reference).v + gain * rng.normal(size=gain.size)
        state = insertion.state(state.q, before)
        free.reset()
    controller.reset()
    answer = controller.step(state, reference)
    account = answer.account
    assert isinstance(account, HierarchySolution)
    problem = Problem(*controller.problem(state, reference), sluggish=controller is limited)
    levels, box = damped_levels(problem, guarded=1), problem.bounds
    reached = account.levels[0].reached
    alone = not reached and arm == "kinova"
    found = (*account.levels, account.rest)[: 1 if alone else None]
    apart = problem.levels[0].A @ (answer.v - levels[0].v) if alone else answer.v - levels[-1].v
    differences = [
        abs(float(np.linalg.norm(level.residual) - np.linalg.norm(A @ levels[-1].v - b)))
        for level, (A, b) in zip(found, stack(problem, np.zeros(0))[1:], strict=False)
    ]
    return Verdict(
        bool(account.at_lower.any() or account.at_upper.any()),
        reached,
        alone,
        float(np.abs(apart).max()),
        (*differences, *[0.0] * (len(LEVELS) - len(found))),
        max(unproved(level, level.v, box.lower, box.upper) for level in levels),
        max(level.kkt for level in (account.limits, *found)),
        bool(((box.lower <= answer.v) & (answer.v <= box.upper)).all())
        and not answer.stop
        and all(level.route.exact for level in (account.limits, *found)),
    )
