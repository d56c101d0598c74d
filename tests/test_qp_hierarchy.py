"""The hierarchy's promises: strict, exact, always answering."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rcmqp import _kernel
from rcmqp.errors import InvalidProblem, OptionError, UnknownName, WrongShape
from rcmqp.maths.dualquaternion import Array
from rcmqp.qp.hierarchy import Hierarchy, hierarchy_backends
from rcmqp.qp.levels import Bounds, HierarchySolution, Level
from rcmqp.qp.problem import QP, QPSolution, Status
from rcmqp.qp.solvers import get_solver

BACKENDS = hierarchy_backends()
REPEATABLE = [name for name in BACKENDS if name != "highs"]  # what stops highs is wall-clock time


def arm_like(
    rng: np.random.Generator, n: int = 7, speed: float = 1.0
) -> tuple[list[Level], Bounds]:
    rcm, tip = 0.4 * rng.normal(size=(2, n)), 0.4 * rng.normal(size=(3, n))
    limit = rng.uniform(0.5, 1.5, size=n)
    levels = [
        Level(rcm, speed * rcm @ rng.normal(size=n), "rcm"),
        Level(tip, speed * tip @ rng.normal(size=n), "tip"),
        Level(np.eye(n), speed * rng.normal(size=n), "posture"),
    ]
    lower, upper = -limit * rng.uniform(0.1, 1, size=n), limit * rng.uniform(0.1, 1, size=n)
    return levels, Bounds(lower, upper)


def touches(solution: HierarchySolution) -> bool:
    return bool(solution.at_lower.any() or solution.at_upper.any())


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_lower_level_never_disturbs_a_higher_one(backend: str) -> None:
    rng, hierarchy = np.random.default_rng(7), Hierarchy(backend)
    active = moved = 0
    for _ in range(40):
        levels, bounds = arm_like(rng)
        alone = hierarchy.solve(levels[:1], bounds)
        both = hierarchy.solve(levels[:2], bounds)
        full = hierarchy.solve(levels, bounds)
        rcm, tip = levels[0].A, levels[1].A
        np.testing.assert_allclose(rcm @ full.v, rcm @ alone.v, rtol=0, atol=1e-12)
        np.testing.assert_allclose(tip @ full.v, tip @ both.v, rtol=0, atol=1e-12)
        active += touches(alone)
        moved += bool(np.linalg.norm(full.v - alone.v) > 1e-3)
    assert active >= 20
    assert moved >= 15


def test_one_reachable_level_is_the_pseudoinverse() -> None:
    rng = np.random.default_rng(7)
    A, b = rng.normal(size=(3, 7)), rng.normal(size=3)
    found = Hierarchy().solve([Level(A, b)], Bounds(np.full(7, -9.0), np.full(7, 9.0)))
    np.testing.assert_allclose(found.v, np.linalg.pinv(A) @ b, rtol=0, atol=1e-14)
    assert found.levels[0].reached
    rest = rng.normal(size=7)
    found = Hierarchy().solve([Level(A, b)], Bounds(np.full(7, -9.0), np.full(7, 9.0)), rest=rest)
    closest = rest + np.linalg.pinv(A) @ (b - A @ rest)
    np.testing.assert_allclose(found.v, closest, rtol=0, atol=1e-14)


def test_the_answer_does_not_depend_on_the_backend_or_its_tolerance() -> None:
    rng = np.random.default_rng(7)
    problems = [arm_like(rng, n) for n in (6, 7) for _ in range(25)]
    expected = np.concatenate([Hierarchy("active_set").solve(*p).v for p in problems])
    solvers = [Hierarchy(name) for name in BACKENDS]
    solvers.append(Hierarchy("proxqp", eps_abs=1e-3))
    for hierarchy in solvers:
        found = np.concatenate([hierarchy.solve(*p).v for p in problems])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10, err_msg=hierarchy.backend)


@pytest.mark.parametrize("backend", REPEATABLE)
def test_a_rerun_after_reset_gives_the_same_bits(backend: str) -> None:
    hierarchy = Hierarchy(backend)

    def run() -> list[Array]:
        rng = np.random.default_rng(7)
        hierarchy.reset()
        return [hierarchy.solve(*arm_like(rng)).v for _ in range(30)]

    assert np.array_equal(run(), run())
    size = 4, 7  # three levels and the rest; bounds
    assert hierarchy.active_sets(*size).any()
    hierarchy.reset()
    assert not hierarchy.active_sets(*size).any()


def test_an_answer_does_not_depend_on_what_was_solved_before() -> None:
    """Not even where the rounds run out, on what was left in the scratch memory."""

    def problem(seed: int, n: int, m: int) -> tuple[list[Level], Bounds]:
        rng = np.random.default_rng(seed)
        box = 10.0 * rng.random((2, n))
        hard = rng.normal(size=(m, n)), rng.normal(size=m)
        return [Level(rng.normal(size=(3, n)), rng.normal(size=3))], Bounds(-box[0], box[1], *hard)

    for seed in range(20):
        answers = []
        for before in ((6, 20), (13, 40)):
            Hierarchy("active_set").solve(*problem(1000 + seed, *before))
            found = Hierarchy("active_set", max_rounds=1).solve(*problem(seed, 6, 20))
            answers.append((found.v, [(level.kkt, level.route) for level in found.levels]))
        assert np.array_equal(answers[0][0], answers[1][0])
        assert answers[0][1] == answers[1][1]


def test_nothing_is_shared_between_calls_and_inputs_stay_as_they_were() -> None:
    rng, hierarchy = np.random.default_rng(7), Hierarchy()
    A, b, box = rng.normal(size=(3, 7)), rng.normal(size=3), np.full(7, 0.2)
    C, d, rest = rng.normal(size=(2, 7)), np.full(2, 0.1), rng.normal(size=7)
    given = (A, b, box, C, d, rest)
    before = [x.copy() for x in given]
    level, bounds = Level(A, b), Bounds(-box, box, C, d)
    first = hierarchy.solve([level], bounds, rest)
    kept = first.v.copy(), first.levels[0].residual.copy()
    hierarchy.solve(*arm_like(rng))
    assert all(np.array_equal(x, y) for x, y in zip(given, before, strict=True))
    assert np.array_equal(first.v, kept[0])
    assert np.array_equal(first.levels[0].residual, kept[1])
    A[:] = box[:] = 0.0
    assert level.A.any()
    assert bounds.upper.all()
    with pytest.raises(ValueError, match="read-only"):
        first.v[0] = 1.0


def zoo() -> dict[str, Callable[[np.random.Generator], tuple[list[Level], Bounds]]]:
    """Degenerate problems of 7 unknowns."""
    n = 7
    box = Bounds(np.full(n, -0.3), np.full(n, 0.3))

    def levels(rng: np.random.Generator, *sizes: int) -> list[Level]:
        return [Level(rng.normal(size=(m, n)), rng.normal(size=m)) for m in sizes]

    def scaled(rng: np.random.Generator) -> list[Level]:
        sizes = np.array([1e-4, 1e4, 1.0])
        A, b = rng.normal(size=(3, n)), rng.normal(size=3)
        return [Level(A * sizes[:, None], b * sizes), *levels(rng, 2)]

    def twice(rng: np.random.Generator) -> list[Level]:
        level, other = levels(rng, 3, 2)
        A = np.vstack([level.A, level.A])
        return [Level(A, np.concatenate([level.b, level.b + 0.1])), level, other]

    def near(rng: np.random.Generator, gap: float) -> list[Level]:
        level, other = levels(rng, 3, 3)
        return [level, Level(level.A + gap * rng.normal(size=(3, n)), other.b), other]

    def pinned(rng: np.random.Generator) -> Bounds:
        lower, upper = np.array(box.lower), np.array(box.upper)
        lower[[1, 4]] = upper[[1, 4]] = 0.1
        return Bounds(lower, upper)

    def rows(rng: np.random.Generator, count: int, d: float) -> Bounds:
        C = rng.normal(size=(count, n))
        return Bounds(box.lower, box.upper, C, np.full(count, d))

    def slab(rng: np.random.Generator) -> Bounds:
        C = rng.normal(size=(2, n))
        return Bounds(box.lower, box.upper, np.vstack([C, -C]), [0.1, 0.2, -0.1, -0.2])

    def zero_row(rng: np.random.Generator) -> Bounds:
        C = np.vstack([np.zeros(n), rng.normal(size=n)])
        return Bounds(box.lower, box.upper, C, [-0.5, 0.1])

    zero = Level(np.zeros((2, n)), np.ones(2))
    return {
        "no level at all": lambda r: ([], box),
        "an empty level": lambda r: ([Level(np.zeros((0, n)), []), *levels(r, 3)], box),
        "zero rows": lambda r: ([zero, *levels(r, 3)], box),
        "the same level twice, contradicting itself": lambda r: (twice(r), box),
        "nearly the same level, 1e-6": lambda r: (near(r, 1e-6), box),
        "nearly the same level, 1e-13": lambda r: (near(r, 1e-13), box),
        "rank one": lambda r: (
            [Level(np.outer(r.normal(size=4), r.normal(size=n)), r.normal(size=4)), *levels(r, 3)],
            box,
        ),
        "a level that fixes everything": lambda r: (levels(r, 9, 3), box),
        "rows from 1e-4 to 1e4": lambda r: (scaled(r), box),
        "two joints without room": lambda r: (levels(r, 2, 3, 7), pinned(r)),
        "no joint with room": lambda r: (levels(r, 2, 3), Bounds(np.full(n, 0.1), [0.1] * n)),
        "a box of 1e-6": lambda r: (levels(r, 2, 3), Bounds([-1e-6] * n, [1e-6] * n)),
        "a box far from zero": lambda r: (levels(r, 2, 3), Bounds([5.0] * n, [6.0] * n)),
        "no box": lambda r: (levels(r, 2, 3), Bounds([-np.inf] * n, [np.inf] * n)),
        "a box on one side": lambda r: (levels(r, 2, 3), Bounds([-np.inf] * n, [0.1] * n)),
        "300 hard rows": lambda r: (levels(r, 2, 3), rows(r, 300, 0.3)),
        "300 hard rows through zero": lambda r: (levels(r, 2, 3), rows(r, 300, 0.0)),
        "300 hard rows that contradict": lambda r: (levels(r, 2, 3), rows(r, 300, -0.1)),
        "hard rows without interior": lambda r: (levels(r, 2, 3), slab(r)),
        "a hard row of zeros that cannot hold": lambda r: (levels(r, 2, 3), zero_row(r)),
    }


@pytest.mark.parametrize("backend", ["active_set", "proxqp", "daqp"])
@pytest.mark.parametrize("name", zoo())
def test_degenerate_problems_are_answered_exactly(name: str, backend: str) -> None:
    rng = np.random.default_rng(7)
    hierarchy = Hierarchy(backend)
    for _ in range(5):
        levels, bounds = zoo()[name](rng)
        found = hierarchy.solve(levels, bounds)
        assert found.exact, [(x.route, x.kkt) for x in (found.limits, *found.levels)]
        assert (found.v >= bounds.lower).all()
        assert (found.v <= bounds.upper).all()
        expected = Hierarchy("active_set").solve(levels, bounds)
        scale = np.abs(expected.v).max()
        np.testing.assert_allclose(found.v, expected.v, rtol=0, atol=1e-9 * max(1e-6, scale))


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_finite_numbers_leave_it_without_an_answer_in_the_box(backend: str) -> None:
    rng, hierarchy = np.random.default_rng(7), Hierarchy(backend)
    for _ in range(60):
        n = int(rng.integers(1, 8))
        sizes = 10.0 ** rng.choice([-300, -160, -9, 0, 0, 9, 160, 300], size=8)
        with np.errstate(all="ignore"):
            levels = [
                Level(
                    np.clip(rng.normal(size=(m, n)) * sizes[k], -1e308, 1e308),
                    np.clip(rng.normal(size=m) * sizes[k + 3], -1e308, 1e308),
                )
                for k, m in enumerate(rng.integers(0, 8, size=3))
            ]
            ends = np.sort(rng.normal(size=(2, n)) * sizes[6], axis=0)
            C = np.clip(rng.normal(size=(4, n)) * sizes[7], -1e308, 1e308)
        found = hierarchy.solve(levels, Bounds(ends[0], ends[1], C, rng.normal(size=4)))
        assert np.isfinite(found.v).all()
        assert (found.v >= ends[0]).all()
        assert (found.v <= ends[1]).all()


class Liar:
    """A backend that claims success and is wrong in a chosen way."""

    def __init__(self, kind: str) -> None:
        self.kind, self.calls = kind, 0

    def reset(self) -> None: ...

    def solve(self, qp: QP) -> QPSolution:
        self.calls += 1
        rng = np.random.default_rng(self.calls)
        size = {"nan": np.nan, "huge": 1e200, "noise": 1.0}.get(self.kind, 0.0)
        v = size * rng.normal(size=qp.g.size)
        z = np.full(qp.d.size, np.nan) if self.kind == "nan" else rng.normal(size=qp.d.size)
        status = Status.STOPPED if self.kind == "stopped" else Status.SOLVED
        return QPSolution(v, np.zeros(0), z, np.zeros(qp.g.size), status, 0.0)


@pytest.mark.parametrize("kind", ["nan", "huge", "noise", "zero", "stopped"])
def test_a_backend_that_fails_or_lies_changes_nothing(kind: str) -> None:
    rng, hierarchy = np.random.default_rng(7), Hierarchy("daqp")
    liar = Liar(kind)
    hierarchy._solvers = [liar] * 5
    for _ in range(40):
        problem = arm_like(rng)
        found, expected = hierarchy.solve(*problem), Hierarchy("active_set").solve(*problem)
        assert found.exact
        np.testing.assert_allclose(found.v, expected.v, rtol=0, atol=1e-10)
    assert liar.calls >= 20


def test_active_set_rounds_that_run_out_are_said() -> None:
    rng, unverified = np.random.default_rng(7), 0
    for _ in range(40):
        levels, bounds = arm_like(rng)
        found = Hierarchy("active_set", max_rounds=1).solve(levels, bounds)
        assert (found.v >= bounds.lower).all()
        assert (found.v <= bounds.upper).all()
        unverified += not found.exact
        for level in found.levels:
            assert level.route.exact == (level.kkt <= 1e-8)
    assert unverified >= 20


def test_the_equality_cascade_reports_false_infeasibility_and_this_one_does_not() -> None:
    rng, ours = np.random.default_rng(7), Hierarchy("proxqp")
    loose = get_solver("proxqp", eps_primal_inf=1e-4, eps_dual_inf=1e-4)
    tight = get_solver("proxqp")
    false = {"loose": 0, "tight": 0}
    for _ in range(250):
        levels, bounds = arm_like(rng)
        answer = ours.solve(levels, bounds)
        assert answer.exact
        for name, solver in (("loose", loose), ("tight", tight)):
            A, b = np.zeros((0, 7)), np.zeros(0)
            for level in levels:
                H, g = level.A.T @ level.A + 1e-8 * np.eye(7), -level.A.T @ level.b
                found = solver.solve(QP.build(H, g, A, b, lb=bounds.lower, ub=bounds.upper))
                if found.status is not Status.SOLVED:  # feasible by construction
                    false[name] += found.status is Status.INFEASIBLE
                    break
                A, b = np.vstack([A, level.A]), np.concatenate([b, level.A @ found.v])
    assert false["loose"] >= 15
    assert false["tight"] <= false["loose"] // 2


def test_hard_rows_that_contradict_the_box_are_reported_row_by_row() -> None:
    names = ["shoulder", "elbow", "cone", "depth"]
    bounds = Bounds([-1, -1], [1, 1], [[1, 0], [0, 1]], [-3.0, 5.0], names)
    found = Hierarchy().solve([Level([[0, 1]], [0.5], "tip")], bounds)
    np.testing.assert_allclose(found.v, [-1.0, 0.5], rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.violation, [2.0, 0.0], rtol=0, atol=1e-15)
    assert not found.limits_hold
    assert found.exact
    assert found.levels[0].reached
    assert found.active() == {"shoulder": "lower", "cone": "upper"}
    assert found.blocking(found.limits) == {"shoulder": -2.0}


def test_hard_rows_that_contradict_each_other_share_the_violation() -> None:
    bounds = Bounds([-9], [9], [[1], [-1], [-2]], [1.0, -2.0, -4.0])  # v <= 1, v >= 2 twice
    found = Hierarchy().solve([Level([[1.0]], [9.0])], bounds)
    assert found.v[0] == pytest.approx(11 / 6, abs=1e-14)  # (v-1)^2 + (2-v)^2 + (4-2v)^2
    np.testing.assert_allclose(found.violation, [5 / 6, 1 / 6, 1 / 3], rtol=0, atol=1e-14)
    assert not found.levels[0].reached


def test_what_blocks_a_level_is_named_with_its_multiplier() -> None:
    bounds = Bounds([-1, -1], [1, 1], names=["a", "b"])
    found = Hierarchy().solve([Level([[2, 0]], [6.0], "tip"), Level(np.eye(2), [0, 5])], bounds)
    assert found.v.tolist() == [1.0, 1.0]
    assert found.levels[0].residual.tolist() == [-4.0]
    assert found.blocking(found.levels[0]) == {"a": 8.0}  # 2 * 4
    assert found.blocking(found.levels[1]) == {"b": 4.0}
    assert found.active() == {"a": "upper", "b": "upper"}


def test_how_many_levels_are_guarded_may_be_any_integer_but_not_all_of_them() -> None:
    levels = [Level(np.eye(2), np.ones(2), "here")]
    bounds = Bounds(-np.ones(2), np.ones(2), np.array([[1.0, 0.0]]), np.array([0.5]))
    solve = Hierarchy("active_set").solve
    one = solve(levels, bounds, guarded=1)
    assert np.array_equal(solve(levels, bounds, guarded=np.int64(1)).v, one.v)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="guarded be less than the number of levels"):
        solve(levels, bounds, guarded=2)  # the rest below them is the last


def test_rows_yield_to_a_guarded_level_that_the_box_alone_would_let_be_reached() -> None:
    # v_0 + v_1 = 1 is wanted; the row asks for v_0 + v_1 <= 0, the box allows both
    levels = [Level([[1.0, 1.0]], [1.0], "rcm"), Level([[1.0, -1.0]], [4.0], "tip")]
    bounds = Bounds([-1, -1], [1, 1], [[1.0, 1.0]], [0.0], names=["a", "b", "row"])
    hard = Hierarchy("active_set").solve(levels, bounds)
    yielding = Hierarchy("active_set").solve(levels, bounds, guarded=1)
    np.testing.assert_allclose(hard.v, [1.0, -1.0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(yielding.v, [1.0, 0.0], rtol=0, atol=1e-15)
    assert hard.limits_hold
    assert yielding.violation.tolist() == [1.0]
    assert yielding.exact
    tight = Bounds([-1, -1], [0.4, 0.4], [[1.0, 1.0]], [0.0])  # out of the box's reach as well
    stays = Hierarchy("active_set").solve(levels, tight, guarded=1)
    assert stays.limits_hold


def test_rows_that_nearly_repeat_are_not_taken_for_exceeded() -> None:
    rng, solver = np.random.default_rng(7), Hierarchy("active_set")
    for _ in range(100):
        n, gap = 3, 10.0 ** rng.uniform(-13.0, -10.0)
        row = rng.normal(size=(3, n))
        C = np.vstack([row, row + gap * rng.normal(size=(3, n))])
        bounds = Bounds([-9] * n, [9] * n, C, np.full(6, 0.1))  # zero is inside
        A, b = rng.normal(size=(2, n)), rng.normal(size=2)
        found = solver.solve([Level(A, b)], bounds)
        once = solver.solve([Level(A, b)], Bounds([-9] * n, [9] * n, row, np.full(3, 0.1)))
        assert found.limits_hold
        np.testing.assert_allclose(
            np.linalg.norm(found.levels[0].residual),
            np.linalg.norm(once.levels[0].residual),
            rtol=0,
            atol=1e-7,
        )


def test_the_box_holds_to_the_bit_whatever_its_sides() -> None:
    bounds = Bounds([1e-300, -1.0], [2e-300, 1e99])
    found = Hierarchy("active_set").solve([Level(np.eye(2), [5.0, 5.0])], bounds)
    assert (bounds.lower <= found.v).all()
    assert (found.v <= bounds.upper).all()


@pytest.mark.parametrize("rounds", [0, -1, 2**31, 2**32])
def test_rounds_beyond_reason_are_refused(rounds: int) -> None:
    with pytest.raises(OptionError, match="max_rounds"):
        Hierarchy(max_rounds=rounds)


def test_a_backend_that_raises_changes_nothing() -> None:
    class Raising(Liar):
        def solve(self, qp: QP) -> QPSolution:
            raise RuntimeError("no licence")

    rng, hierarchy = np.random.default_rng(7), Hierarchy("daqp")
    hierarchy._solvers = [Raising("zero")] * 5
    for _ in range(10):
        problem = arm_like(rng)
        expected = Hierarchy("active_set").solve(*problem).v
        np.testing.assert_allclose(hierarchy.solve(*problem).v, expected, rtol=0, atol=1e-10)


def test_a_vertex_where_many_bounds_meet_is_left_or_proved_optimal() -> None:
    rng, solver = np.random.default_rng(7), Hierarchy("active_set")
    for _ in range(200):
        vertex, n = rng.normal(size=5), 5
        C = rng.normal(size=(30, n))
        C[15:] = C[:15] * rng.uniform(0.5, 2.0, size=(15, 1))  # each of them twice
        bounds = Bounds([-9] * n, [9] * n, C, C @ vertex)
        levels = [Level(rng.normal(size=(2, n)), rng.normal(size=2)) for _ in range(3)]
        found = solver.solve(levels, bounds)
        assert found.exact, [(x.route, x.kkt) for x in (found.limits, *found.levels)]


def test_crossed_bounds_hold_the_joint_in_the_middle_and_say_so() -> None:
    bounds = Bounds([-1, 0.5, -1], [1, 0.3, 1])
    found = Hierarchy().solve([Level(np.eye(3), [5.0, 5.0, 0.2])], bounds)
    np.testing.assert_allclose(found.v, [1.0, 0.4, 0.2], rtol=0, atol=1e-15)
    assert found.crossed.tolist() == [False, True, False]
    assert not found.limits_hold
    assert found.exact


def test_names_options_and_numbers_are_checked_at_the_door() -> None:
    with pytest.raises(UnknownName, match="did you mean active_set"):
        Hierarchy("activ_set")
    with pytest.raises(OptionError, match="eps_ab"):
        Hierarchy("proxqp", eps_ab=1e-9)
    with pytest.raises(OptionError, match="eps"):
        Hierarchy("daqp", eps=1)
    with pytest.raises(OptionError, match="no options"):
        Hierarchy("active_set", eps=1)
    with pytest.raises(OptionError, match="max_rounds"):
        Hierarchy(max_rounds=0)
    with pytest.raises(InvalidProblem, match=r"b of level 'tip'\[1\] is nan"):
        Level(np.eye(2), [0.0, np.nan], "tip")
    with pytest.raises(WrongShape, match=r"shape \(3,\), expected \(2,\)"):
        Level(np.eye(2), np.zeros(3))
    for damping in (-1.0, np.inf, np.nan):
        with pytest.raises(InvalidProblem, match=f"damping of level 'tip' is {damping}; give 0"):
            Level(np.eye(2), np.zeros(2), "tip", damping=damping)
    with pytest.raises(InvalidProblem, match=r"upper\[0\] is -inf"):
        Bounds([0.0], [-np.inf])
    with pytest.raises(InvalidProblem, match=r"d\[0\] is -inf"):
        Bounds([0.0], [1.0], [[1.0]], [-np.inf])
    with pytest.raises(InvalidProblem, match="1 names for 2 unknowns and 0 rows"):
        Bounds([0, 0], [1, 1], names=["a"])
    with pytest.raises(InvalidProblem, match="'tip' has 2 unknowns, the bounds have 3"):
        Hierarchy().solve([Level(np.eye(2), [0, 0], "tip")], Bounds([0] * 3, [1] * 3))
    with pytest.raises(InvalidProblem, match=r"rest\[1\] is nan"):
        Hierarchy().solve([], Bounds([0, 0], [1, 1]), rest=[0, np.nan])


@pytest.mark.parametrize("number", [100.0, np.inf, -np.inf])
def test_a_backend_that_writes_into_the_box_does_not_widen_it(number: float) -> None:
    """Only solve() itself lets it: Bounds are read-only."""
    A, b = (
        np.array([[1.0, 0.3], [0.2, 1.0], [1.0, 0.0], [0.0, 1.0]]),
        np.array([5.0, 5.0, 0.0, 0.0]),
    )
    lower, upper = -np.ones(2), np.ones(2)

    def backend(level: int, M: Array, c: Array, R: Array, low: Array, up: Array) -> Array:
        lower[:] = upper[:] = number
        return np.zeros(len(R))

    v, account = _kernel.solve(
        *(A, b, np.array([2, 4]), np.zeros(2), lower, upper, np.ones((1, 2)), np.array([0.5])),
        *(0, 0, 50, None, np.zeros((3, _kernel.SETS, 3)), backend),
    )
    assert lower[0] == number
    assert (np.abs(v) <= 1.0).all()
    assert account.numbers[:4].tolist() == [-1.0, -1.0, 1.0, 1.0]
