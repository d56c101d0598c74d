"""Compiled rows say what the tasks and limits in Python say."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import (
    ArmState,
    Insertion,
    Reference,
    Trocar,
    ViewCommand,
    load_scenario,
    view_pose,
)
from rcmqp.controllers import HierarchicalQP
from rcmqp.controllers.hierarchical_qp import default_limits
from rcmqp.controllers.program import LevelOfTasks, Program
from rcmqp.limits import JointLimits, KeepIn, KeepOut, Limit, TrocarCone, TrocarDepth
from rcmqp.qp import HierarchySolution
from rcmqp.tasks import DepthTask, ObjectiveTask, PoseTask, PostureTask, RcmTask, RollTask, TipTask
from rcmqp.tasks.objectives import JointCentring
from rcmqp.world.instrument import vector3

T = 1e-3
ARMS = ("lwa3", "panda", "meka_a2", "kinova")

HELD = {
    "a narrow trocar": {"trocar cone", "trocar depth, deepest", "trocar depth, shallowest"},
    "a moving sphere": {"sphere, tip out"},
}
"""Rows that must have held something back in some cycle."""

Cut = Callable[[Insertion], tuple[list[LevelOfTasks] | None, list[Limit] | None]]


def posture_below_the_tool(insertion: Insertion) -> tuple[list[LevelOfTasks], None]:
    tool = TipTask(insertion.tip_depth, gain=30.0, weight=2.0) + RollTask(weight=0.01)
    return [RcmTask(), tool, PostureTask.made_for(insertion)], None


def a_moving_sphere(insertion: Insertion) -> tuple[None, list[Limit]]:
    beyond = insertion.tip(insertion.x_rcm) - insertion.trocar.pivot + np.array([0.02, 0.0, 0.0])
    sphere = KeepOut(
        centre=vector3("centre", beyond),
        radius=0.02,
        instrument=insertion.instrument,
        tip_depth=insertion.tip_depth,
        velocity=(-0.02, 0.01, -0.02),
        on_trocar=True,
        part="tip",
    )
    return None, [JointLimits(insertion.arm, T, margin=0.01, acceleration=False), sphere]


def pose_above_the_posture(insertion: Insertion) -> tuple[list[LevelOfTasks], None]:
    return [PoseTask(gain=40.0), PostureTask.made_for(insertion)], None


def a_narrow_trocar(insertion: Insertion) -> tuple[None, list[Limit]]:
    depth = insertion.tip_depth
    trocar = dataclasses.replace(
        insertion.trocar, cone_half_angle=0.01, depth_range=(depth - 1e-3, depth + 1e-3)
    )
    return None, [
        JointLimits(insertion.arm, T),
        TrocarCone(trocar, gain=20.0),
        TrocarDepth(trocar, depth, gain=20.0),
    ]


CUTS: dict[str, Cut] = {
    "a narrow trocar": a_narrow_trocar,
    "pose above the posture": pose_above_the_posture,
    "default": lambda insertion: (None, None),
    "posture below the tool": posture_below_the_tool,
    "a moving sphere": a_moving_sphere,
}


def drawn(insertion: Insertion, rng: np.random.Generator) -> tuple[ArmState, Reference]:
    arm = insertion.arm
    angles = insertion.angles_start + 10.0 ** rng.uniform(-4, -0.5) * rng.normal(size=arm.nv)
    v = 10.0 ** rng.uniform(-3, -0.5) * arm.velocity * rng.uniform(-1, 1, size=arm.nv)
    near = insertion.state(arm.configuration(angles + 0.02 * rng.normal(size=arm.nv)))
    pivot = np.array(insertion.trocar.pivot) + 1e-3 * rng.normal(size=3)
    reference = Reference(near.x, 0.1 * rng.normal(size=8), pivot, 0.02 * rng.normal(size=3))
    return insertion.state(arm.configuration(angles), v), reference


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("arm", ARMS)
def test_compiled_rows_give_the_answer_of_the_rows_in_python(arm: str, cut: str) -> None:
    """To rounding; to 1e-6 where the kinova's RCM cannot be reached.

    There its joint 6, which spins the shaft, has an entry of 1e-12 in the RCM's rows, of which
    rounding leaves four digits; levels that are not reached move it by 1e-6 rad/s for that.
    """
    name = "conical_helix" if arm == "kinova" else "obstacle"
    # the Kinova's limits on acceleration are assumed; inside them no state drawn reaches the RCM
    free = math.inf if arm == "kinova" else None
    insertion = load_scenario(name, arm, acceleration=free).insertion()
    rng, active = np.random.default_rng(7), 0
    levels, limits = CUTS[cut](insertion)
    tight = 0
    held: set[str] = set()
    fused, plain = (
        HierarchicalQP(insertion, T, backend="active_set", levels=levels, limits=limits)
        for _ in range(2)
    )
    assert fused._program is not None
    object.__setattr__(plain, "_program", None)
    for _ in range(15):
        cycle = drawn(insertion, rng)
        answer, expected = fused.step(*cycle), plain.step(*cycle)
        one, other = answer.account, expected.account
        assert isinstance(one, HierarchySolution)
        assert isinstance(other, HierarchySolution)
        loose = arm == "kinova" and one.levels[0].name == "rcm" and not one.levels[0].reached
        scale = max(1.0, float(np.abs(expected.v).max()))
        assert_allclose(answer.v, expected.v, rtol=0, atol=(1e-6 if loose else 1e-10) * scale)
        assert one.names == other.names
        assert one.active() == other.active()
        for mine, theirs in zip(one.levels, other.levels, strict=True):
            assert mine.name == theirs.name
            assert_allclose(
                mine.residual, theirs.residual, rtol=1e-9, atol=1e-6 if loose else 1e-9
            )
        assert answer.diagnostics.keys() == expected.diagnostics.keys()
        numbers, others = (list(found.diagnostics.values()) for found in (answer, expected))
        assert_allclose(numbers, others, rtol=1e-9, atol=5e-6 if loose else 1e-9)
        tight += not loose
        active += answer.diagnostics["joints_at_limit"] > 0
        held |= one.active().keys() - set(insertion.arm.joints)
    assert active >= 3
    assert tight >= 8
    assert held >= HELD.get(cut, set())


def test_jerk_counts_from_the_acceleration_of_the_state_in_compiled_code_too() -> None:
    insertion, rng = load_scenario("conical_helix", "panda").insertion(), np.random.default_rng(7)
    insertion.arm.jerk = np.full(insertion.arm.nv, 5000.0)
    fused, plain = (HierarchicalQP(insertion, T, backend="active_set") for _ in range(2))
    object.__setattr__(plain, "_program", None)
    for _ in range(10):
        state, reference = drawn(insertion, rng)
        a = rng.uniform(-1.0, 1.0, 7) * insertion.arm.acceleration
        state = insertion.state(state.q, state.v, a)
        found, expected = fused.step(state, reference), plain.step(state, reference)
        assert_allclose(found.v, expected.v, rtol=0, atol=1e-10)
        change = (found.v - state.v) / T - a
        assert (np.abs(change) <= 5000.0 * T * (1 + 1e-9)).all()
        assert np.abs(change).max() > 0.999 * 5000.0 * T


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_inside_its_margin_is_driven_out_alike(side: float) -> None:
    free = load_scenario("conical_helix", "panda").insertion()
    limits = [JointLimits(free.arm, T, margin=0.01)]
    fused, plain = (HierarchicalQP(free, T, limits=limits) for _ in range(2))
    object.__setattr__(plain, "_program", None)
    for k in range(free.arm.nv):
        angles = free.angles_start.copy()
        angles[k] = (free.arm.upper if side > 0.0 else free.arm.lower)[k] - side * 0.005
        state = free.state(free.arm.configuration(angles))
        reference = view_pose(state.x, ViewCommand())
        found, expected = fused.step(state, reference), plain.step(state, reference)
        assert_allclose(found.v, expected.v, rtol=0, atol=1e-12)
        assert side * found.v[k] < -1e-3


def test_a_shaft_opposite_to_the_trocars_axis_is_turned_back_alike() -> None:
    insertion = load_scenario("conical_helix", "panda").insertion()
    state = insertion.state(insertion.q_start)
    axis = vector3("axis", -state.oMe.rotation[:, 2])
    limits = [JointLimits(insertion.arm, T), TrocarCone(Trocar(insertion.trocar.pivot, axis))]
    reference = view_pose(insertion.x_rcm, ViewCommand())
    fused, plain = (HierarchicalQP(insertion, T, limits=limits) for _ in range(2))
    object.__setattr__(plain, "_program", None)
    found, expected = fused.step(state, reference), plain.step(state, reference)
    assert_allclose(found.v, expected.v, rtol=0, atol=1e-12)
    assert np.abs(found.v).max() > 1e-3


def test_what_compiled_code_does_not_know_is_asked_in_python() -> None:
    insertion = load_scenario("conical_helix", "panda").insertion()
    arm, known = insertion.arm, default_limits(insertion, T, 60.0)
    centring = ObjectiveTask(JointCentring(arm))
    sphere = KeepIn(
        centre=(0.0, 0.0, 0.0), radius=9.0, instrument=insertion.instrument, tip_depth=0.1
    )
    assert Program.of([RcmTask()], known, arm) is not None
    assert Program.of([RcmTask(), DepthTask()], known, arm) is None
    assert Program.of([RcmTask(), centring], known, arm) is None
    assert Program.of([RcmTask()], [*known, sphere], arm) is None
    other = load_scenario("conical_helix", "lwa3").insertion().arm
    assert Program.of([RcmTask()], [JointLimits(other, T)], arm) is None


def test_a_derived_task_is_not_taken_for_the_one_it_derives_from() -> None:
    class Lazy(RcmTask):
        def evaluate(self, state: ArmState, reference: Reference):  # type: ignore[no-untyped-def]
            found = super().evaluate(state, reference)
            return dataclasses.replace(found, error=np.zeros(2))

    class Lame(TrocarCone):
        def pace(self, s: float) -> float:
            return 0.5 * super().pace(s)

    insertion = load_scenario("conical_helix", "panda").insertion()
    assert Program.of([Lazy()], [], insertion.arm) is None
    assert Program.of([], [TrocarCone(insertion.trocar)], insertion.arm) is not None
    assert Program.of([], [Lame(insertion.trocar)], insertion.arm) is None


def test_a_weight_means_nothing_on_a_level_of_its_own() -> None:
    insertion, rng = load_scenario("conical_helix", "panda").insertion(), np.random.default_rng(7)
    cycle = drawn(insertion, rng)
    light, heavy = (
        HierarchicalQP(
            insertion, T, levels=[RcmTask(), TipTask(insertion.tip_depth, weight=weight)]
        ).step(*cycle)
        for weight in (1.0, 1e4)
    )
    assert heavy.diagnostics["tip_residual"] == light.diagnostics["tip_residual"]
    assert np.array_equal(heavy.v, light.v)
