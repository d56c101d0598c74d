"""weighted_qp against its quadratic program written down literally."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers import assert_allclose, inserted, near_start, size
from literal_laws import made, near, on_each_arm
from oracles.tasks import residual
from scipy.optimize import lsq_linear

from rcmqp import ArmState, Insertion, Reference
from rcmqp.controllers.hierarchical_qp import default_limits
from rcmqp.controllers.one_level import OneLevel
from rcmqp.errors import OptionError
from rcmqp.limits import combine
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp import QP, HierarchySolution, Status, get_solver, solver_names
from rcmqp.tasks import ObjectiveTask, RcmTask, RollTask, TipTask

PERIOD = 1e-3
WEIGHTS = {"rcm_weight": 100.0, "tip_weight": 2.0, "roll_weight": 0.1, "objective_weight": 0.03}
OPTIONS = {"gain": 50.0, "damping": 1e-3, **WEIGHTS}


def cost(insertion: Insertion, state: ArmState, reference: Reference) -> tuple[Array, Array]:
    """What is minimised, as |A v - b|^2."""
    tasks = (RcmTask(), TipTask(), RollTask(), ObjectiveTask.made_for(insertion))
    A, b = [], []
    for task, weight in zip(tasks, WEIGHTS.values(), strict=True):
        found = residual(task, state, reference)
        A.append(np.sqrt(weight) * found.jacobian)
        b.append(np.sqrt(weight) * (-50.0 * found.error - found.drift))
    n = insertion.arm.nv
    return np.vstack([*A, np.sqrt(1e-3) * np.eye(n)]), np.concatenate([*b, np.zeros(n)])


@on_each_arm
def test_weighted_qp_is_bounded_least_squares(arm: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    limits = default_limits(insertion, PERIOD, 60.0)
    law = made("weighted_qp", insertion, PERIOD, **OPTIONS)
    bounded = free = 0
    for scale in [1e-5, 1e-3, 0.02] * 7:
        state = near_start(insertion, rng, 0.05)
        reference = near(state, rng, scale)
        reference = dataclasses.replace(reference, x_d_dot=0.0 * reference.x_d_dot)
        bounds = combine(limits, state, reference)
        A, b = cost(insertion, state, reference)
        expected = lsq_linear(A, b, (bounds.lower, bounds.upper), method="bvls", tol=1e-14).x
        answer = law.step(state, reference)
        assert answer.diagnostics["safe_stop"] == 0.0
        assert (bounds.C @ expected < bounds.d).all()  # no hard row is in the way here
        assert_allclose(answer.v, expected, rtol=0, atol=1e-7 * max(size(expected), 1.0))
        at_bound = np.minimum(answer.v - bounds.lower, bounds.upper - answer.v).min() < 1e-9
        bounded, free = bounded + int(at_bound), free + int(not at_bound)
    assert bounded > 3
    assert free + bounded == 21


@pytest.mark.parametrize("backend", solver_names())
def test_the_backend_does_not_change_the_answer(backend: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    own = made("weighted_qp", insertion, PERIOD)
    other = made("weighted_qp", insertion, PERIOD, backend=backend)
    for _ in range(10):
        state = near_start(insertion, rng)
        reference = near(state, rng, 0.01)
        expected = own.step(state, reference)
        assert expected.diagnostics == other.step(state, reference).diagnostics
        assert_allclose(other.step(state, reference).v, expected.v, rtol=0, atol=1e-8)


def test_weighted_qp_stops_by_name_where_hard_rows_cannot_all_hold() -> None:
    """DAQP, which is not asked, says where that is."""
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    limits = default_limits(insertion, PERIOD, 60.0)
    arm, law, stopped = insertion.arm, made("weighted_qp", insertion, PERIOD, **OPTIONS), 0
    for _ in range(40):
        angles = insertion.angles_start + rng.uniform(-0.3, 0.3, arm.nv)
        v, a = arm.velocity * rng.uniform(-1.0, 1.0, arm.nv), 10.0 * rng.normal(size=arm.nv)
        state = insertion.state(arm.configuration(angles), v, a)
        reference = near(state, rng, 0.05)
        bounds, (A, b) = combine(limits, state, reference), cost(insertion, state, reference)
        qp = QP.build(A.T @ A, -A.T @ b, C=bounds.C, d=bounds.d, lb=bounds.lower, ub=bounds.upper)
        solution, answer = get_solver("daqp").solve(qp), law.step(state, reference)
        assert isinstance(answer.account, HierarchySolution)
        if solution.status is Status.SOLVED:
            assert answer.diagnostics == {"safe_stop": 0.0}
            assert_allclose(answer.v, solution.v, rtol=0, atol=1e-5)
            continue
        assert answer.stop == "the QP has no solution: the inequalities cannot all hold"
        assert answer.diagnostics == {"safe_stop": 1.0}
        assert "exceeded by" in law.report(state, answer)
        stopped += 1
    assert 5 < stopped < 35


def test_one_level_refuses_a_task_that_is_damped() -> None:
    insertion = inserted("lwa3")
    with pytest.raises(OptionError, match=r"^TipTask damped; .*damping=0\.0"):
        OneLevel([TipTask(), RcmTask(damping=0.0)], [], insertion.arm, 1e-3, "active_set")
