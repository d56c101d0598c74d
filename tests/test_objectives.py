from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, derivative

from rcmqp import Arm, arm_names, load_arm
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array
from rcmqp.tasks.objectives import OBJECTIVES, Objective, make_objective

load = functools.cache(load_arm)


def applies(objective: str, arm: Arm) -> bool:
    return objective != "singularity_product" or arm.srs_offsets is not None


@pytest.mark.parametrize(
    ("name", "arm_name"),
    [(o, a) for o in sorted(OBJECTIVES) for a in arm_names() if applies(o, load(a))],
)
def test_gradient_is_the_derivative_of_the_value(name: str, arm_name: str) -> None:
    rng = np.random.default_rng(7)
    arm = load(arm_name)
    objective = make_objective(name, arm)
    assert isinstance(objective, Objective)
    for _ in range(3):
        q = arm.configuration(arm.random_angles(rng))

        def value(t: float, v: Array, q: Array = q) -> float:
            return objective.evaluate(arm.state(pin.integrate(arm.model, q, t * v)))[0]

        c, gradient = objective.evaluate(arm.state(q))
        expected = [derivative(functools.partial(value, v=v), 1e-4) for v in np.eye(arm.nv)]
        assert np.isfinite(c)
        assert gradient.shape == (arm.nv,)
        assert_allclose(gradient, expected, rtol=0, atol=1e-7)


def test_an_unknown_objective_is_answered_with_the_nearest_name(lwa3: Arm) -> None:
    with pytest.raises(UnknownName, match=r"objective 'manipulabilty'; did you mean manip"):
        make_objective("manipulabilty", lwa3)


# Jacobian measures -------------------------------------------------------------------------


def test_manipulability_and_least_singular_value_are_those_of_the_jacobian(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    for _ in range(5):
        state = arm.state(arm.configuration(arm.random_angles(rng)))
        J = state.J_world_aligned  # the measures do not depend on the axes
        yoshikawa = np.sqrt(np.linalg.det(J @ J.T))
        least = np.sqrt(np.linalg.eigvalsh(J @ J.T)[0])
        for name, expected in (("manipulability", yoshikawa), ("least_singular_value", least)):
            value, _ = make_objective(name, arm).evaluate(state)
            assert value == pytest.approx(expected, abs=1e-9)


def test_manipulability_is_finite_where_the_arm_is_singular(lwa3: Arm) -> None:
    value, gradient = make_objective("manipulability", lwa3).evaluate(lwa3.state(np.zeros(7)))
    assert value < 1e-15
    assert np.isfinite(gradient).all()


# The product for spherical-revolute-spherical arms -----------------------------------------

SINGULAR_SETS = {  # joints of the straight-at-zero arm held at angles; the others are free
    "elbow straight": {3: 0.0},
    "shoulder": {1: 0.0, 2: np.pi / 2},
    "wrist": {5: np.pi, 4: -np.pi / 2},
    "shoulder and wrist in line": {1: np.pi, 5: 0.0},
}


@pytest.mark.parametrize("held", SINGULAR_SETS.values(), ids=SINGULAR_SETS.keys())
@pytest.mark.parametrize(
    ("arm_name", "singular"),
    [("lwa3", 1e-12), ("meka_a2", 0.03)],  # the Meka's offsets are small
)
def test_product_is_zero_where_the_arm_is_singular(
    arm_name: str, singular: float, held: dict[int, float]
) -> None:
    rng = np.random.default_rng(7)
    arm = load(arm_name)
    assert arm.srs_offsets is not None
    for _ in range(10):
        theta = rng.uniform(-np.pi, np.pi, 7)
        theta[list(held)] = list(held.values())
        state = arm.state(theta - arm.srs_offsets)
        value, _ = make_objective("singularity_product", arm).evaluate(state)
        assert abs(value) < 1e-15
        assert np.linalg.svd(state.J_local, compute_uv=False)[-1] < singular


def test_product_is_positive_where_the_arm_is_not_singular_and_at_most_1(lwa3: Arm) -> None:
    rng = np.random.default_rng(7)
    objective = make_objective("singularity_product", lwa3)
    for _ in range(300):
        state = lwa3.state(rng.uniform(-np.pi, np.pi, 7))
        value, gradient = objective.evaluate(state)
        least = np.linalg.svd(state.J_local, compute_uv=False)[-1]
        assert 0.0 <= value <= 1.0
        assert value > 0.05 * least**2
        assert gradient[0] == gradient[6] == 0.0  # the base and the last joint change nothing


def test_product_is_1_at_its_best(lwa3: Arm) -> None:
    theta = [0.4, np.pi / 2, -0.7, -np.pi / 2, 1.1, np.pi / 2, 0.2]
    value, gradient = make_objective("singularity_product", lwa3).evaluate(lwa3.state(theta))
    assert value == pytest.approx(1.0, abs=1e-15)
    assert_allclose(gradient, 0.0, rtol=0, atol=1e-15)


def test_product_counts_angles_from_where_the_arm_is_straight(lwa3: Arm) -> None:
    rng = np.random.default_rng(7)
    theta, offsets = rng.uniform(-1, 1, (2, 7))
    shifted = Arm(lwa3.model, lwa3.flange, name="shifted", srs_offsets=offsets)
    s, c = np.sin(theta), np.cos(theta)
    expected = s[3] ** 2 * (1 - c[1] ** 2 * s[2] ** 2) * (1 - c[5] ** 2 * s[4] ** 2)
    expected *= 1 - c[1] ** 2 * c[5] ** 2
    for q, arm in ((theta, lwa3), (theta - offsets, shifted)):
        value, _ = make_objective("singularity_product", arm).evaluate(arm.state(q))
        assert value == pytest.approx(expected, abs=1e-15)


def test_product_is_refused_for_other_arms() -> None:
    with pytest.raises(
        OptionError, match=r"panda is no spherical-revolute-spherical arm .*manipulability"
    ):
        make_objective("singularity_product", load("panda"))


# Joint centring ----------------------------------------------------------------------------


def test_centring_is_1_in_the_middle_and_0_at_every_limit(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    objective, limited = make_objective("joint_centring", arm), np.isfinite(arm.upper)
    anywhere = rng.uniform(-3, 3, arm.nv)  # continuous joints do not count
    low, high = (np.where(limited, limit, 0.0) for limit in (arm.lower, arm.upper))
    for angles, expected in (((low + high) / 2, 1.0), (low, 0.0), (high, 0.0)):
        state = arm.state(arm.configuration(np.where(limited, angles, anywhere)))
        value, gradient = objective.evaluate(state)
        assert value == pytest.approx(expected, abs=1e-14)
        assert not gradient[~limited].any()
        inwards = np.sign((low + high) / 2 - angles)[limited]
        assert np.array_equal(np.sign(np.round(gradient[limited], 14)), inwards)


def test_centring_is_refused_where_no_joint_has_limits(lwa3: Arm) -> None:
    model = lwa3.model.copy()
    model.lowerPositionLimit, model.upperPositionLimit = np.full(7, -np.inf), np.full(7, np.inf)
    with pytest.raises(OptionError, match="free has no position limits"):
        make_objective("joint_centring", Arm(model, "flange", name="free"))
