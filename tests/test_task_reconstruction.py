"""Kim's task reconstruction against finite differences."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, inserted, near_start, shaft_distance, size
from literal_laws import PERIOD, Geometry, follow, made, near, on_each_arm, stacked
from oracles import reconstruction as oracle

from rcmqp import ArmState, Reference, ViewCommand, load_scenario, simulate, view_pose
from rcmqp.controllers.task_priority import TaskReconstruction, manipulability
from rcmqp.maths.dualquaternion import Array


@on_each_arm
def test_the_shafts_jacobian_and_its_derivative_are_those_of_finite_differences(arm: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    model, h = insertion.arm.model, 1e-5
    state = near_start(insertion, rng, 0.5)
    reference = near(state, rng, 0.05)
    J, dJ = oracle.shaft_jacobian(state, reference)
    assert_allclose(J, stacked(insertion, state, reference.pivot), rtol=0, atol=1e-13)

    def at(step: Array) -> Array:
        moved = insertion.state(pin.integrate(model, state.q, step))
        return stacked(insertion, moved, reference.pivot)

    for k, step in enumerate(h * np.eye(model.nv)):
        assert_allclose(dJ[:, :, k], (at(step) - at(-step)) / (2.0 * h), rtol=0, atol=1e-8)


def own_axes(state: ArmState, m: float, g: Array) -> tuple[float, Array]:
    """The measure, and g with the tip's part in the effector's axes, as stacked() has it."""
    return m, np.concatenate([g[:2], state.oMe.rotation.T @ g[2:]])


@on_each_arm
def test_the_compiled_manipulability_is_that_of_its_oracle(arm: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    for scale in (0.05, 0.5) * 20:
        state = near_start(insertion, rng, scale)
        reference = near(state, rng, 0.05)
        m, g = own_axes(state, *manipulability(state, reference))
        expected, g_expected = oracle.manipulability(*oracle.shaft_jacobian(state, reference))
        assert_allclose(m, expected, rtol=1e-9)
        assert_allclose(g, g_expected, rtol=0, atol=1e-9 * size(g_expected))


@pytest.mark.parametrize("elbow", [0.0, 1e-12, 1e-9])
def test_g_points_along_the_direction_that_is_lost_at_a_singularity(elbow: float) -> None:
    """With the elbow straight, nothing moves RCM and tip along the line of the arm."""
    insertion = inserted("lwa3")
    state = insertion.state(insertion.arm.configuration([0.3, 0.5, 0.2, elbow, 0.4, 0.8, 0.1]))
    reference = near(state, np.random.default_rng(7), 0.05)
    J = stacked(insertion, state, reference.pivot)
    U, s, _ = np.linalg.svd(J)
    _, g = own_axes(state, *manipulability(state, reference))
    assert s[4] < 1e-8 < 1e-3 < s[3]
    assert_allclose(abs(g @ U[:, 4]), size(g), rtol=1e-9)


def test_g_points_along_a_direction_in_which_nothing_moves_at_all() -> None:
    insertion, rng = inserted("lwa3"), np.random.default_rng(7)
    J = rng.normal(size=(6, 7))
    J[2] = 0.0  # so the tip's row along the shaft is zero to the bit
    state = insertion.state(insertion.q_start)
    state = dataclasses.replace(state, x=np.eye(8)[0], J_local=J)
    here = Reference(state.x, np.zeros(8), np.array([0.01, 0.02, 0.03]), np.zeros(3))
    m, g = manipulability(state, here)
    assert m == 0.0
    assert size(g) > 0.0
    assert_allclose(abs(g[4]), size(g), rtol=1e-9)


@on_each_arm
def test_g_predicts_how_the_manipulability_changes(arm: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(arm)
    model, h = insertion.arm.model, 1e-5
    for _ in range(5):
        state = near_start(insertion, rng, 0.5)
        reference = near(state, rng, 0.05)
        J = stacked(insertion, state, reference.pivot)
        m, g = own_axes(state, *manipulability(state, reference))
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
        _, g = own_axes(state, *manipulability(state, reference))
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
            manipulability(state, reference)[0]
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
