"""QP backends: by name, right, honest, and repeatable."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from rcmqp.errors import InvalidProblem, OptionError, RcmqpError, SolverNotInstalled, UnknownName
from rcmqp.qp import solvers
from rcmqp.qp.problem import QP, QPSolution, Status, kkt_residuals
from rcmqp.qp.solvers import get_solver, solver_names

NATIVE = [name for name in ("proxqp", "daqp") if name in solver_names()]


def random_qp(rng: np.random.Generator, n: int = 6) -> QP:
    root, inside = rng.normal(size=(n, n)), rng.uniform(-0.3, 0.3, size=n)
    A, C = rng.normal(size=(2, n)), rng.normal(size=(4, n))
    return QP.build(
        root @ root.T + 0.1 * np.eye(n),
        3.0 * rng.normal(size=n),
        A,
        A @ inside,
        C,
        C @ inside + rng.uniform(0, 0.3, size=4),
        np.full(n, -0.5),
        np.full(n, 0.5),
    )


def bare(qp: QP) -> QP:
    return QP.build(qp.H, qp.g)


def test_both_native_solvers_and_some_other_are_here() -> None:
    assert NATIVE == ["proxqp", "daqp"]


@pytest.mark.parametrize("name", solver_names())
def test_every_installed_solver_meets_the_optimality_conditions(name: str) -> None:
    rng, solver = np.random.default_rng(7), get_solver(name)
    active = 0
    for _ in range(20):
        for qp in (full := random_qp(rng), bare(full)):
            solution = solver.solve(qp)
            assert solution.status is Status.SOLVED, solution.message
            tol = 1e-8 if name in NATIVE else 1e-4
            assert kkt_residuals(qp, solution).max() < tol
        active += bool((np.abs(solver.solve(full).v) > 0.5 - 1e-6).any())
    assert active >= 10


@pytest.mark.parametrize("name", solver_names())
def test_an_infeasible_qp_is_a_status_and_carries_no_numbers(name: str) -> None:
    solver = get_solver(name)
    C, d = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([-1.0, -1.0])
    qp = QP.build(np.eye(2), np.ones(2), C=C, d=d)
    solution = solver.solve(qp)
    assert solution.status is not Status.SOLVED
    assert np.isnan(solution.v).all()
    assert kkt_residuals(qp, solution).max() == np.inf
    good = QP.build(np.eye(2), np.ones(2), C=C, d=np.ones(2))  # same size, after a failure
    solution = solver.solve(good)
    atol = 1e-8 if name in NATIVE else 1e-3
    np.testing.assert_allclose(solution.v, [-1.0, -1.0], rtol=0, atol=atol)


@pytest.mark.parametrize("name", solver_names())
def test_a_solver_shares_no_memory_and_leaves_its_inputs_alone(name: str) -> None:
    rng, solver = np.random.default_rng(7), get_solver(name)
    first, second = random_qp(rng), random_qp(rng)
    before = [getattr(first, field).copy() for field in QP.__slots__]
    solution = solver.solve(first)
    kept = [x.copy() for x in (solution.v, solution.y, solution.z, solution.z_box)]
    solver.solve(second)
    now = (solution.v, solution.y, solution.z, solution.z_box)
    assert all(np.array_equal(a, b) for a, b in zip(now, kept, strict=True))
    after = [getattr(first, field) for field in QP.__slots__]
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


@pytest.mark.parametrize("name", NATIVE)
def test_a_rerun_after_reset_gives_the_same_bits(name: str) -> None:
    solver = get_solver(name)

    def run() -> list[QPSolution]:
        rng = np.random.default_rng(7)
        solver.reset()
        return [solver.solve(random_qp(rng)) for _ in range(20)]

    for a, b in zip(run(), run(), strict=True):
        assert np.array_equal(a.v, b.v)
        assert np.array_equal(a.z_box, b.z_box)


def test_the_residuals_find_each_kind_of_wrong_answer() -> None:
    qp = QP.build(np.eye(2), [-2.0, 0.0], ub=[1.0, np.inf])

    def residuals(v: list[float], z_box: list[float]) -> tuple[float, float, float]:
        empty = np.zeros(0)
        answer = QPSolution(np.array(v), empty, empty, np.array(z_box), Status.SOLVED, 0.0)
        found = kkt_residuals(qp, answer)
        return found.primal, found.dual, found.complementarity

    assert residuals([1.0, 0.0], [1.0, 0.0]) == (0.0, 0.0, 0.0)
    assert residuals([2.0, 0.0], [0.0, 0.0]) == (1.0, 0.0, 0.0)
    assert residuals([1.0, 0.0], [0.0, 0.0]) == (0.0, 1.0, 0.0)
    assert residuals([0.5, 0.0], [1.5, 0.0]) == (0.0, 0.0, 0.75)
    assert residuals([1.0, -1.0], [1.0, 1.0]) == (0.0, 1.0, 0.0)  # pushes at no bound
    assert residuals([np.nan, 0.0], [1.0, 0.0]) == (np.inf, np.inf, np.inf)
    rows = QP.build(np.eye(1), [1.0], C=[[1.0]], d=[0.0])
    wrong_sign = QPSolution(
        np.zeros(1), np.zeros(0), np.array([-1.0]), np.zeros(1), Status.SOLVED, 0.0
    )
    assert kkt_residuals(rows, wrong_sign).dual == 1.0


def test_names_options_and_packages_have_clear_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnknownName, match="did you mean proxqp"):
        get_solver("proxpq")
    with pytest.raises(OptionError, match=r"no option \['eps_ab'\]; it has .*eps_abs"):
        get_solver("proxqp", eps_ab=1e-9)
    with pytest.raises(OptionError, match="eps_abs = 0"):
        get_solver("proxqp", eps_abs=0)
    monkeypatch.setitem(solvers._PACKAGES, "qpoases", ("no_such_module", "qpoases"))
    assert "qpoases" not in solver_names()
    with pytest.raises(SolverNotInstalled, match="pip install qpoases"):
        get_solver("qpoases")
    monkeypatch.setitem(solvers._PACKAGES, "daqp", ("no_such_module", "daqp"))
    with pytest.raises(ImportError, match="pip install daqp"):
        get_solver("daqp")


@pytest.mark.parametrize("field", ["g", "H", "A", "b", "C", "d", "lb", "ub"])
def test_a_nan_is_refused_at_the_door(field: str) -> None:
    good = random_qp(np.random.default_rng(7))
    parts = {name: np.array(getattr(good, name)) for name in QP.__slots__}
    parts[field].flat[0] = np.nan
    with pytest.raises(InvalidProblem, match=rf"{field}\[0.*nan") as caught:
        QP.build(**parts)
    assert isinstance(caught.value, RcmqpError)


def test_importing_the_room_imports_no_backend() -> None:
    code = (
        "import sys, rcmqp.qp; "
        "bad = {'proxsuite', 'daqp', 'qpsolvers', 'scipy'} & set(sys.modules); "
        "assert not bad, bad"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
