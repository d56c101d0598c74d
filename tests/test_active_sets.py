"""What the active sets of the last call do to the next one: they save rounds and nothing else."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from rcmqp.maths.dualquaternion import Array
from rcmqp.qp import Bounds, Hierarchy, HierarchySolution, Level, get_solver
from rcmqp.qp.hierarchy import propose
from rcmqp.qp.levels import Route

DAMPINGS = (0.0, 0.02, 0.03)
"""Of RCM, tip and roll: as the levels of a controller are."""


def drifting(cycles: int, limit: float = 0.3) -> list[tuple[list[Level], Bounds]]:
    """Problems that change a little from one to the next, bounds in the way in most of them."""
    rng = np.random.default_rng(5)
    n, sizes = 7, (2, 3, 1)
    A, turn = rng.normal(size=(2, sum(sizes), n))
    b, way = rng.normal(size=(2, sum(sizes)))
    low, up = -limit * rng.uniform(0.3, 1.0, n), limit * rng.uniform(0.3, 1.0, n)
    hard = rng.normal(size=(2, n)), np.full(2, 0.3)
    ends = np.cumsum(sizes)
    problems = []
    for t in np.linspace(0.0, 3.0, cycles):
        rows = np.split(A + np.sin(t) * turn, ends[:-1])
        goals = np.split(b * np.cos(2.0 * t) + way * np.sin(3.0 * t), ends[:-1])
        levels = [
            Level(row, goal, damping=damping)
            for row, goal, damping in zip(rows, goals, DAMPINGS, strict=True)
        ]
        problems.append((levels, Bounds(low, up, *hard)))
    return problems


def solved(hierarchy: Hierarchy, problem: tuple[list[Level], Bounds]) -> HierarchySolution:
    return hierarchy.solve(*problem, guarded=1, sluggish=True)


def rounds(solution: HierarchySolution) -> int:
    return sum(level.rounds for level in solution.levels)


def test_a_warm_start_saves_rounds_and_changes_nothing_but_rounding() -> None:
    warm, saved = Hierarchy(), [0, 0]
    blocked = 0
    for problem in drifting(600):
        found, fresh = solved(warm, problem), solved(Hierarchy(), problem)
        assert found.exact
        np.testing.assert_allclose(found.v, fresh.v, rtol=0, atol=1e-10)
        saved[0] += rounds(found)
        saved[1] += rounds(fresh)
        blocked += rounds(fresh) > 0
    assert blocked > 500
    assert saved[0] < 0.6 * saved[1]


@pytest.mark.parametrize("kind", ["random", "all at upper", "of another problem"])
def test_wrong_active_sets_are_given_up(kind: str) -> None:
    rng, hierarchy = np.random.default_rng(3), Hierarchy()
    problems = drifting(60)
    for k, problem in enumerate(problems):
        solved(hierarchy, problems[-1 - k])
        sets = hierarchy.active_sets(len(DAMPINGS) + 1, 9)
        if kind == "random":
            sets[:] = rng.integers(-1, 2, size=sets.shape)
        elif kind == "all at upper":
            sets[:] = 1.0
        found, fresh = solved(hierarchy, problem), solved(Hierarchy(), problem)
        assert found.exact
        np.testing.assert_allclose(found.v, fresh.v, rtol=0, atol=1e-9)


def test_the_steps_of_a_level_have_active_sets_of_their_own() -> None:
    hierarchy = Hierarchy()
    for problem in drifting(50):
        solved(hierarchy, problem)
    size = len(DAMPINGS) + 1, 9
    sets = hierarchy.active_sets(*size)
    assert all(used.any() for used in sets[2])  # the tip's, damped: three steps, once more
    assert not sets[0].any()  # the hard rows begin anew
    assert hierarchy.active_sets(size[0], 8).shape == (5, sets.shape[1], 8)
    assert not hierarchy.active_sets(*size).any()


class Counting(Hierarchy):
    """Counts how often each level asks its backend."""

    def __init__(self, backend: str) -> None:
        super().__init__(backend)
        self.asked: Counter[int] = Counter()

    def _propose(self, k: int, *problem: Any) -> Array:
        self.asked[k] += 1
        return super()._propose(k, *problem)


def test_a_backend_is_asked_once_for_an_answer() -> None:
    """And not again for the damped answer of a strict level that is not reached."""
    missed = asked = 0
    for levels, bounds in drifting(60, limit=0.15):
        hierarchy, box = Counting("daqp"), Bounds(bounds.lower, bounds.upper)
        solution = solved(hierarchy, (levels, box))
        missed += not solution.levels[0].reached
        asked += hierarchy.asked[1]
        assert hierarchy.asked[1] <= 1
        assert max(hierarchy.asked.values(), default=0) <= 2  # with more damping, once more
        before = hierarchy.asked.copy()
        solved(hierarchy, (levels, box))
        assert hierarchy.asked == before  # each active set is right now
    assert missed > 10
    assert asked > 30


@pytest.mark.parametrize("size", [1e200, 1e308, np.inf])
def test_a_proposal_for_absurd_numbers_warns_of_nothing(size: float) -> None:
    """Pytest makes an error of each warning."""
    box = np.ones(2)
    goal = np.array([size, -size])
    _, multipliers = propose(get_solver("daqp"), np.eye(2), goal, np.eye(2), -box, box)
    assert np.isfinite(multipliers).all()


def test_the_route_is_polished_where_the_first_guess_was_right() -> None:
    """The guess of a backend, or the active set of the last call."""
    levels = [Level(np.eye(3), np.array([3.0, 0.2, -4.0]))]
    box = Bounds(-np.ones(3), np.ones(3))
    own, asked = Hierarchy(), Hierarchy("daqp")
    found, proposed = own.solve(levels, box), asked.solve(levels, box)
    assert found.levels[0].route is Route.ACTIVE_SET
    assert proposed.levels[0].route is Route.POLISHED
    assert own.solve(levels, box).levels[0].route is Route.POLISHED
    np.testing.assert_array_equal(found.v, proposed.v)


@pytest.mark.parametrize("backend", ["proxqp", "daqp"])
def test_the_last_digit_does_not_depend_on_who_proposes(backend: str) -> None:
    """But for a few degenerate problems; without from_deciding() of cascade.c, one in ten."""
    own, asked = Hierarchy(), Hierarchy(backend)
    same = [
        np.array_equal(solved(own, problem).v, solved(asked, problem).v)
        for problem in drifting(600)
    ]
    assert np.mean(same) > 0.97


@pytest.mark.parametrize("rows", [np.zeros((0, 7)), np.zeros((2, 7))], ids=["none", "zero"])
def test_a_level_that_asks_for_nothing_is_exact_wherever_it_stands(rows: Array) -> None:
    nothing = Level(rows, np.zeros(len(rows)))
    for levels, bounds in drifting(40):
        for place in range(len(levels) + 1):
            more = [*levels[:place], nothing, *levels[place:]]
            found = Hierarchy().solve(more, bounds, guarded=1, sluggish=True)
            assert found.exact, place
