"""Tasks and limits written in Python take part beside compiled ones, as if they were compiled."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose
from twins import T, cycles, every, insertion_of, twin, usual

from rcmqp import Insertion, Reference
from rcmqp.controllers import HierarchicalQP
from rcmqp.controllers.stack import LevelOfTasks
from rcmqp.errors import OptionError
from rcmqp.limits import JointLimits, Limit, TrocarDepth
from rcmqp.limits.base import Constraint
from rcmqp.maths.dualquaternion import Array, from_se3
from rcmqp.qp import Hierarchy, HierarchySolution
from rcmqp.tasks import (
    DepthTask,
    DirectionTask,
    ObjectiveTask,
    PoseTask,
    PostureTask,
    RcmTask,
    RollTask,
    TipTask,
    Together,
)
from rcmqp.tasks.base import Residual, block_of
from rcmqp.world.arm import ArmState

ARMS = ("lwa3", "panda", "meka_a2")


def compared(
    insertion: Insertion,
    levels: list[LevelOfTasks],
    own_levels: list[LevelOfTasks],
    limits: list[Limit],
    own_limits: list[Limit],
    backend: str = "active_set",
) -> tuple[int, set[str]]:
    """How many joints were at a bound in all cycles, and the rows that were active."""
    plain = HierarchicalQP(insertion, T, levels=levels, limits=limits, backend=backend)
    mixed = HierarchicalQP(insertion, T, levels=own_levels, limits=own_limits, backend=backend)
    bounded, active = 0, set[str]()
    assert mixed.diagnostics == plain.diagnostics
    for state, reference in cycles(insertion):
        answer, expected = mixed.step(state, reference), plain.step(state, reference)
        assert not answer.stop
        one, other = answer.account, expected.account
        assert isinstance(one, HierarchySolution)
        assert isinstance(other, HierarchySolution)
        scale = max(1.0, float(np.abs(expected.v).max()))
        assert_allclose(answer.v, expected.v, rtol=0, atol=1e-10 * scale)
        assert one.names == other.names
        assert one.active() == other.active()
        assert [level.name for level in one.levels] == [level.name for level in other.levels]
        for mine, theirs in zip(one.levels, other.levels, strict=True):
            assert_allclose(mine.residual, theirs.residual, rtol=1e-9, atol=1e-9)
        assert mixed.report(state, answer).count("\n") == plain.report(state, expected).count("\n")
        bounded += int(expected.diagnostics["joints_at_limit"])
        active |= one.active().keys() - set(insertion.arm.joints)
    return bounded, active


@pytest.mark.parametrize("chosen", [[0], [1], [2], [3], [0, 2], [0, 1, 2, 3]], ids=str)
@pytest.mark.parametrize("arm", ARMS)
def test_a_task_in_python_gives_the_velocities_of_its_compiled_twin(
    arm: str, chosen: list[int]
) -> None:
    insertion = insertion_of(arm)
    levels, limits = usual(insertion)
    own: list[LevelOfTasks] = [*every(levels, chosen)]
    bounded, _ = compared(insertion, [*levels], own, [limits[0]], [limits[0]])
    assert bounded >= 5


@pytest.mark.parametrize("chosen", [[0], [1], [2], [3], [1, 3], [0, 1, 2, 3]], ids=str)
@pytest.mark.parametrize("arm", ARMS)
def test_a_limit_in_python_gives_the_velocities_of_its_compiled_twin(
    arm: str, chosen: list[int]
) -> None:
    insertion = insertion_of(arm)
    levels, limits = usual(insertion)
    bounded, active = compared(insertion, [*levels], [*levels], limits, every(limits, chosen))
    assert bounded >= 5
    assert {"trocar cone", "trocar depth, deepest", "trocar depth, shallowest"} <= active


@pytest.mark.parametrize("backend", ["proxqp", "daqp"])
def test_every_backend_takes_rows_of_both_kinds(backend: str) -> None:
    insertion = insertion_of("panda")
    levels, limits = usual(insertion)
    own: list[LevelOfTasks] = [*every(levels, [1])]
    bounded, active = compared(insertion, [*levels], own, limits, every(limits, [1]), backend)
    assert bounded >= 5
    assert "trocar cone" in active


def orders(insertion: Insertion) -> dict[str, list[LevelOfTasks]]:
    """Strict below damped, damped on top, shared levels, and every task of the library."""
    tip, posture = TipTask(gain=30.0), PostureTask.made_for(insertion)
    heavy = TipTask(gain=30.0, weight=2.0)
    return {
        "shared": [RcmTask(), heavy + RollTask(weight=0.01), posture],
        "shared with the RCM": [RcmTask() + heavy, RollTask(damping=0.0), posture],
        "posture by weight": [
            RcmTask(period=T),
            RollTask(weight=0.5) + dataclasses.replace(posture, weight=9.0),
        ],
        "strict below": [PoseTask(gain=40.0), RcmTask(), posture],
        "damped objective": [tip, ObjectiveTask.made_for(insertion, damping=0.03)],
        "direction and depth": [RcmTask(period=T), DirectionTask(), DepthTask(), RollTask()],
    }


@pytest.mark.parametrize("order", orders(insertion_of("panda")))
def test_tasks_in_python_take_any_place_and_share_levels_by_their_weights(order: str) -> None:
    insertion = insertion_of("panda")
    levels = orders(insertion)[order]
    box: list[Limit] = [JointLimits(insertion.arm, T)]
    for first in (0, 1):
        own: list[LevelOfTasks] = []
        for k, level in enumerate(levels):
            if isinstance(level, Together):
                own.append(Together((*every(list(level.tasks), [first]),)))
            else:
                own.append(twin(level) if k % 2 == first else level)
        assert any(
            block_of(task) is None
            for level in own
            for task in (level.tasks if isinstance(level, Together) else (level,))
        )
        bounded, _ = compared(insertion, levels, own, box, box)
        assert bounded >= 1


def test_a_step_is_the_solvers_answer_to_the_same_rows_to_the_bit() -> None:
    """Near singularities, too, where rows that differ by rounding have other answers."""
    for arm in ARMS:
        insertion = insertion_of(arm)
        levels, limits = usual(insertion)
        controller = HierarchicalQP(insertion, T, levels=every(levels, [2]), limits=limits)
        hierarchy, rng = Hierarchy("active_set"), np.random.default_rng(7)
        for k, (state, reference) in enumerate(cycles(insertion, 30)):
            if k % 2:
                angles = np.array(state.angles)
                angles[rng.integers(angles.size)] = 10.0 ** rng.uniform(-9.0, -3.0)
                state = insertion.state(insertion.arm.configuration(angles), state.v)
            controller.reset()
            hierarchy.reset()
            answer = controller.step(state, reference)
            assert not answer.stop
            problem = controller.problem(state, reference)
            found = hierarchy.solve(*problem, guarded=1, sluggish=True)
            assert np.array_equal(found.v, answer.v)
            assert isinstance(answer.account, HierarchySolution)
            assert problem[1].names == answer.account.names


def test_without_joint_limits_tasks_brake_with_those_of_the_arm() -> None:
    insertion = insertion_of("panda")
    levels, limits = usual(insertion)
    state = insertion.state(insertion.q_start)
    far = pin.SE3(np.eye(3), np.array([0.01, 0.0, 0.0])) * state.oMe
    reference = Reference(
        from_se3(far), np.zeros(8), np.array(insertion.trocar.pivot), np.zeros(3)
    )
    wanted = {}
    sets: dict[str, list[Limit]] = {
        "box": limits[:1],
        "none": [],
        "own": every(limits[:1], [0]),
        "loose": [JointLimits(insertion.arm, T, acceleration=False)],
    }
    for name, given in sets.items():
        controller = HierarchicalQP(insertion, T, levels=levels[1:2], limits=given)
        wanted[name] = controller.problem(state, reference)[0][0].b
    assert_allclose(wanted["none"], wanted["box"], rtol=0, atol=1e-15)
    assert_allclose(wanted["own"], wanted["box"], rtol=0, atol=1e-15)
    assert np.linalg.norm(wanted["loose"]) > 2.0 * np.linalg.norm(wanted["box"])


@pytest.mark.parametrize("order", orders(insertion_of("panda")))
def test_where_errors_go_in_proportion_the_rows_of_a_step_are_those_of_its_levels(
    order: str,
) -> None:
    insertion = insertion_of("panda")
    levels = orders(insertion)[order]
    controller = HierarchicalQP(insertion, T, levels=levels, approach=0.0)
    for state, reference in cycles(insertion):
        found, _ = controller.problem(state, reference)
        for mine, level in zip(found, levels, strict=True):
            theirs = level.level(state, reference)
            assert (mine.name, mine.damping) == (theirs.name, theirs.damping)
            assert_allclose(mine.A, theirs.A, rtol=0, atol=1e-13)
            assert_allclose(mine.b, theirs.b, rtol=1e-13, atol=1e-13)


def test_an_objectives_velocity_is_asked_for_as_it_is_however_the_arm_moves() -> None:
    insertion = insertion_of("panda")
    for objective in ("manipulability", "joint_centring"):
        task = ObjectiveTask.made_for(insertion, objective=objective, damping=0.03)
        for given in (task, twin(task)):
            controller = HierarchicalQP(insertion, T, levels=[given])
            for state, reference in cycles(insertion):
                found = controller.problem(state, reference)[0][0]
                assert_allclose(found.b, task.level(state, reference).b, rtol=0, atol=1e-10)


class OwnBox(JointLimits):
    """A box that is narrower than it says."""

    def interval(self, angles: Array, v: Array, a: Array) -> tuple[Array, Array]:
        return np.full(7, -1e-6), np.full(7, 1e-6)


class OwnRows(TrocarDepth):
    """A limit that checks by itself."""

    def constraint(self, state: ArmState, reference: Reference) -> Constraint:
        raise AssertionError


class OwnError(TipTask):
    """A task with an error of its own, given in the wrong place."""

    def residual(self, state: ArmState, reference: Reference) -> Residual:
        raise AssertionError


@pytest.mark.parametrize("kind", [OwnBox, OwnRows, OwnError])
def test_a_method_that_a_step_would_pass_over_is_refused(kind: type) -> None:
    insertion = insertion_of("panda")
    levels, limits = usual(insertion)
    if kind is OwnBox:
        limits = [OwnBox(insertion.arm, T), *limits[1:]]
    elif kind is OwnRows:
        limits = [*limits, OwnRows(insertion.trocar)]
    else:
        levels = [levels[0], OwnError()]
    with pytest.raises(OptionError, match=rf"{kind.__name__} has a \w+\(\) of its own, which"):
        HierarchicalQP(insertion, T, levels=levels, limits=limits)


@pytest.mark.parametrize("approach", [-1.0, 2.0, np.nan, np.inf])
def test_an_approach_that_is_no_share_is_refused(approach: float) -> None:
    with pytest.raises(OptionError, match=r"approach = .*, it must be from 0 to 1"):
        HierarchicalQP(insertion_of("panda"), T, approach=approach)
