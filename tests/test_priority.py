"""Compiled least squares in order of priority, against numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose, size
from oracles import pseudoinverse as oracle

from rcmqp import _kernel
from rcmqp.controllers.pseudoinverse import in_order, inverse


@pytest.mark.parametrize("tolerance", [1e-9, 1e-3, 0.3])
def test_levels_in_order_are_served_as_numpy_serves_them(tolerance: float) -> None:
    rng = np.random.default_rng(7)
    taken = 0
    for _ in range(300):
        n = int(rng.integers(1, 12))
        rows = rng.integers(1, 7, size=rng.integers(1, 4))
        levels = tuple((rng.normal(size=(m, n)), rng.normal(size=m)) for m in rows)
        rest = rng.normal(size=n)
        v, least = in_order(levels, inverse(tolerance), rest)
        expected, expected_least = oracle.in_order(levels, rest, tolerance)
        assert_allclose(v, expected, rtol=0, atol=1e-10 * size(expected))
        assert_allclose(least, expected_least, rtol=0, atol=1e-12)
        taken += rows.sum() >= n
        without = in_order(levels, inverse(tolerance))[0]
        assert np.array_equal(without, in_order(levels, inverse(tolerance), np.zeros(n))[0])
    assert 50 < taken < 250


def test_a_jacobian_of_eight_rows_and_rank_six_is_inverted_as_numpy_does() -> None:
    rng = np.random.default_rng(7)
    for n in (6, 7, 9):
        A = (
            rng.normal(size=(8, 6))
            @ np.diag(10.0 ** np.arange(-5.0, 1.0))
            @ rng.normal(size=(6, n))
        )
        b = rng.normal(size=8)
        expected = np.linalg.pinv(A, rcond=1e-9) @ b
        v, least = in_order(((A, b),), inverse(1e-9))
        assert_allclose(v, expected, rtol=0, atol=1e-9 * size(expected))
        assert_allclose(least, np.linalg.svd(A, compute_uv=False)[5], rtol=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200])
def test_numbers_that_are_not_finite_or_overflow_give_no_velocity(bad: float) -> None:
    rng = np.random.default_rng(7)
    for where in ("A", "b", "rest"):
        given = {"A": rng.normal(size=(3, 7)), "b": rng.normal(size=3), "rest": rng.normal(size=7)}
        given[where].flat[1] = bad
        first = (rng.normal(size=(2, 7)), rng.normal(size=2))
        v, least = in_order((first, (given["A"], given["b"])), inverse(1e-3), given["rest"])
        finite = np.isfinite(bad) and where != "A"  # a large velocity, which step() refuses
        assert np.isfinite(v).all() == np.isfinite(least) == finite


def test_what_is_no_level_is_refused() -> None:
    A, b, numbers, rest = np.ones((3, 7)), np.ones(3), np.ones(4), np.ones(7)
    kernel: Any = _kernel
    assert np.isfinite(kernel.in_order(((A, b),), numbers, rest)[0]).all()
    single = A.astype(np.float32)
    few: tuple[Any, ...] = ((), [(A, b)], None, ((A, b),) * 9, ((A, np.ones(0)),), ((A, 1.0),))
    for levels in few:
        with pytest.raises(ValueError, match=r"levels must be|a level must have"):
            kernel.in_order(levels, numbers, rest)
    wrong: tuple[Any, ...] = (
        (A,),
        ((A,),),
        ((A, b, b),),
        ((np.asfortranarray(A), b),),
        ((single, b),),
    )
    for levels in wrong:
        with pytest.raises(TypeError, match=r"a level must be a tuple|A must be a C-contiguous"):
            kernel.in_order(levels, numbers, rest)
    for given in (
        (((A, b), (np.ones((3, 6)), b)), numbers, None),
        (((A, b),), np.ones(3), rest),
        (((A, b),), numbers, np.ones(6)),
    ):
        with pytest.raises(ValueError, match="numbers, expected"):
            kernel.in_order(*given)
    for level in ((A[:2].copy(), b), (A.T.copy(), b), (A.ravel(), b)):
        with pytest.raises(ValueError, match="a row for each number of b"):
            kernel.in_order((level,), numbers, rest)
    with pytest.raises(TypeError, match="takes 3 arguments"):
        kernel.in_order(((A, b),), numbers)
