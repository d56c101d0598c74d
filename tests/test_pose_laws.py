"""pose_error, damped and task_priority, each against its law written down literally."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from helpers import assert_allclose, inserted, near_start, nearer, size
from literal_laws import Geometry, made, near, on_each_arm

from rcmqp import ArmState, Insertion
from rcmqp.maths import dualquaternion as dq
from rcmqp.tasks.objectives import Manipulability, make_objective


def anywhere(insertion: Insertion, rng: np.random.Generator) -> ArmState:
    arm = insertion.arm
    return insertion.state(arm.configuration(arm.random_angles(rng)))


# pose_error --------------------------------------------------------------------------------


@on_each_arm
def test_pose_error_is_equation_2_with_its_sign_mended(arm: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    for tolerance in (1e-7, 1e-2, 0.1):
        law = made("pose_error", insertion, gain=50.0, tolerance=tolerance)
        for _ in range(10):
            state = anywhere(insertion, rng)
            reference = near(state, rng, 0.3)
            J = Geometry(insertion, state).J_pose
            e = nearer(reference.x_d, state.x) - state.x
            expected = np.linalg.pinv(J, rcond=tolerance) @ (50.0 * e)
            actual = law.step(state, reference).v
            assert_allclose(actual, expected, rtol=0, atol=1e-9 * size(expected))


# damped ------------------------------------------------------------------------------------


@on_each_arm
def test_damped_is_chiaverinis_inverse_written_as_a_matrix(arm: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    damped_more = 0
    for epsilon in (1e-3, 0.05, 0.5):
        options = {"gain": 50.0, "lambda_max": 0.1, "epsilon": epsilon, "beta": 0.02}
        law = made("damped", insertion, **options)
        for _ in range(10):
            state = anywhere(insertion, rng)
            reference = near(state, rng, 0.3)
            x_d = nearer(reference.x_d, state.x)
            N = Geometry(insertion, state).N(x_d)
            e = dq.IDENTITY - dq.mul(dq.conj(state.x), x_d)
            U, s, _ = np.linalg.svd(N)
            u_6, least = U[:, 5], s[5]
            lambda_2 = 0.1**2 * (1.0 - (least / epsilon) ** 2) if least < epsilon else 0.0
            damped_more += lambda_2 > 0.0
            M = N @ N.T + 0.02**2 * np.eye(8) + lambda_2 * np.outer(u_6, u_6)
            expected = N.T @ np.linalg.solve(M, 50.0 * e)
            actual = law.step(state, reference)
            assert_allclose(actual.v, expected, rtol=0, atol=1e-9 * size(expected))
            assert_allclose(actual.diagnostics["least_singular_value"], least, rtol=1e-9)
    assert 0 < damped_more < 30


def test_damped_stays_slow_where_the_plain_inverse_is_fast() -> None:
    insertion = inserted("lwa3")
    angles = (0.0, 0.5, 0.0, 1.2, math.pi / 2, 1.2e-2, 0.0)  # nearly a wrist singularity
    state, rng = insertion.state(insertion.arm.configuration(angles)), np.random.default_rng(7)
    plain, damped = 0.0, 0.0
    for _ in range(20):
        reference = near(state, rng, 1e-3)
        x_d = nearer(reference.x_d, state.x)
        e = dq.IDENTITY - dq.mul(dq.conj(state.x), x_d)
        N = Geometry(insertion, state).N(x_d)
        s = np.linalg.svd(N, compute_uv=False)
        assert 5e-4 < s[5] < 2e-3  # where beta alone would let it go ten times as fast
        assert s[4] > 0.02
        v = made("damped", insertion).step(state, reference).v
        assert size(v) <= 60.0 * size(e) / 0.02  # lambda_max >= epsilon / sqrt(2)
        plain += size(np.linalg.pinv(N, rcond=1e-9) @ (60.0 * e))
        damped += size(v)
    assert plain > 10.0 * damped


# task_priority -----------------------------------------------------------------------------


@on_each_arm
@pytest.mark.parametrize("feed_forward", [False, True])
def test_task_priority_is_the_rcm_first_and_the_tip_in_its_nullspace(
    arm: str, feed_forward: bool
) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    options = {"gain": 50.0, "rcm_gain": 40.0, "tolerance": 1e-9, "feed_forward": feed_forward}
    law = made("task_priority", insertion, **options)
    for _ in range(20):
        state = near_start(insertion, rng)
        reference = near(state, rng)
        shaft = Geometry(insertion, state)
        J_rcm, e_rcm = shaft.rcm(reference)
        J_tip, b_tip = shaft.J_v(shaft.tip), 50.0 * shaft.tip_wanted(reference.x_d)
        b_rcm = 40.0 * e_rcm
        if feed_forward:
            h = 1e-6
            b_rcm = b_rcm + shaft.R[:, :2].T @ reference.pivot_dot
            there, here = (
                shaft.tip_wanted(reference.x_d + sign * h * reference.x_d_dot) for sign in (1, -1)
            )
            b_tip = b_tip + (there - here) / (2.0 * h)
        J_inv = np.linalg.pinv(J_rcm)
        P = np.eye(insertion.arm.nv) - J_inv @ J_rcm
        expected = J_inv @ b_rcm
        expected = expected + np.linalg.pinv(J_tip @ P, rcond=1e-9) @ (b_tip - J_tip @ expected)
        actual = law.step(state, reference).v
        assert_allclose(actual, expected, rtol=0, atol=1e-8 * size(expected))
        assert_allclose(J_rcm @ actual, b_rcm, rtol=0, atol=1e-12)


@on_each_arm
def test_task_priority_keeps_the_rcm_where_the_tip_cannot_follow(arm: str) -> None:
    """The tip at the trocar cannot be moved sideways by an arm that keeps the shaft in it."""
    rng, insertion = np.random.default_rng(7), inserted(arm)
    state = near_start(insertion, rng)
    shaft = Geometry(insertion, state)
    J_tip = shaft.J_v(shaft.tip)
    for offset in (0.0, 1e-7, 1e-3):
        pivot = shaft.tip + offset * shaft.R[:, 0]
        reference = dataclasses.replace(near(state, rng), pivot=pivot)
        J_rcm, e_rcm = shaft.rcm(reference)
        v = made("task_priority", insertion).step(state, reference).v
        assert_allclose(J_rcm @ v, 60.0 * e_rcm, rtol=0, atol=1e-12)
        first = np.linalg.pinv(J_rcm) @ (60.0 * e_rcm)
        missing = size(60.0 * shaft.tip_wanted(reference.x_d) - J_tip @ first)
        assert size(v - first) <= missing / (1e-3 * np.linalg.norm(J_tip, 2))


def test_task_priority_without_feedback_keeps_velocities_only() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    reference = near(state, rng)
    J_rcm, e_rcm = Geometry(insertion, state).rcm(reference)
    v = made("task_priority", insertion, rcm_gain=0.0).step(state, reference).v
    assert size(e_rcm) > 1e-3
    assert_allclose(J_rcm @ v, 0.0, rtol=0, atol=1e-13)


@on_each_arm
def test_task_prioritys_objective_moves_neither_rcm_nor_tip(arm: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    state = near_start(insertion, rng)
    reference, shaft = near(state, rng), Geometry(insertion, state)
    with_c = made("task_priority", insertion, K_c=7.0, objective="manipulability")
    v_0 = (
        with_c.step(state, reference).v - made("task_priority", insertion).step(state, reference).v
    )
    if arm == "ur5":  # of six joints only the one that spins the shaft is left
        assert_allclose(v_0, 0.0, rtol=0, atol=1e-11)
        return
    assert size(v_0) > 1e-4
    for J in (shaft.rcm(reference)[0], shaft.J_v(shaft.tip)):
        assert_allclose(J @ v_0, 0.0, rtol=0, atol=1e-11 * size(v_0))
    assert Manipulability().evaluate(state)[1] @ v_0 > 0.0


def test_task_prioritys_objective_is_the_arms_own_where_none_is_named() -> None:
    rng = np.random.default_rng(7)
    for arm, own in (("lwa3", "singularity_product"), ("ur5", "manipulability")):
        state = near_start(inserted(arm), rng)
        reference = near(state, rng)
        unnamed, named = (
            made("task_priority", inserted(arm), K_c=7.0, objective=objective).step(
                state, reference
            )
            for objective in ("", own)
        )
        assert np.array_equal(unnamed.v, named.v)
        assert make_objective(own, inserted(arm).arm) is not None
