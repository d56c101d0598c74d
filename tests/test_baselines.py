"""Controllers from the literature: each against its law written down literally.

The literal laws take their Jacobians from Pinocchio in the world's axes, and their inverses from
numpy's pinv and solve; only the product of dual quaternions is the package's own.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, shaft_distance
from scipy.optimize import lsq_linear

from rcmqp import (
    ArmState,
    Command,
    Controller,
    Insertion,
    Reference,
    Run,
    ViewCommand,
    compute_metrics,
    load_scenario,
    make_controller,
    simulate,
    view_pose,
)
from rcmqp.controllers import Aghakhani, TaskPriority, VfiQP
from rcmqp.controllers.task_reconstruction import (
    TaskReconstruction,
    manipulability,
    shaft_jacobian,
)
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp import (
    QP,
    Bounds,
    HierarchySolution,
    Level,
    QPSolution,
    Status,
    get_solver,
)
from rcmqp.qp.levels import ROUTES, Route
from rcmqp.references.paths import ConicalHelix
from rcmqp.tasks.objectives import Manipulability, make_objective

PERIOD = 8e-3
ARMS = ["lwa3", "meka_a2", "ur5"]
BASELINES = [
    "pose_error",
    "damped",
    "task_priority",
    "task_reconstruction",
    "aghakhani",
    "vfi_qp",
]
VARIANTS: list[tuple[str, dict[str, Any]]] = [
    *((name, {"feed_forward": True}) for name in BASELINES),
    ("task_priority", {"K_c": 7.0}),
    ("task_priority", {"reconstruct_from": 20.0, "escape": 1e-3}),
    ("task_reconstruction", {"reconstruct_from": 20.0, "escape": 1e-3}),
    ("task_priority", {"rcm_gain": 0.0}),
    ("aghakhani", {"rcm_first": True}),
    ("aghakhani", {"reproject": True}),
    ("aghakhani", {"lambda_gain": 5.0}),
    ("vfi_qp", {"velocity_limits": True}),
    ("vfi_qp", {"solver": "daqp"}),
    ("vfi_qp", {"damping": 0.01, "d_safe": 1e-4}),
    ("vfi_qp", {"gain": 10.0, "damping": 0.01, "joint_gain": 1.0}),  # as its authors' code
]

on_each_arm = pytest.mark.parametrize("arm", ARMS)
each_baseline = pytest.mark.parametrize("name", BASELINES)
each_variant = pytest.mark.parametrize(
    ("name", "options"),
    VARIANTS,
    ids=[f"{name}-{'-'.join(options)}" for name, options in VARIANTS],
)


# What the tests start from -----------------------------------------------------------------


@functools.cache
def inserted(arm: str) -> Insertion:
    return load_scenario("conical_helix", arm).insertion()


def made(name: str, insertion: Insertion, period: float = PERIOD, **options: Any) -> Controller:
    return make_controller(name, insertion, period, **options)


def near_start(insertion: Insertion, rng: np.random.Generator, spread: float = 0.2) -> ArmState:
    angles = insertion.angles_start + rng.uniform(-spread, spread, insertion.arm.nv)
    return insertion.state(insertion.arm.configuration(angles))


def anywhere(insertion: Insertion, rng: np.random.Generator) -> ArmState:
    arm = insertion.arm
    return insertion.state(arm.configuration(arm.random_angles(rng)))


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


def size(v: Array) -> float:
    return float(np.linalg.norm(v))


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


def nearer(x_d: Array, x: Array) -> Array:
    return x_d if x_d[:4] @ x[:4] >= 0.0 else -x_d


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


# aghakhani ---------------------------------------------------------------------------------


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


# vfi_qp ------------------------------------------------------------------------------------


def objective_rows(
    insertion: Insertion,
    state: ArmState,
    reference: Reference,
    *,
    eta: float,
    alpha: float,
    damping: float,
) -> tuple[Array, Array]:
    """The objective as |A u - b|^2."""
    shaft = Geometry(insertion, state)
    r, r_d = dq.P(state.x), dq.P(nearer(reference.x_d, state.x))
    J_r = shaft.J_pose[:4]
    columns = [dq.quaternion_mul(dq.quaternion_conj(column), r_d) for column in J_r.T]
    N_r = np.column_stack(columns)  # H-(r_d) C_4 J_r
    e_r = dq.quaternion_mul(dq.quaternion_conj(r), r_d) - np.eye(4)[0]
    J_t, e_t = shaft.J_v(shaft.tip), -shaft.tip_wanted(reference.x_d)
    a, b = math.sqrt(alpha), math.sqrt(1.0 - alpha)
    A = np.vstack([a * J_t, b * N_r, damping * np.eye(insertion.arm.nv)])
    return A, -np.concatenate([a * eta * e_t, b * eta * e_r, np.zeros(insertion.arm.nv)])


WEIGHTS = {"alpha": 0.9, "damping": 0.05}
VFI_OPTIONS = {"gain": 50.0, **WEIGHTS}


@on_each_arm
@pytest.mark.parametrize("velocity_limits", [False, True])
@pytest.mark.parametrize(("joint_gain", "eta_q"), [(0.0, 50.0), (50.0, 50.0), (1.0, 1.0)])
def test_vfi_qp_in_a_wide_sphere_is_bounded_least_squares(
    arm: str, joint_gain: float, eta_q: float, velocity_limits: bool
) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    limits = insertion.arm
    given = {"joint_gain": joint_gain, "velocity_limits": velocity_limits, **VFI_OPTIONS}
    law = made("vfi_qp", insertion, d_safe=1e3, **given)
    bounded = 0
    for scale in [0.01, 0.1] * 5:
        angles = insertion.angles_start + rng.uniform(-0.2, 0.2, limits.nv)
        angles[-1] = limits.upper[-1] - 1e-3  # where a joint row is in the way at any gain
        state = insertion.state(limits.configuration(angles))
        reference = near(state, rng, scale)
        lower = eta_q * (limits.lower - state.angles)
        upper = eta_q * (limits.upper - state.angles)
        if velocity_limits:
            lower, upper = np.maximum(lower, -limits.velocity), np.minimum(upper, limits.velocity)
        A, b = objective_rows(insertion, state, reference, eta=50.0, **WEIGHTS)
        expected = lsq_linear(A, b, (lower, upper), method="bvls", tol=1e-14).x
        answer = law.step(state, reference)
        assert answer.diagnostics["safe_stop"] == 0.0
        assert_allclose(answer.v, expected, rtol=0, atol=1e-5)
        assert ((lower <= answer.v) & (answer.v <= upper)).all()
        bounded += int((np.minimum(answer.v - lower, upper - answer.v) < 1e-7).any())
    assert bounded > 0


def squared_distance(insertion: Insertion, angles: Array, pivot: Array) -> float:
    state = insertion.state(insertion.arm.configuration(angles))
    return shaft_distance(state.oMe, pivot) ** 2


@on_each_arm
@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_vfi_qp_meets_the_entry_spheres_inequality_and_no_more(arm: str, solver: str) -> None:
    """At the optimum the objective's gradient is what the active row takes, no other."""
    rng, insertion = np.random.default_rng(7), inserted(arm)
    d_safe, eta_d, h = 2e-3, 3.0, 1e-6
    given = {"d_safe": d_safe, "vfi_gain": eta_d, "joint_gain": 1.0, **VFI_OPTIONS}
    law = made("vfi_qp", insertion, solver=solver, **given)
    active = 0
    for _ in range(20):
        state = near_start(insertion, rng, 0.05)
        reference = near(state, rng, 1.5e-3)
        pivot, angles = reference.pivot, state.angles
        J_D = np.array(
            [
                squared_distance(insertion, angles + step, pivot)
                - squared_distance(insertion, angles - step, pivot)
                for step in h * np.eye(insertion.arm.nv)
            ]
        ) / (2.0 * h)
        room = eta_d * (d_safe**2 - squared_distance(insertion, angles, pivot))
        answer = law.step(state, reference)
        assert answer.diagnostics["safe_stop"] == 0.0
        slack = room - J_D @ answer.v
        assert slack > -1e-9
        assert_allclose(answer.diagnostics["sphere_slack"], slack / (2 * d_safe), atol=1e-6)
        A, b = objective_rows(insertion, state, reference, eta=50.0, **WEIGHTS)
        gradient = A.T @ (A @ answer.v - b)
        low, high = insertion.arm.lower - angles, insertion.arm.upper - angles
        free = (answer.v > low + 1e-9) & (answer.v < high - 1e-9)
        if slack < 1e-8:
            active += 1
            z = -(gradient[free] @ J_D[free]) / (J_D[free] @ J_D[free])
            assert z > 0.0
            gradient = gradient + z * J_D
        assert_allclose(gradient[free], 0.0, rtol=0, atol=1e-7)
        assert (np.where(answer.v < 0.0, gradient, -gradient)[~free] > 0.0).all()
    assert 0 < active < 20


@pytest.mark.parametrize("arm", ["lwa3", "ur5"])
def test_vfi_qp_stays_in_its_sphere_and_uses_it(arm: str) -> None:
    scenario = load_scenario("conical_helix", arm, duration=8.0, period=PERIOD)
    law = made("vfi_qp", scenario.insertion(), damping=0.01, d_safe=2e-4)
    run = simulate(scenario, law)
    assert 1.9e-4 < run.rcm_error.max() < 2.06e-4  # second order in T is outside
    assert run.diagnostics["safe_stop"].max() == 0.0


@on_each_arm
def test_vfi_qp_comes_back_into_the_sphere_at_its_gain(arm: str) -> None:
    insertion = inserted(arm)
    start = insertion.state(insertion.q_start)
    pivot = start.oMe.act(np.array([3e-3, 0.0, 0.0]))
    reference = Reference(start.x, np.zeros(8), pivot, np.zeros(3))
    law = made("vfi_qp", insertion, d_safe=1e-3, velocity_limits=True)
    states, _ = follow(law, [reference] * 500)
    D = np.array([shaft_distance(state.oMe, pivot) ** 2 for state in states])
    excess = D - 1e-6
    assert_allclose(excess[1:100], excess[:99] * (1.0 - 2.0 * PERIOD), rtol=0, atol=2e-8)
    assert 0.0 <= excess[-1] < 5e-3 * excess[0]


@pytest.mark.parametrize(("arm", "most"), [("lwa3", 0.06), ("panda", 0.3)])
def test_vfi_qp_keeps_the_trocar_where_its_joint_rows_are_as_fast_as_the_task(
    arm: str, most: float
) -> None:
    scenario = load_scenario("fast_helix", arm)
    task, slow = (
        compute_metrics(
            simulate(scenario, made("vfi_qp", scenario.insertion(), scenario.period, **options))
        )
        for options in ({}, {"joint_gain": 1.0})
    )
    assert task.rcm_max_mm < most
    assert task.reversals_in_a_row <= 1
    assert slow.rcm_max_mm > 5.0
    assert slow.reversals_in_a_row > 10
    assert slow.acceleration_ratio_max > 10.0 * task.acceleration_ratio_max


def test_vfi_qps_joint_rows_never_overstep_a_limit_in_one_period() -> None:
    insertion = inserted("lwa3")
    arm, T = insertion.arm, 0.02  # gain T = 1.2: the task's gain would go past the limit
    angles = insertion.angles_start.copy()
    angles[6] = arm.upper[6] - 0.01
    state = insertion.state(arm.configuration(angles))
    x_d = dq.mul(state.x, dq.exp(np.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0])))
    reference = Reference(x_d, np.zeros(8), dq.translation(state.x), np.zeros(3))
    v = made("vfi_qp", insertion, T).step(state, reference).v
    assert_allclose(T * v[6], 0.01, rtol=0, atol=1e-9)


def test_vfi_qp_stops_by_name_where_limits_contradict_each_other() -> None:
    insertion = inserted("lwa3")
    arm = insertion.arm
    beyond = insertion.angles_start.copy()
    beyond[1] = arm.upper[1] + 1.01 * arm.velocity[1]  # back within 1 s needs more than it can
    state = insertion.state(arm.configuration(beyond))
    reference = Reference(state.x, np.zeros(8), dq.translation(state.x), np.zeros(3))
    stopped = made("vfi_qp", insertion, velocity_limits=True).step(state, reference)
    assert np.array_equal(stopped.v, np.zeros(7))
    assert stopped.diagnostics["safe_stop"] == stopped.diagnostics["infeasible"] == 1.0
    assert made("vfi_qp", insertion).step(state, reference).diagnostics["safe_stop"] == 0.0


@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_vfi_qp_stops_by_name_where_the_sphere_is_out_of_reach(solver: str) -> None:
    insertion = inserted("lwa3")
    state = insertion.state(insertion.q_start)
    pivot = state.oMe.act(np.array([10.0, 0.0, 0.0]))
    reference = Reference(state.x, np.zeros(8), pivot, np.zeros(3))
    law = made("vfi_qp", insertion, velocity_limits=True, solver=solver)
    for _ in range(3):
        stopped = law.step(state, reference)
        assert np.array_equal(stopped.v, np.zeros(7))
        assert stopped.diagnostics["safe_stop"] == stopped.diagnostics["infeasible"] == 1.0
    home = view_pose(insertion.x_rcm, ViewCommand())
    assert law.step(state, home).diagnostics["safe_stop"] == 0.0  # and goes on afterwards


class Liar:
    """A backend that answers with the wrong minimiser, or with none."""

    def __init__(self, status: Status) -> None:
        self.calls, self.status, self.honest = 0, status, get_solver("daqp")

    def solve(self, qp: QP) -> QPSolution:
        self.calls += 1
        solution = self.honest.solve(qp)
        if self.status is Status.SOLVED:
            return dataclasses.replace(solution, v=solution.v + 0.1, z=0.0 * solution.z)
        return QPSolution.failed(qp, self.status, 0.0, "no")

    def reset(self) -> None:
        pass


@pytest.mark.parametrize("status", list(Status))
def test_vfi_qp_finds_the_optimum_though_its_backend_lies(status: Status) -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    liar = Liar(status)
    for _ in range(20):
        state = near_start(insertion, rng)
        reference = near(state, rng, 1e-3)
        law = made("vfi_qp", insertion, d_safe=2e-3)
        expected = law.step(state, reference)
        assert isinstance(law, VfiQP)
        law.reset()
        law._hierarchy._solvers[:] = [liar]
        answer = law.step(state, reference)
        assert answer.diagnostics["safe_stop"] == 0.0
        assert_allclose(answer.v, expected.v, rtol=0, atol=1e-9)
    assert liar.calls > 0


def test_vfi_qp_stops_by_name_where_no_optimum_is_verified() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    reference = near(state, rng, 1e-3)
    law = made("vfi_qp", insertion, d_safe=0.1)
    assert isinstance(law, VfiQP)
    hierarchy = law._hierarchy

    class Unsure:
        def solve(self, levels: list[Level], bounds: Bounds) -> HierarchySolution:
            found = hierarchy.solve(levels, bounds)
            found._answer.numbers.setflags(write=True)
            found._answer.info[1, 0] = ROUTES.index(Route.UNVERIFIED)
            return found

    assert law.step(state, reference).v.any()
    object.__setattr__(law, "_hierarchy", Unsure())
    stopped = law.step(state, reference)
    assert not stopped.v.any()
    assert (stopped.diagnostics["safe_stop"], stopped.diagnostics["infeasible"]) == (1.0, 0.0)


# Task reconstruction -----------------------------------------------------------------------


def stacked(insertion: Insertion, state: ArmState, pivot: Array) -> Array:
    """RCM and tip (5, n) in the effector's axes; the RCM's rows are the trocar's, so turned."""
    shaft = Geometry(insertion, state)
    tip = shaft.R.T @ shaft.J_v(shaft.tip)
    return np.vstack([-shaft.R[:, :2].T @ shaft.J_shaft(pivot), tip])


@on_each_arm
def test_the_shafts_jacobian_and_its_derivative_are_those_of_finite_differences(arm: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    model, h = insertion.arm.model, 1e-5
    state = near_start(insertion, rng, 0.5)
    reference = near(state, rng, 0.05)
    J, dJ = shaft_jacobian(state, reference, insertion.tip_depth)
    assert_allclose(J, stacked(insertion, state, reference.pivot), rtol=0, atol=1e-13)

    def at(step: Array) -> Array:
        moved = insertion.state(pin.integrate(model, state.q, step))
        return stacked(insertion, moved, reference.pivot)

    for k, step in enumerate(h * np.eye(model.nv)):
        assert_allclose(dJ[:, :, k], (at(step) - at(-step)) / (2.0 * h), rtol=0, atol=1e-8)


@on_each_arm
def test_g_predicts_how_the_manipulability_changes(arm: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    model, h = insertion.arm.model, 1e-5
    for _ in range(5):
        state = near_start(insertion, rng, 0.5)
        reference = near(state, rng, 0.05)
        J = stacked(insertion, state, reference.pivot)
        m, g = manipulability(*shaft_jacobian(state, reference, insertion.tip_depth))
        assert_allclose(m, math.sqrt(np.linalg.det(J @ J.T)), rtol=1e-9)
        wanted = rng.normal(size=5)

        def measure(
            step: Array, state: ArmState = state, reference: Reference = reference
        ) -> float:
            moved = insertion.state(pin.integrate(model, state.q, step))
            there = stacked(insertion, moved, reference.pivot)
            return math.sqrt(np.linalg.det(there @ there.T))

        v = h * np.linalg.pinv(J) @ wanted
        assert_allclose(g @ wanted, (measure(v) - measure(-v)) / (2.0 * h), rtol=1e-5, atol=1e-9)


def test_reconstruction_takes_out_only_what_leads_into_the_singularity() -> None:
    rng, kim = np.random.default_rng(7), TaskReconstruction(m_1=2.0, m_2=1.0)
    for _ in range(20):
        g, wanted = rng.normal(size=3), rng.normal(size=3)
        n = g / size(g)
        away, towards = wanted + n * (1.0 - n @ wanted), wanted - n * (1.0 + n @ wanted)
        for m in (0.0, 0.5, 1.5, 2.0, 3.0):
            assert np.array_equal(kim.reconstruct(away, m, g), away)
        for m, k in ((3.0, 0.0), (2.0, 0.0), (1.75, 0.25), (1.0, 1.0), (0.3, 1.0), (0.0, 1.0)):
            assert_allclose(kim.reconstruct(towards, m, g), towards + k * n, rtol=0, atol=1e-14)
        escaping = TaskReconstruction(m_1=2.0, m_2=1.0, escape=0.4)
        for m, k_2 in ((1.0, 0.0), (0.5, 0.2), (0.0, 0.4)):
            expected = kim.reconstruct(towards, m, g) + k_2 * n
            assert_allclose(escaping.reconstruct(towards, m, g), expected, rtol=0, atol=1e-14)
    assert np.array_equal(kim.reconstruct(wanted, 0.5, np.zeros(3)), wanted)


@on_each_arm
def test_reconstruction_stops_the_tips_share_of_the_fall_and_leaves_the_rcm(arm: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    changed = 0
    for _ in range(20):
        state = near_start(insertion, rng)
        reference = near(state, rng)
        shaft = Geometry(insertion, state)
        J_rcm, e_rcm = shaft.rcm(reference)
        plain, kim = (
            made("task_priority", insertion, reconstruct_from=share).step(state, reference).v
            for share in (0.0, 1e6)
        )
        for v in (plain, kim):
            assert_allclose(J_rcm @ v, 60.0 * e_rcm, rtol=0, atol=1e-13 * max(size(v), 1.0))
        J = stacked(insertion, state, reference.pivot)
        _, g = manipulability(*shaft_jacobian(state, reference, insertion.tip_depth))
        before, after = (float(g[2:] @ (J @ v)[2:]) for v in (plain, kim))
        assert_allclose(after, max(before, 0.0), rtol=0, atol=1e-9 * size(g))
        changed += before < 0.0
    assert 0 < changed < 20


def test_the_law_of_task_reconstruction_is_task_priority_away_from_singularities() -> None:
    for scenario_name, same in (("conical_helix", True), ("near_singularity", False)):
        scenario = load_scenario(scenario_name, "panda", period=PERIOD)
        insertion = scenario.insertion()
        plain, kim, option = (
            simulate(scenario, made(name, insertion, **options)).q
            for name, options in (
                ("task_priority", {}),
                ("task_reconstruction", {}),
                ("task_priority", {"reconstruct_from": 0.5}),
            )
        )
        assert np.array_equal(kim, option)
        assert np.array_equal(kim, plain) == same


def test_reconstruction_holds_the_arm_off_the_end_of_its_reach() -> None:
    insertion, T = inserted("meka_a2"), 5e-3
    times = T * np.arange(1600)
    deeper = [view_pose(insertion.x_rcm, ViewCommand(t_z=min(0.05 * t, 0.5))) for t in times]

    def pushed(**options: float) -> tuple[Array, float, float]:
        law = made("task_priority", insertion, T, **options)
        states, answers = follow(law, deeper)
        m = [
            manipulability(*shaft_jacobian(state, reference, insertion.tip_depth))[0]
            for state, reference in zip(states, deeper, strict=True)
        ]
        pivot = deeper[0].pivot
        rcm = max(shaft_distance(state.oMe, pivot) for state in states)
        fastest = max(np.max(np.abs(a.v) / insertion.arm.velocity) for a in answers)
        return np.array(m), rcm, fastest

    m, rcm, fastest = pushed()
    assert m.min() < 0.05 * m.max()
    assert rcm > 1e-3
    assert fastest > 50.0
    m, rcm, fastest = pushed(reconstruct_from=10.0)
    assert_allclose(m[-1], 5.0 * m[0], rtol=1e-6)  # m_2, to which the fall comes to rest
    assert m.argmax() < 1500
    assert rcm < 1e-5
    assert fastest < 2.0


# The equivalence on a task that can be done --------------------------------------------------


@functools.cache
def helix(name: str, arm: str, feed_forward: bool = False) -> Run:
    scenario = load_scenario("conical_helix", arm, period=PERIOD)
    return simulate(scenario, made(name, scenario.insertion(), PERIOD, feed_forward=feed_forward))


@each_baseline
@on_each_arm
def test_on_the_helix_the_tip_lags_by_speed_over_gain_and_the_rcm_is_kept(
    name: str, arm: str
) -> None:
    metrics = compute_metrics(helix(name, arm))
    assert_allclose(metrics.tip_rms_mm, metrics.tip_speed_rms_mm_s / 60.0, rtol=0.01)
    assert 0.32 < metrics.tip_rms_mm < 0.35
    assert metrics.rcm_max_mm < (0.03 if name == "vfi_qp" else 0.003)
    assert metrics.speed_ratio_max < 1.0
    assert metrics.limit_margin_min_rad > 0.0
    if name == "vfi_qp":
        assert helix(name, arm).diagnostics["safe_stop"].max() == 0.0


@each_baseline
def test_feed_forward_takes_the_lag_away(name: str) -> None:
    metrics = compute_metrics(helix(name, "ur5", feed_forward=True))
    assert metrics.tip_rms_mm < 0.004
    assert metrics.rcm_max_mm < (0.03 if name == "vfi_qp" else 0.003)


@each_baseline
def test_a_breathing_trocar_is_followed_where_its_velocity_is_known(name: str) -> None:
    """1 cm at 0.5 Hz: without the velocity, each law lags by 31 mm/s over K, 0.5 mm."""
    insertion, T, w = inserted("ur5"), 4e-3, math.pi
    across, references = dq.rotate(dq.P(insertion.x_rcm), np.array([0.6, 0.8, 0.0])), []
    for t in T * np.arange(500):
        offset = 0.01 * math.sin(w * t) * across
        x_rcm = dq.mul(dq.from_translation(offset), insertion.x_rcm)
        velocity = 0.01 * w * math.cos(w * t) * across
        references.append(view_pose(x_rcm, ViewCommand(), velocity))

    def worst(feed_forward: bool) -> float:
        law = made(name, insertion, T, feed_forward=feed_forward)
        states, _ = follow(law, references)
        pairs = list(zip(states, references, strict=True))[100:]
        return max(shaft_distance(state.oMe, reference.pivot) for state, reference in pairs)

    assert 4.5e-4 < worst(False) < 5.5e-4
    assert worst(True) < 1e-5


# Promises of every variant -----------------------------------------------------------------


@each_variant
@on_each_arm
def test_variants_are_finite_and_rerun_to_the_bit(
    name: str, options: dict[str, Any], arm: str
) -> None:
    insertion = inserted(arm)
    law, references = made(name, insertion, **options), quick_helix(insertion)
    _, answers = follow(law, references)
    law.reset()
    _, again = follow(law, references)
    _, fresh = follow(made(name, insertion, **options), references)
    for one, two, three in zip(answers, again, fresh, strict=True):
        assert np.isfinite(one.v).all()
        assert all(math.isfinite(value) for value in one.diagnostics.values())
        assert np.array_equal(one.v, two.v)
        assert np.array_equal(one.v, three.v)
        assert one.diagnostics == two.diagnostics == three.diagnostics
        assert one.diagnostics.keys() == answers[0].diagnostics.keys()


@each_variant
def test_variants_take_minus_x_d_for_x_d_and_share_no_memory(
    name: str, options: dict[str, Any]
) -> None:
    insertion = inserted("lwa3")
    references = quick_helix(insertion)
    negative = [dataclasses.replace(r, x_d=-r.x_d, x_d_dot=-r.x_d_dot) for r in references]
    states, answers = follow(made(name, insertion, **options), references)
    _, other = follow(made(name, insertion, **options), negative)
    for one, two in zip(answers, other, strict=True):
        assert_allclose(one.v, two.v, rtol=0, atol=1e-12)
    for before, after in itertools.pairwise(answers):
        assert not np.shares_memory(before.v, after.v)
    for state, reference, answer in zip(states, references, answers, strict=True):
        given = (state.q, state.angles, state.x, state.J_local, insertion.arm.velocity)
        mine = (reference.x_d, reference.x_d_dot, reference.pivot, reference.pivot_dot)
        assert not any(np.shares_memory(answer.v, array) for array in (*given, *mine))


# Refusals ----------------------------------------------------------------------------------


@each_baseline
@pytest.mark.parametrize("gain", [0.0, -1.0, 250.0, math.nan, math.inf])
def test_an_unstable_gain_is_refused_with_the_number(name: str, gain: float) -> None:
    if 0.0 < gain < math.inf:
        message = rf"= {gain * PERIOD:.3g}, it must be below 2, or the law is unstable"
    else:
        message = f"gain = {gain} 1/s, it must be positive and finite"
    with pytest.raises(OptionError, match=message):
        made(name, inserted("lwa3"), gain=gain)


BAD_OPTIONS: Sequence[tuple[str, str, float]] = [
    ("pose_error", "tolerance", 0.0),
    ("pose_error", "tolerance", 1.0),
    ("damped", "lambda_max", 0.0),
    ("damped", "epsilon", -1.0),
    ("damped", "beta", 0.0),
    ("damped", "beta", math.nan),
    ("task_priority", "rcm_gain", -1.0),
    ("task_priority", "rcm_gain", math.nan),
    ("task_priority", "tolerance", math.nan),
    ("task_priority", "K_c", -1.0),
    ("task_priority", "c_d", math.inf),
    ("task_priority", "reconstruct_from", math.inf),
    ("task_priority", "reconstruct_full", 1.0),
    ("task_priority", "escape", -1.0),
    ("aghakhani", "rcm_gain", 0.0),
    ("aghakhani", "lambda_gain", 300.0),
    ("aghakhani", "lambda_rest", 2.0),
    ("aghakhani", "tolerance", 0.0),
    ("vfi_qp", "alpha", 0.0),
    ("vfi_qp", "alpha", 1.0),
    ("vfi_qp", "damping", 0.0),
    ("vfi_qp", "d_safe", math.inf),
    ("vfi_qp", "vfi_gain", 0.0),
    ("vfi_qp", "vfi_gain", 126.0),
    ("vfi_qp", "joint_gain", -1.0),
    ("vfi_qp", "joint_gain", 126.0),
]


@pytest.mark.parametrize(("name", "option", "value"), BAD_OPTIONS)
def test_an_option_out_of_range_is_refused_by_its_name(
    name: str, option: str, value: float
) -> None:
    with pytest.raises(OptionError, match=rf"\b{option}( \* period)? = {value}"):
        made(name, inserted("lwa3"), **{option: value})


@pytest.mark.parametrize(
    ("name", "option", "value", "hint"),
    [
        ("vfi_qp", "solver", "proxpq", "did you mean proxqp"),
        ("task_priority", "objective", "manipulabilty", "did you mean manipulability"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest(
    name: str, option: str, value: str, hint: str
) -> None:
    with pytest.raises(UnknownName, match=hint):
        made(name, inserted("lwa3"), **{option: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("numbers", [(1.0, 1.0), (1.0, 0.0), (1.0, 2.0), (math.nan, 0.5)])
def test_thresholds_in_the_wrong_order_are_refused(numbers: tuple[float, float]) -> None:
    with pytest.raises(
        OptionError, match=r"m_1 = nan|m_2 = .*it must be (positive|below m_1 = 1.0)"
    ):
        TaskReconstruction(*numbers)


def test_reconstructions_thresholds_are_shares_of_the_start() -> None:
    insertion = inserted("lwa3")
    law = made("task_priority", insertion, reconstruct_from=0.4, reconstruct_full=0.25)
    assert isinstance(law, TaskPriority)
    kim = law._reconstruction
    assert kim is not None
    state = insertion.state(insertion.q_start)
    J = stacked(insertion, state, np.array(insertion.trocar.pivot))
    m = math.sqrt(np.linalg.det(J @ J.T))
    assert_allclose([kim.m_1, kim.m_2], [0.4 * m, 0.1 * m], rtol=1e-9)
