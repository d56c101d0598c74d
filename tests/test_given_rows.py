"""What a task or a limit in Python may give, what is refused, and who may ask."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pytest
from helpers import assert_allclose
from twins import T, cycles, every, insertion_of, usual

from rcmqp import ArmState, Reference, _kernel, load_scenario, simulate
from rcmqp.controllers import HierarchicalQP
from rcmqp.controllers.hierarchical_qp import default_limits
from rcmqp.controllers.stack import LevelOfTasks
from rcmqp.errors import InvalidProblem, OptionError, WrongShape
from rcmqp.limits import Constraint, JointLimits, Limit
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp import HierarchySolution, Level
from rcmqp.tasks import (
    ObjectiveTask,
    PostureTask,
    RcmTask,
    Residual,
    RollTask,
    Task,
    TipTask,
    Together,
)


@dataclass(frozen=True, eq=False)
class Rows(Task):
    """A task whose rows are what a function of the cycle's number gives."""

    give: Callable[[int], Any]
    asked: list[None] = dataclasses.field(default_factory=list)

    def evaluate(self, state: ArmState, reference: Reference) -> Residual:
        self.asked.append(None)
        return cast(Residual, self.give(len(self.asked)))


@dataclass(frozen=True, eq=False)
class Walls(Limit):
    """A limit likewise."""

    give: Callable[[int], Any]
    asked: list[None] = dataclasses.field(default_factory=list)

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        self.asked.append(None)
        return cast(Constraint, self.give(len(self.asked)))


def test_how_many_rows_there_are_may_change_from_cycle_to_cycle() -> None:
    insertion = insertion_of("panda")
    state, reference = next(cycles(insertion))

    def rows(k: int) -> Residual:
        return Residual(np.zeros(k % 3), np.eye(7)[: k % 3], np.ones(k % 3))

    def walls(k: int) -> Constraint:
        return Constraint.rows(
            np.eye(7)[: k % 4], np.ones(k % 4), [f"wall {i}" for i in range(k % 4)]
        )

    limits = [JointLimits(insertion.arm, T), Walls(walls), *default_limits(insertion, T)[1:2]]
    controller = HierarchicalQP(insertion, T, levels=[RcmTask(), Rows(rows)], limits=limits)
    kept = []
    for k in range(1, 13):
        account = controller.step(state, reference).account
        assert isinstance(account, HierarchySolution)
        walls_seen = tuple(f"wall {i}" for i in range(k % 4))
        assert account.names == (*insertion.arm.joints, *walls_seen, "trocar speed")
        assert account.levels[1].residual.size == k % 3
        assert account.violation.size == k % 4 + 1
        kept.append((account, k % 3))
    assert [account.levels[1].residual.size for account, _ in kept] == [m for _, m in kept]


def test_more_rows_than_there_is_room_for_are_refused_with_a_remedy() -> None:
    insertion = insertion_of("panda")
    state, reference = next(cycles(insertion))
    many = np.zeros((6000, 7))
    task = Rows(lambda k: Residual(many[:, 0], many, many[:, 0]))
    with pytest.raises(
        WrongShape, match=r"^Rows.evaluate\(\) gives 6000 rows.* at most 4000 .*give"
    ):
        HierarchicalQP(insertion, T, levels=[RcmTask(), task]).step(state, reference)
    wall = Walls(lambda k: Constraint.rows(many, many[:, 0], ["wall"] * 6000))
    limits = [JointLimits(insertion.arm, T), wall]
    with pytest.raises(
        WrongShape, match=r"^Walls.evaluate\(\) gives 6000 rows.* at most 4000 .*give"
    ):
        HierarchicalQP(insertion, T, limits=limits).step(state, reference)


def test_rows_in_the_way_may_come_and_go() -> None:
    """The active set of the last cycle is of another size then, and forgotten."""
    insertion = insertion_of("panda")
    state, reference = next(cycles(insertion))

    def walls(k: int) -> Constraint:
        m = (5 * k) % 7
        return Constraint.rows(-np.eye(7)[:m], -0.01 * np.ones(m), [f"wall {i}" for i in range(m)])

    levels, limits = usual(insertion)
    mixed = HierarchicalQP(insertion, T, levels=levels, limits=[limits[0], Walls(walls)])
    for k in range(1, 15):
        given = Walls(lambda _, k=k: walls(k))  # type: ignore[misc]
        fresh = HierarchicalQP(insertion, T, levels=levels, limits=[limits[0], given])
        answer = mixed.step(state, reference)
        assert_allclose(answer.v, fresh.step(state, reference).v, rtol=0, atol=1e-9)
        assert isinstance(answer.account, HierarchySolution)
        assert bool((5 * k) % 7) == any(
            name.startswith("wall") for name in answer.account.active()
        )


J = np.eye(2, 7)
E = np.zeros(2)


def nan(shape: int | tuple[int, int]) -> Array:
    return np.full(shape, np.nan)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda k: Residual(nan(2), J, E), r"Rows: b of level 'task'\[0\] is nan"),
        (lambda k: Residual(E, J, -np.inf * np.ones(2)), r"Rows: b of level 'task'\[0\] is inf"),
        (lambda k: Residual(E, nan((2, 7)), E), r"Rows: A of level 'task'\[0, 0\] is nan"),
        (
            lambda k: Residual(E, np.eye(2, 5), E),
            r"level 'task' has 5 unknowns, the bounds have 7",
        ),
        (lambda k: Residual(E, np.eye(3, 7), E), r"Rows: error \(2,\), jacobian \(3, 7\)"),
        (lambda k: None, r"Rows\.evaluate\(\) returned None, it must be a Residual"),
        (lambda k: np.linalg.inv(np.zeros((2, 2))), "LinAlgError: Singular matrix"),
        (lambda k: 1 / 0, "ZeroDivisionError: division by zero"),
    ],
)
def test_rows_of_a_task_that_are_not_usable_end_in_a_safe_stop_that_says_so(
    given: Callable[[int], Any], message: str
) -> None:
    insertion = insertion_of("panda")
    levels, _ = usual(insertion)
    state, reference = next(cycles(insertion))
    for place in (0, 1, 4):
        mixed: list[LevelOfTasks] = [*levels[:place], Rows(give=given), *levels[place:]]
        answer = HierarchicalQP(insertion, T, levels=mixed).step(state, reference)
        with pytest.raises(AssertionError, match=message):
            assert answer.stop == ""
        assert np.isfinite(answer.v).all()
        assert answer.diagnostics["safe_stop"] == 1.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda k: Constraint.rows(nan((1, 7)), [1.0], ["x"]), r"Walls: C\[0, 0\] is nan"),
        (lambda k: Constraint.rows(np.ones((1, 7)), [np.nan], ["x"]), r"Walls: d\[0\] is nan"),
        (lambda k: Constraint.rows(np.ones((1, 7)), [-np.inf], ["x"]), r"Walls: d\[0\] is -inf"),
        (lambda k: Constraint.box([np.inf] * 7, [np.inf] * 7), r"Walls: lower\[0\] is inf"),
        (lambda k: Constraint.box(nan(7), np.ones(7)), r"Walls: lower = .*empty box"),
        (
            lambda k: Constraint.box(np.ones(5), np.ones(5)),
            r"Walls is for 5 joints, the arm has 7",
        ),
        (lambda k: Constraint.rows(np.ones((1, 7)), [1.0], []), r"Walls: C has 1 rows"),
        (lambda k: 3, r"Walls\.evaluate\(\) returned 3, it must be a Constraint"),
        (lambda k: 1 / 0, "ZeroDivisionError"),
    ],
)
def test_rows_of_a_limit_that_are_not_usable_end_in_a_safe_stop_that_says_so(
    given: Callable[[int], Any], message: str
) -> None:
    insertion = insertion_of("panda")
    _, limits = usual(insertion)
    state, reference = next(cycles(insertion))
    for place in (0, 2):
        mixed = [*limits[:place], Walls(give=given), *limits[place:]]
        answer = HierarchicalQP(insertion, T, limits=mixed).step(state, reference)
        with pytest.raises(AssertionError, match=message):
            assert answer.stop == ""
        assert np.isfinite(answer.v).all()


def test_an_error_of_another_kind_is_the_callers() -> None:
    insertion = insertion_of("panda")
    state, reference = next(cycles(insertion))

    def rows(k: int) -> Residual:
        if k == 2:
            raise KeyError("no such thing")
        return Residual(E, J, E)

    controller = HierarchicalQP(insertion, T, levels=[RcmTask(), Rows(rows)])
    before = controller.step(state, reference)
    with pytest.raises(KeyError, match="no such thing"):
        controller.step(state, reference)
    assert np.array_equal(controller.step(state, reference).v, before.v)


def test_a_stop_in_the_middle_of_a_run_is_over_when_the_rows_are_good_again() -> None:
    scenario = load_scenario("conical_helix", "panda", duration=0.05)

    def rows(k: int) -> Residual:
        return Residual(E[:1], J[:1] if k % 20 else nan((1, 7)), E[:1])

    levels = [RcmTask(), TipTask(), Rows(rows)]
    run = simulate(scenario, HierarchicalQP(scenario.insertion(), scenario.period, levels=levels))
    assert sum(map(len, run.stops.values())) == 2
    assert all("A of level" in reason for reason in run.stops)


def test_blocks_for_another_arm_are_refused_when_the_controller_is_made() -> None:
    insertion, other = insertion_of("panda"), insertion_of("meka_a2")
    assert other.arm.nv == 7
    six = load_scenario("conical_helix", "ur5").insertion()
    for options, kind in (
        ({"levels": [RcmTask(), PostureTask.made_for(six)]}, "PostureTask is for 6 joints, panda"),
        ({"limits": [JointLimits(six.arm, T)]}, "JointLimits is for 6 joints, panda has 7"),
        (
            {"levels": [RcmTask(), ObjectiveTask.made_for(six, objective="joint_centring")]},
            "ObjectiveTask is for 6 joints",
        ),
    ):
        with pytest.raises(OptionError, match=kind):
            HierarchicalQP(insertion, T, **cast(Any, options))


def test_a_level_of_ones_own_is_refused_rather_than_not_asked() -> None:
    class Mine(RcmTask):
        def level(self, state: ArmState, reference: Reference) -> Level:
            return super().level(state, reference)

    class Ours(Together):
        def level(self, state: ArmState, reference: Reference) -> Level:
            return super().level(state, reference)

    for level in (Mine(), Mine() + RollTask(), Ours((RcmTask(),))):
        with pytest.raises(
            OptionError, match=r"has a level\(\) of its own, which a step does not"
        ):
            HierarchicalQP(insertion_of("panda"), T, levels=[level])


def test_a_second_step_while_a_backend_is_asked_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    insertion = insertion_of("panda")
    levels, limits = usual(insertion)
    mixed = every(levels, [1])
    controller = HierarchicalQP(insertion, T, levels=mixed, limits=limits, backend="daqp")
    hierarchy, inner = controller._stack._hierarchy, list[BaseException]()

    def curious(*asked: Any) -> Array:
        for call in (controller._stack._compiled.reset, lambda: controller.step(*cycle)):
            try:
                call()
            except RuntimeError as error:
                inner.append(error)
        return np.zeros(len(asked[3]))

    expected = HierarchicalQP(insertion, T, levels=mixed, limits=limits)
    monkeypatch.setattr(hierarchy, "_propose", curious)
    for cycle in cycles(insertion):
        answer = controller.step(*cycle)
        assert_allclose(answer.v, expected.step(*cycle).v, rtol=0, atol=1e-9)
    assert len(inner) >= 2
    assert all("give each thread a controller of its own" in str(error) for error in inner)


def test_threads_with_a_controller_each_do_not_disturb_each_other() -> None:
    insertion = insertion_of("panda")
    levels, limits = usual(insertion)
    asked = list(cycles(insertion))

    def run() -> list[Array]:
        mixed = HierarchicalQP(
            insertion, T, levels=every(levels, [1]), limits=limits, backend="daqp"
        )
        return [mixed.step(*cycle).v for cycle in asked]

    expected, found = run(), list[list[Array]]()
    threads = [threading.Thread(target=lambda: found.append(run())) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    assert all(np.array_equal(one, expected) for one in found)


def test_a_stack_refuses_what_it_cannot_be_made_of_or_stepped_with() -> None:
    stack: Any = _kernel.Stack
    one, roll = np.ones(1), _kernel.Block("roll")
    fits: dict[str, Any] = {
        "levels": ((0.0, ((roll, 1.0, 1.0),)),),
        "limits": (),
        "acceleration": one,
        "jerk": one,
        "share": 0.8,
        "period": T,
        "guarded": 0,
        "max_rounds": 10,
        "names": tuple("abcde"),
    }
    rates = dict.fromkeys(("gain", "deceleration", "jerk", "period"), 1.0)
    cone = _kernel.Block("trocar_cone", **rates, half_angle=1.0, axis=[0, 0, 1], lever=1.0)
    for change, error in (
        ({"names": ("a",)}, ValueError),
        ({"guarded": 2}, ValueError),
        ({"max_rounds": 0}, ValueError),
        ({"jerk": np.ones(2)}, ValueError),
        ({"acceleration": [1.0]}, TypeError),
        ({"levels": (3,)}, TypeError),
        ({"levels": ((0.0, ((cone, 1.0, 1.0),)),)}, TypeError),
        ({"levels": ((0.0, (("roll", 1.0, 1.0),)),)}, TypeError),
        ({"limits": (roll,)}, TypeError),
    ):
        with pytest.raises(error):
            stack(**fits | change)
    made = stack(**fits)
    state = np.eye(8)[0], np.ones((6, 1)), one, one, one
    asked = np.eye(8)[0], np.zeros(8), np.zeros(3), np.zeros(3), (0.0,)
    assert made.step(*state, *asked, [], None)[0].shape == (1,)
    assert made.step(*state, *asked, [3], None) is None
    two = np.eye(8)[0], np.ones((6, 2)), np.ones(2), np.ones(2), np.ones(2)
    with pytest.raises(ValueError, match="a state of 2 joints for 1"):
        made.step(*two, *asked, [], None)
    with pytest.raises(TypeError, match="must be a list"):
        made.step(*state, *asked, None, None)
    with pytest.raises(TypeError, match="x must be a C-contiguous array"):
        made.step("x", *state[1:], *asked, [], None)
    for tool in (None, (), (1,), ("x", np.eye(8)[0], np.ones((6, 1))), (0.1, np.eye(8)[0])):
        with pytest.raises(TypeError, match="tool_at must be"):
            made.step(*state, *asked[:4], tool, [], None)
    with pytest.raises(ValueError, match="J_t has 5 numbers, expected 6"):
        made.step(*state, *asked[:4], (0.1, np.eye(8)[0], np.ones(5)), [], None)
    given = stack(**fits | {"levels": ((0.0, ((None, 1.0, 1.0),)),)})
    rows = one, np.ones((1, 1)), one
    assert given.step(*state, *asked, [rows], None) is not None
    whole = np.ones(1, dtype=int)
    wrong: list[Any] = [3, [*rows], rows[:2], (*rows, one), (1.0, *rows[1:]), (whole, *rows[1:])]
    for each in wrong:
        with pytest.raises(TypeError, match="given rows"):
            given.step(*state, *asked, [each], None)
    unfit: list[Any] = [(np.ones(2), *rows[1:]), (one, np.ones((1, 2)), one), (one, one, one)]
    for each in unfit:
        assert given.step(*state, *asked, [each], None) is None
    assert given.step(*state, *asked, [], None) is None
    with pytest.raises(InvalidProblem):
        Residual([1.0], [[1.0]], [])
