"""What tests of the published laws start from.

The literal laws take their Jacobians from Pinocchio in the world's axes, and their inverses from
numpy's pinv and solve; only the product of dual quaternions is the package's own.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from rcmqp import (
    ArmState,
    Command,
    Controller,
    Insertion,
    Reference,
    Run,
    load_scenario,
    make_controller,
    simulate,
    view_pose,
)
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths import ConicalHelix

PERIOD = 8e-3
ARMS = ["lwa3", "meka_a2", "ur5"]
on_each_arm = pytest.mark.parametrize("arm", ARMS)


def made(name: str, insertion: Insertion, period: float = PERIOD, **options: Any) -> Controller:
    return make_controller(name, insertion, period, **options)


def near(state: ArmState, rng: np.random.Generator, scale: float = 0.02) -> Reference:
    """A reference near a state that moves, and a trocar near the shaft that does so, too."""
    x_d = dq.from_se3(state.oMe * pin.exp6(rng.normal(scale=scale, size=6)))
    twist = np.array([0.0, *rng.normal(scale=0.1, size=3), 0.0, *rng.normal(scale=0.1, size=3)])
    pivot = state.oMe.act(rng.normal(scale=scale, size=3))
    return Reference(x_d, 0.5 * dq.mul(x_d, twist), pivot, rng.normal(scale=0.02, size=3))


def quick_helix(insertion: Insertion, period: float = PERIOD, count: int = 50) -> list[Reference]:
    helix = ConicalHelix(duration=10.0)
    times = 3.0 + period * np.arange(count)
    return [view_pose(insertion.x_rcm, helix.command(t, insertion.tip_depth)) for t in times]


def follow(
    controller: Controller, references: Iterable[Reference]
) -> tuple[list[ArmState], list[Command]]:
    """States and answers of a loop from the insertion's start, written out by hand."""
    insertion, q = controller.insertion, controller.insertion.q_start
    states, answers = [], []
    for reference in references:
        states.append(insertion.state(q))
        answers.append(controller.step(states[-1], reference))
        q = pin.integrate(insertion.arm.model, q, controller.period * answers[-1].v)
    return states, answers


class Geometry:
    """A shaft in the world, from Pinocchio's Jacobian at the world's origin."""

    def __init__(self, insertion: Insertion, state: ArmState) -> None:
        model = insertion.arm.model
        J = np.array(pin.computeJointJacobians(model, model.createData(), state.q))
        self.J_linear, self.J_w, self.insertion = J[:3], J[3:], insertion
        self.R, self.p = np.array(state.oMe.rotation), np.array(state.oMe.translation)
        self.x = state.x

    def J_v(self, point: Array) -> Array:
        """(3, n) velocity of the shaft's material at a point of the world."""
        return np.asarray(self.J_linear - pin.skew(point) @ self.J_w)

    def J_shaft(self, point: Array) -> Array:
        """(3, n) the same without the shaft's spin: beside its axis that changes no distance."""
        z = self.R[:, 2]
        return np.asarray(self.J_v(point) - np.outer(np.cross(z, point - self.p), z @ self.J_w))

    def on_shaft(self, depth: float) -> Array:
        return np.asarray(self.p + depth * self.R[:, 2])

    @property
    def tip(self) -> Array:
        return self.on_shaft(self.insertion.tip_depth)

    @property
    def J_pose(self) -> Array:
        """(8, n) J of (1)."""
        twists = np.vstack([0.0 * self.J_w[:1], self.J_w, 0.0 * self.J_w[:1], self.J_linear])
        return np.column_stack([0.5 * dq.mul(twist, self.x) for twist in twists.T])

    def N(self, x_d: Array) -> Array:
        """(8, n) N of (3)."""
        return np.column_stack([dq.mul(dq.conj(column), x_d) for column in self.J_pose.T])

    def rcm(self, reference: Reference) -> tuple[Array, Array]:
        """Lateral velocity of the shaft at the trocar (2, n), and how far that has to go (2,)."""
        across = self.R[:, :2].T
        return across @ self.J_shaft(reference.pivot), across @ (reference.pivot - self.p)

    def tip_wanted(self, x_d: Array) -> Array:
        """(3,) from the tip to the desired tip."""
        along = dq.rotate(dq.P(x_d), np.array([0.0, 0.0, self.insertion.tip_depth]))
        return np.asarray(dq.translation(x_d) + along - self.tip)


def stacked(insertion: Insertion, state: ArmState, pivot: Array) -> Array:
    """RCM and tip (5, n) in the effector's axes; the RCM's rows are the trocar's, so turned."""
    shaft = Geometry(insertion, state)
    tip = shaft.R.T @ shaft.J_v(shaft.tip)
    return np.vstack([-shaft.R[:, :2].T @ shaft.J_shaft(pivot), tip])


@functools.cache
def helix(name: str, arm: str, feed_forward: bool = False) -> Run:
    scenario = load_scenario("conical_helix", arm, period=PERIOD)
    return simulate(scenario, made(name, scenario.insertion(), PERIOD, feed_forward=feed_forward))
