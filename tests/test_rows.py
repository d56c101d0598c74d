"""Compiled rows of tasks and limits, and objectives, are those of their oracles in numpy."""

from __future__ import annotations

import copy
import functools
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import oracles.limits
import oracles.objectives
import oracles.tasks
import pinocchio as pin
import pytest
from helpers import assert_allclose

from rcmqp import ArmState, Insertion, Reference, _kernel, load_arm
from rcmqp.limits import LIMITS, Damper, JointLimits, Limit, TrocarCone, TrocarDepth, make_limit
from rcmqp.maths.dualquaternion import Array, from_se3
from rcmqp.references.view import cycle
from rcmqp.tasks import (
    TASKS,
    ObjectiveTask,
    PoseTask,
    PostureTask,
    RcmTask,
    Residual,
    Task,
    make_task,
)
from rcmqp.tasks.base import block_of
from rcmqp.tasks.objectives import OBJECTIVES, Manipulability, make_objective
from rcmqp.world.instrument import Instrument

ARMS = ("lwa3", "panda", "ur5", "meka_a2")
T = 1e-3


@functools.cache
def insertion(arm: str) -> Insertion:
    loaded = load_arm(arm)
    return Insertion.on_shaft(loaded, Instrument(), loaded.random_angles(np.random.default_rng(3)))


def cycles(arm: str, count: int = 20) -> Iterator[tuple[ArmState, Reference]]:
    """Anywhere inside the joint limits, moving; every third view on target."""
    rng, inserted = np.random.default_rng(7), insertion(arm)
    nv = inserted.arm.nv
    for k in range(count):
        angles, (v, a) = inserted.arm.random_angles(rng), rng.normal(size=(2, nv))
        state = inserted.state(inserted.arm.configuration(angles), v, a)
        off = pin.exp6((0.0 if k % 3 == 0 else 0.5) * rng.normal(size=6))
        x_d = rng.choice([-1.0, 1.0]) * from_se3(state.oMe * off)
        pivot = state.oMe.act(np.array([*(0.02 * rng.normal(size=2)), 0.1 * rng.normal()]))
        yield state, Reference(x_d, rng.normal(size=8), pivot, rng.normal(size=3))


def tasks(arm: str) -> list[Task]:
    """Every task of the library, with options that are not the usual ones."""
    given: dict[str, Any] = {"rcm": {"period": T}}
    made = [make_task(name, insertion(arm), **given.get(name, {})) for name in TASKS]
    turning = np.arange(insertion(arm).arm.nv) % 2 == 0
    posture = PostureTask(3.0 * np.cos(np.arange(turning.size)), turning)
    others = [make_objective(name, insertion(arm).arm) for name in sorted(OBJECTIVES)[:3]]
    return [*made, RcmTask(), posture, *(ObjectiveTask(c, K_c=3.0, c_d=0.4) for c in others)]


def limits(arm: str, state: ArmState) -> list[Limit]:
    """Every limit of the library, spheres beside the shaft, on it, and beyond its ends."""
    inserted, made = insertion(arm), list[Limit]()
    for name in LIMITS:
        parts: list[dict[str, Any]] = [{}]
        if name in ("keep_out", "keep_in"):
            parts = [{"part": "tip"}, {"part": "shaft"}]
        if name in ("keep_out", "keep_in", "entry_sphere"):
            spots = ([0.05, 0.01, 0.02], [0.0, 0.0, 0.0], [0.0, 0.1, 2.0], [0.03, 0.0, -2.0])
            parts = [
                part
                | {"centre": tuple(state.oMe.act(np.array(spot))), "radius": 0.06}
                | {"velocity": (0.3, -0.2, 0.5), "on_trocar": on}
                for part in parts
                for spot in spots
                for on in (False, True)
            ]
        for part in parts:
            made.append(make_limit(name, inserted, T, **part))
    trocar = replace(inserted.trocar, axis=tuple(-state.oMe.rotation[:, 2]))
    along = replace(inserted.trocar, axis=tuple(state.oMe.rotation[:, 2]))
    depth = TrocarDepth(replace(trocar, depth_range=(0.02, 0.03)), deceleration=0.1)
    return [*made, TrocarCone(trocar), TrocarCone(along), depth]


@pytest.mark.parametrize("arm", ARMS)
def test_tasks_and_objectives_give_the_rows_of_their_oracles(arm: str) -> None:
    for state, reference in cycles(arm):
        for task in tasks(arm):
            found = task.evaluate(state, reference)
            expected = oracles.tasks.residual(task, state, reference)
            for part in ("error", "jacobian", "drift"):
                mine = getattr(found, part)
                assert_allclose(
                    mine, getattr(expected, part), rtol=0, atol=1e-10, err_msg=task.name
                )
                assert not mine.flags.writeable
            assert block_of(task) is not None


@pytest.mark.parametrize("arm", ARMS)
def test_each_row_of_a_limit_has_a_name(arm: str) -> None:
    state, reference = next(cycles(arm))
    for limit in limits(arm, state):
        braking = [replace(limit, deceleration=0.1)] if isinstance(limit, Damper) else []
        for known in (limit, *braking):
            found = known.evaluate(state, reference)
            assert len(found.names) == len(found.d)


@pytest.mark.parametrize("arm", ARMS)
def test_blocks_of_the_published_laws_give_the_rows_of_their_tasks(arm: str) -> None:
    """Entry sphere, rotation, rest, and a point of the shaft, by what other tasks are made of."""
    reach = 0.002
    for state, reference in cycles(arm):
        known, nv = cycle(state, reference), state.angles.size
        rcm, pose = (
            oracles.tasks.residual(task, state, reference) for task in (RcmTask(), PoseTask())
        )
        e, half = rcm.error, slice(0, 4)
        point, shaft = reference.pivot, state.shaft
        expected: dict[str, Any] = {
            "entry": (
                [(e @ e - reach**2) / (2.0 * reach)],
                (e @ rcm.jacobian)[None] / reach,
                [e @ rcm.drift / reach],
            ),
            "rotation": (pose.error[half], pose.jacobian[half], pose.drift[half]),
            "still": (np.zeros(nv), np.eye(nv), np.zeros(nv)),
            "at_trocar": (
                shaft.point(shaft.tip) - point, shaft.jacobian(shaft.tip), -reference.pivot_dot
            ),
        }  # fmt: skip
        for kind, parts in expected.items():
            block = _kernel.Block(kind, **({"reach": reach} if kind == "entry" else {}))
            for mine, part in zip(block.rows(*known), parts, strict=True):
                assert_allclose(mine, part, rtol=0, atol=1e-10, err_msg=kind)


def test_a_goal_reduces_the_error_of_its_task_at_the_gain() -> None:
    for state, reference in cycles("panda"):
        known = cycle(state, reference)
        for task in tasks("panda"):
            block = block_of(task)
            assert block is not None
            error, jacobian, drift = block.rows(*known)
            A, b = block.goal(*known, 50.0)
            assert np.array_equal(A, jacobian)
            assert_allclose(b, -50.0 * error - drift, rtol=0, atol=1e-13)
            assert not any(part.flags.writeable for part in (A, b))
    joints: Any = JointLimits(insertion("panda").arm, T).block
    with pytest.raises(TypeError, match="only a task has a goal"):
        joints.goal(*known, 50.0)
    with pytest.raises(TypeError, match="takes 11 arguments"):
        joints.goal(*known)


@pytest.mark.parametrize("arm", ARMS)
def test_limits_give_the_rows_of_their_oracles(arm: str) -> None:
    kinds = set()
    for state, reference in cycles(arm):
        for limit in limits(arm, state):
            found = limit.evaluate(state, reference)
            expected = oracles.limits.constraint(limit, state, reference)
            for part in ("lower", "upper", "C", "d"):
                mine = getattr(found, part)
                assert_allclose(
                    mine, getattr(expected, part), rtol=0, atol=1e-10, err_msg=limit.name
                )
                assert not mine.flags.writeable
            assert found.names == expected.names
            assert block_of(limit) is not None
            kinds.add(limit.name)
    assert kinds == set(LIMITS)


@pytest.mark.parametrize("name", sorted(OBJECTIVES))
@pytest.mark.parametrize("arm", ["lwa3", "panda", "ur5", "meka_a2"])
def test_objectives_have_the_values_and_gradients_of_their_oracles(arm: str, name: str) -> None:
    if name == "singularity_product" and insertion(arm).arm.srs_offsets is None:
        return
    c = make_objective(name, insertion(arm).arm)
    for state, _ in cycles(arm, 200):
        (found, gradient), (value, expected) = (
            c.evaluate(state),
            oracles.objectives.value(c, state),
        )
        assert_allclose(found, value, rtol=0, atol=1e-13)
        assert_allclose(gradient, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("n", [1, 3, 5])
def test_manipulability_of_fewer_joints_than_six_is_that_of_its_oracle(n: int) -> None:
    rng, state = np.random.default_rng(7), next(cycles("panda"))[0]
    for _ in range(50):
        few = replace(state, J_local=rng.normal(size=(6, n)), angles=np.zeros(n))
        (found, gradient), (value, expected) = (
            Manipulability().evaluate(few),
            oracles.objectives.value(Manipulability(), few),
        )
        assert_allclose(found, value, rtol=1e-12)
        assert_allclose(gradient, expected, rtol=0, atol=1e-12 * max(1.0, value))


def test_a_derived_class_with_rows_of_its_own_is_asked_for_them() -> None:
    class Lazy(RcmTask):
        def evaluate(self, state: ArmState, reference: Reference) -> Residual:
            found = super().evaluate(state, reference)
            return replace(found, error=np.zeros(2))

    class Patient(RcmTask):
        gain: float = 5.0

    @dataclass(frozen=True, eq=False)
    class Lazier(Lazy):
        """No evaluate() of its own."""

    class Mine(Manipulability):
        def evaluate(self, state: ArmState) -> tuple[float, Array]:
            return 1.0, np.zeros(7)

    assert block_of(RcmTask()) is not None
    assert block_of(Patient()) is not None
    assert block_of(Lazy()) is None
    assert block_of(Lazier()) is None
    assert block_of(ObjectiveTask(Manipulability())) is not None
    assert block_of(ObjectiveTask(Mine())) is None
    state, reference = next(cycles("panda"))
    assert not Lazy().evaluate(state, reference).error.any()
    assert not ObjectiveTask(Mine(), c_d=3.0).evaluate(state, reference).drift.any()


def test_a_pace_that_compiled_rows_would_not_ask_is_refused_with_its_class() -> None:
    with pytest.raises(TypeError, match=r"Lame has a pace\(\) of its own.*give it an evaluate"):

        class Lame(TrocarCone):
            def pace(self, s: float) -> float:
                return 0.5 * super().pace(s)


def test_tasks_and_limits_are_copied_and_pickled_with_their_rows() -> None:
    state, reference = next(cycles("panda"))
    posture = PostureTask(np.ones(7))
    _ = posture.block
    for task in (posture, *tasks("panda")[:6]):
        expected = task.evaluate(state, reference)
        for other in (copy.deepcopy(task), pickle.loads(pickle.dumps(task))):
            found = other.evaluate(state, reference)
            assert np.array_equal(found.jacobian, expected.jacobian)
            assert np.array_equal(copy.deepcopy(found).error, expected.error)
    cone = TrocarCone(insertion("panda").trocar)
    rows = cone.evaluate(state, reference)
    other_rows = pickle.loads(pickle.dumps(cone)).evaluate(state, reference)
    assert np.array_equal(pickle.loads(pickle.dumps(rows)).C, other_rows.C)


def test_options_that_are_written_to_later_change_nothing() -> None:
    state, reference = next(cycles("panda"))
    angles, centre = np.ones(7), np.zeros(3)
    posture = PostureTask(angles)
    sphere = make_limit("keep_out", insertion("panda"), T, centre=centre, radius=0.1)
    before = posture.evaluate(state, reference).error, sphere.evaluate(state, reference).d
    angles[:], centre[:] = 3.0, 3.0
    after = posture.evaluate(state, reference).error, sphere.evaluate(state, reference).d
    assert np.array_equal(before[0], after[0])
    assert np.array_equal(before[1], after[1])


def test_a_block_refuses_what_it_cannot_be_made_of_or_asked() -> None:
    block: Any = _kernel.Block
    calls: tuple[tuple[Callable[[], object], type[Exception], str], ...] = (
        (lambda: block("rmc"), ValueError, "unknown kind, rmc"),
        (lambda: block("rcm"), TypeError, "the option period is missing"),
        (lambda: block("rcm", period=1.0, gain=2.0), TypeError, "unknown options"),
        (lambda: block("rcm", period="x"), ValueError, "could not convert"),
        (lambda: block("rcm", period=[1.0, 2.0]), ValueError, "period has 2 numbers"),
        (lambda: block("posture", posture=[], continuous=[]), ValueError, "posture is empty"),
        (lambda: block("posture", posture=[1.0], continuous=[]), ValueError, "has 0 numbers"),
        (lambda: block("singularity_product", offsets=[1.0]), ValueError, "must have 7"),
        (lambda: block("objective", K_c=1.0, c_d=1.0), TypeError, "objective must be the Block"),
        (lambda: block(), TypeError, "Block"),
        (lambda: object.__new__(block), TypeError, "not safe"),
        (lambda: block("manipulability").rows(*[1.0] * 10), TypeError, "has no rows"),
        (lambda: block("roll").value(np.ones((6, 1)), np.ones(1)), TypeError, "only an objective"),
        (lambda: block("roll").rows(1.0), TypeError, "takes 10 arguments"),
        (lambda: block("roll").interval(1.0, 1.0, 1.0), ValueError, "is for joint limits"),
    )
    for call, error, message in calls:
        with pytest.raises(error, match=message):
            call()
    state, reference = next(cycles("ur5"))
    with pytest.raises(ValueError, match="the block is for 7 joints, the arm has 6"):
        JointLimits(insertion("panda").arm, T).block.rows(
            *(state.x, state.J_local, state.angles, state.v, state.a),
            *(reference.x_d, reference.x_d_dot, reference.pivot, reference.pivot_dot),
            (0.1,),
        )
