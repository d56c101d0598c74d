"""Aghakhani's controller against its law written down literally."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose, inserted, near_start, size
from literal_laws import PERIOD, Geometry, follow, made, near, on_each_arm, quick_helix

from rcmqp import ArmState, Insertion, Reference
from rcmqp.controllers import Aghakhani
from rcmqp.maths.dualquaternion import Array


def extended(insertion: Insertion, state: ArmState, pivot: Array, lam: float | None) -> Any:
    """J_t 0, J_rcm, p_rcm and lambda; lambda from the projection if it is not given."""
    shaft = Geometry(insertion, state)
    p_i = shaft.on_shaft(insertion.tip_depth - insertion.instrument.length)
    p_next = shaft.tip
    if lam is None:
        lam = float((pivot - p_i) @ (p_next - p_i)) / size(p_next - p_i) ** 2
    J_i, J_next = shaft.J_v(p_i), shaft.J_v(p_next)
    J_rcm = np.column_stack([J_i + lam * (J_next - J_i), p_next - p_i])
    J_t = np.column_stack([J_next, np.zeros(3)])
    return J_t, J_rcm, p_i + lam * (p_next - p_i), lam


@on_each_arm
@pytest.mark.parametrize("rcm_first", [False, True])
@pytest.mark.parametrize("reproject", [False, True])
def test_aghakhani_is_the_paper_law_with_lambda_integrated(
    arm: str, rcm_first: bool, reproject: bool
) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    options = {"gain": 50.0, "rcm_gain": 40.0, "lambda_gain": 5.0, "lambda_rest": 0.3}
    switches = {"rcm_first": rcm_first, "reproject": reproject, "tolerance": 1e-9}
    law, lam = made("aghakhani", insertion, **options, **switches), None
    for _ in range(5):  # states that do not follow from each other: lambda is what is carried on
        state = near_start(insertion, rng, 0.1)
        reference = near(state, rng)
        J_t, J_rcm, p_rcm, lam = extended(insertion, state, reference.pivot, lam)
        b_t = 50.0 * Geometry(insertion, state).tip_wanted(reference.x_d)
        b_rcm = 40.0 * (reference.pivot - p_rcm)
        w = np.append(np.zeros(insertion.arm.nv), 5.0 * (0.3 - lam))
        J, one = np.vstack([J_t, J_rcm]), np.eye(w.size)
        J_inv = np.linalg.pinv(J, rcond=1e-9)
        if rcm_first:
            J_rcm_inv = np.linalg.pinv(J_rcm)
            u = J_rcm_inv @ b_rcm
            lower = np.linalg.pinv(J_t @ (one - J_rcm_inv @ J_rcm), rcond=1e-9)
            u = u + lower @ (b_t - J_t @ u)
        else:
            u = J_inv @ np.concatenate([b_t, b_rcm])
        u = u + (one - J_inv @ J) @ w
        answer = law.step(state, reference)
        assert_allclose(answer.v, u[:-1], rtol=0, atol=1e-8 * size(u))
        assert_allclose(answer.diagnostics["lambda"], lam, rtol=0, atol=1e-9 * abs(lam))
        lam = None if reproject else lam + PERIOD * u[-1]


def test_aghakhani_feeds_both_velocities_forward() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    reference, shaft = near(state, rng), Geometry(insertion, state)
    with_rates, without = (
        made("aghakhani", insertion, feed_forward=on).step(state, reference).v
        for on in (True, False)
    )
    still = dataclasses.replace(reference, x_d_dot=np.zeros(8), pivot_dot=np.zeros(3))
    assert np.array_equal(without, made("aghakhani", insertion).step(state, still).v)
    h = 1e-6
    ahead = shaft.tip_wanted(reference.x_d + h * reference.x_d_dot)
    behind = shaft.tip_wanted(reference.x_d - h * reference.x_d_dot)
    extra = shaft.J_v(shaft.tip) @ (with_rates - without)
    assert_allclose(extra, (ahead - behind) / (2.0 * h), rtol=0, atol=1e-9)
    lateral = shaft.R[:, :2].T @ shaft.J_v(foot(shaft, reference)) @ (with_rates - without)
    assert_allclose(lateral, shaft.R[:, :2].T @ reference.pivot_dot, rtol=0, atol=1e-9)


def foot(shaft: Geometry, reference: Reference) -> Array:
    """The point of the shaft's line nearest to the trocar."""
    return shaft.on_shaft(float(shaft.R[:, 2] @ (reference.pivot - shaft.p)))


def test_aghakhanis_lambda_is_fixed_by_tip_and_rcm_whatever_w() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    first, second = near(state, rng), near(state, rng)
    lambdas, speeds = [], []
    for lambda_gain in (0.0, 50.0):
        law = made("aghakhani", insertion, lambda_gain=lambda_gain)
        speeds.append(law.step(state, first).v)
        lambdas.append(law.step(state, second).diagnostics["lambda"])
    assert_allclose(lambdas[0], lambdas[1], rtol=0, atol=1e-9)
    assert not np.array_equal(speeds[0], speeds[1])  # w turns what is free of the arm


def test_aghakhanis_reset_forgets_lambda() -> None:
    insertion = inserted("ur5")
    law = made("aghakhani", insertion)
    assert isinstance(law, Aghakhani)
    _, answers = follow(law, quick_helix(insertion))
    assert answers[0].diagnostics["lambda"] != answers[-1].diagnostics["lambda"]
    law.reset()
    _, again = follow(law, quick_helix(insertion, count=1))
    assert again[0].diagnostics == answers[0].diagnostics
