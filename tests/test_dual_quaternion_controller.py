"""The paper's law (6): what it computes, and each mend of the printed text.

The tests named test_printed_* show, slip by slip, that the paper's text fails as it is printed,
and that the mend is what makes it work.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, inserted, near_start, nearer, size
from paper_law import (
    PERIOD,
    SEVEN_JOINTS,
    controller,
    error,
    matrix_N,
    moved,
    pose_jacobian,
    still,
)

from rcmqp import ArmState, Insertion, Instrument, arm_names, load_arm, make_controller
from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array, angle_between, translation
from rcmqp.tasks.objectives import OBJECTIVES, make_objective

PAN = "shoulder_pan_joint"
SIX_JOINTS = [name for name in arm_names() if load_arm(name).nv == 6]


def law(
    insertion: Insertion,
    state: ArmState,
    x_d: Array,
    objective: str = "manipulability",
    *,
    K: float = 60.0,
    K_c: float = 7.0,
    c_d: float = 1.0,
    tolerance: float = 1e-7,
) -> Array:
    """The law (6) without its T, for x_d on the side of x."""
    N = matrix_N(insertion, state, x_d)
    N_inv = np.linalg.pinv(N, rcond=tolerance)
    P = np.eye(N.shape[1]) - np.linalg.pinv(N, rcond=1e-12) @ N
    c, J_c = make_objective(objective, insertion.arm).evaluate(state)
    answer: Array = N_inv @ (K * error(state, x_d)) + P @ (K_c * J_c.T * (c_d - c))
    return answer


def walk(
    insertion: Insertion, start: ArmState, steps: int, step: Callable[[ArmState], Array]
) -> list[ArmState]:
    """States under theta(k + 1) = theta(k) + step(state(k)); x_eff turns on without a jump."""
    states = [start]
    for _ in range(steps):
        last = states[-1]
        state = insertion.state(pin.integrate(insertion.arm.model, last.q, step(last)))
        states.append(dataclasses.replace(state, x=nearer(state.x, last.x)))
    return states


def pose_error(state: ArmState, x_d: Array) -> float:
    """Distance in metres plus angle in radians."""
    distance = size(translation(state.x) - translation(x_d))
    return distance + float(angle_between(state.x, x_d))


# The law -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", arm_names())
def test_the_law_is_equation_6_read_literally(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    for tolerance in (1e-7, 1e-2, 0.1):  # from nothing given up to a great deal
        options: dict[str, Any] = {"K_c": 3.0, "c_d": 0.4, "tolerance": tolerance}
        law_under_test = controller(insertion, gain=50.0, objective="manipulability", **options)
        for _ in range(10):
            q = insertion.arm.configuration(insertion.arm.random_angles(rng))
            state = insertion.state(q)
            x_d = moved(state, rng.normal(scale=0.3, size=6))
            expected = law(insertion, state, x_d, K=50.0, **options)
            actual = law_under_test.step(state, still(x_d)).v
            assert_allclose(actual, expected, rtol=0, atol=1e-9 * size(expected))


@pytest.mark.parametrize("name", arm_names())
def test_the_pose_error_decays_at_the_gain(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    state = near_start(insertion, rng)
    x_d = moved(state, 1e-4 * rng.normal(size=6))
    h = 1e-6  # so short that the Euler step's own error does not count
    v = controller(insertion, K_c=0.0).step(state, still(x_d)).v
    (_, after) = walk(insertion, state, 1, lambda _: h * v)
    rate = (pose_error(state, x_d) - pose_error(after, x_d)) / (h * pose_error(state, x_d))
    assert_allclose(rate, 60.0, rtol=1e-3)


@pytest.mark.parametrize("name", arm_names())
def test_the_error_is_answered_in_full_within_the_range_of_N(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    state = near_start(insertion, rng)
    for shift, angle in ((0.02, 0.0), (0.0, 0.05)):
        x_d = moved(state, np.array([shift, 0.0, shift, angle, 0.0, 0.0]))
        N, wanted = matrix_N(insertion, state, x_d), 60.0 * error(state, x_d)
        left = wanted - N @ controller(insertion).step(state, still(x_d)).v
        assert_allclose(N.T @ left, 0.0, rtol=0, atol=1e-11)
        # What N cannot reach is what unit length forbids, of second order in the angle.
        beyond = 60.0 * (1.0 - math.cos(angle / 2))
        assert_allclose(size(left), beyond, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("name", arm_names())
def test_the_sign_of_the_arms_own_pose_does_not_matter(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    state = near_start(insertion, rng)
    x_d = moved(state, rng.normal(scale=0.1, size=6))
    other = dataclasses.replace(state, x=-state.x)
    a, b = (controller(insertion).step(s, still(x_d)).v for s in (state, other))
    assert_allclose(a, b, rtol=0, atol=1e-12 * size(a))


# The slips of the printed text, and their mends ---------------------------------------------


def test_printed_equation_6_without_T_diverges() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    start = near_start(insertion, rng)
    x_d = moved(start, 1e-6 * rng.normal(size=6))

    def errors(T: float) -> list[float]:
        states = walk(insertion, start, 3, lambda s: T * law(insertion, s, x_d, K_c=0.0))
        return [pose_error(state, x_d) for state in states]

    printed, mended = errors(1.0), errors(PERIOD)
    assert_allclose(np.divide(printed[1:], printed[:-1]), 59.0, rtol=0.05)  # |1 - K|
    assert_allclose(np.divide(mended[1:], mended[:-1]), 0.52, rtol=0.01)  # 1 - K T


def test_printed_sign_of_equation_2_runs_away_from_the_view() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    start = near_start(insertion, rng)
    x_d = moved(start, 1e-3 * rng.normal(size=6))

    def final_error(sign: float) -> float:
        def step(state: ArmState) -> Array:
            J_inv = np.linalg.pinv(pose_jacobian(insertion, state), rcond=1e-3)
            return np.asarray(PERIOD * 60.0 * J_inv @ (sign * (state.x - x_d)))

        return pose_error(walk(insertion, start, 10, step)[-1], x_d)

    printed, mended = final_error(+1.0), final_error(-1.0)
    assert printed > 10.0 * pose_error(start, x_d)
    assert mended < 0.01 * pose_error(start, x_d)


def test_printed_projector_has_the_wrong_size() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    N, z = matrix_N(insertion, state, state.x), rng.normal(size=7)
    N_inv = np.linalg.pinv(N, rcond=1e-3)
    with pytest.raises(ValueError, match=r"size 7 is different from 8"):
        (np.eye(8) - N @ N_inv) @ z
    mended = (np.eye(7) - N_inv @ N) @ z
    assert size(mended) > 0.1
    assert_allclose(N @ mended, 0.0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["lwa3", "meka_a2"])
def test_printed_sign_of_the_objective_runs_away_from_c_d(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    start = near_start(insertion, rng)
    objective = make_objective("singularity_product", insertion.arm)

    def final_objective(sign: float) -> float:
        def step(state: ArmState) -> Array:
            x_d = nearer(start.x, state.x)
            return PERIOD * law(insertion, state, x_d, "singularity_product", K_c=sign * 7.0)

        return objective.evaluate(walk(insertion, start, 50, step)[-1])[0]

    printed, mended = final_objective(-1.0), final_objective(+1.0)
    assert printed < objective.evaluate(start)[0] - 1e-3
    assert mended > objective.evaluate(start)[0] + 1e-3


def test_printed_law_unwinds_more_than_300_degrees_for_minus_x_d() -> None:
    insertion = inserted("lwa3")
    start = insertion.state(insertion.q_start)
    x_d = -moved(start, np.array([0.005, 0.0, 0.0, 0.0, 0.0, 0.05]))  # 5 mm and 2.9 degrees

    def travelled(step: Callable[[ArmState], Array]) -> float:
        states = walk(insertion, start, 400, step)
        x = np.array([state.x for state in states])
        assert pose_error(states[-1], x_d) < 1e-6  # both get there
        return math.degrees(angle_between(x[1:], x[:-1]).sum())

    quiet = controller(insertion, K_c=0.0)
    printed = travelled(lambda state: 1e-3 * law(insertion, state, x_d, K_c=0.0))
    mended = travelled(lambda state: 1e-3 * quiet.step(state, still(x_d)).v)
    assert printed > 300.0
    assert mended < 3.0


# The nullspace -----------------------------------------------------------------------------


def objectives_of(arm: str) -> list[str]:
    srs = load_arm(arm).srs_offsets is not None
    return [name for name in OBJECTIVES if srs or name != "singularity_product"]


@pytest.mark.parametrize(
    ("name", "objective"), [(name, c) for name in SEVEN_JOINTS for c in objectives_of(name)]
)
@pytest.mark.parametrize("c_d", [10.0, -10.0])
def test_the_nullspace_term_serves_its_objective_and_leaves_the_pose_alone(
    name: str, objective: str, c_d: float
) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    state = near_start(insertion, rng)
    with_c, without_c = (
        controller(insertion, objective=objective, K_c=K_c, c_d=c_d).step(state, still(state.x)).v
        for K_c in (7.0, 0.0)
    )
    v_0 = with_c - without_c
    N = matrix_N(insertion, state, state.x)
    assert size(v_0) > 1e-3
    assert size(N @ v_0) <= 1e-12 * size(v_0)

    c = make_objective(objective, insertion.arm)
    h = 1e-5 / size(v_0)
    after, before = (
        c.evaluate(insertion.state(insertion.arm.integrate(state.q, v_0, sign * h)))[0]
        for sign in (1.0, -1.0)
    )
    assert (after - before) * c_d > 0.0  # up to a c_d above it, down to one below


@pytest.mark.parametrize("name", SIX_JOINTS)
def test_six_joints_have_no_nullspace(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    state = near_start(insertion, rng)
    with_c, without_c = (
        controller(insertion, K_c=K_c).step(state, still(state.x)).v for K_c in (7.0, 0.0)
    )
    assert_allclose(with_c, without_c, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", SEVEN_JOINTS)
@pytest.mark.parametrize("options", [{}, {"damping": 0.05}, {"tolerance": 0.05}], ids=str)
def test_the_nullspace_term_leaves_every_pose_alone(name: str, options: dict[str, float]) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    with_c = controller(insertion, **options)
    without = controller(insertion, K_c=0.0, **options)
    for _ in range(300):
        state = insertion.state(insertion.arm.configuration(insertion.arm.random_angles(rng)))
        v_0 = with_c.step(state, still(state.x)).v - without.step(state, still(state.x)).v
        N = matrix_N(insertion, state, state.x)
        assert size(N @ v_0) <= 1e-12 * max(1.0, size(v_0))


def test_an_arm_of_five_joints_is_refused() -> None:
    urdf = load_arm("ur5").urdf
    arm = load_arm(str(urdf), "tool0", home=[-1.6, 1.4, -1.4, -1.6, 0.0], locked={PAN: 0.0})
    insertion = Insertion.on_shaft(arm, Instrument())
    said = r"has 5 joints; dual_quaternion .* needs six or more; hierarchical_qp"
    with pytest.raises(OptionError, match=said):
        make_controller("dual_quaternion", insertion, PERIOD)
