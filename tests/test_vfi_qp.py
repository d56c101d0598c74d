"""vfi_qp against its quadratic program written down literally."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose, inserted, near_start, nearer, shaft_distance
from literal_laws import PERIOD, Geometry, follow, made, near, on_each_arm
from scipy.optimize import lsq_linear

from rcmqp import (
    ArmState,
    Insertion,
    Reference,
    ViewCommand,
    compute_metrics,
    load_scenario,
    simulate,
    view_pose,
)
from rcmqp.controllers import VfiQP
from rcmqp.controllers.stack import Stack
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp import QP, HierarchySolution, QPSolution, Status, get_solver


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
    assert stopped.stop.startswith(f"{arm.joints[1]} too far beyond a position limit")
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
        expected = made("vfi_qp", insertion, d_safe=2e-3).step(state, reference)
        law = made("vfi_qp", insertion, d_safe=2e-3, solver="daqp")
        assert isinstance(law, VfiQP)
        law._qp.stack._hierarchy._solvers[:] = [liar]
        answer = law.step(state, reference)
        assert answer.diagnostics["safe_stop"] == 0.0
        assert_allclose(answer.v, expected.v, rtol=0, atol=1e-9)
    assert liar.calls > 0


def test_vfi_qp_stops_by_name_where_no_optimum_is_verified(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    reference = near(state, rng, 1e-3)
    law = made("vfi_qp", insertion, d_safe=0.1)
    assert isinstance(law, VfiQP)
    stack = law._qp.stack

    def unsure(*given: Any) -> HierarchySolution:
        solution = Stack.step(stack, *given)
        solution.recorded["exact"] = 0.0
        return solution

    assert law.step(state, reference).v.any()
    monkeypatch.setattr(stack, "step", unsure)
    stopped = law.step(state, reference)
    assert not stopped.v.any()
    assert (stopped.diagnostics["safe_stop"], stopped.diagnostics["infeasible"]) == (1.0, 0.0)
