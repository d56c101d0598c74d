"""The hierarchy against independent oracles, on thousands of random problems.

The oracles are in ``oracle.py``; ``test_strictness.py`` asks them about arms.

``RCMQP_SLOW=1`` runs 10,000 problems instead of 2,000.
"""

from __future__ import annotations

import os

import numpy as np
import pytest
from oracle import Problem, bounded, certificate, primal_norms

from rcmqp.qp.hierarchy import Hierarchy
from rcmqp.qp.levels import Bounds, HierarchySolution, Level

SLOW = bool(os.environ.get("RCMQP_SLOW"))
COUNT = 10_000 if SLOW else 2_000
PRIMAL = 10_000 if SLOW else 400


def problem(rng: np.random.Generator, rows: int = 0) -> Problem:
    """RCM 2 rows, tip 3, posture n; 6 or 7 joints; from slow to far beyond the box."""
    n, speed = int(rng.integers(6, 8)), 10.0 ** rng.uniform(-1.5, 0.5)
    rcm, tip = 0.4 * rng.normal(size=(2, n)), 0.4 * rng.normal(size=(3, n))
    if rng.random() < 0.2:  # the tip's rows nearly or wholly repeat the RCM's
        tip[0] = rcm[0] + rng.choice([0.0, 1e-3, 1e-1]) * rng.normal(size=n)
    limit = rng.uniform(0.5, 1.5, size=n)
    C = d = None
    if rows:
        C = rng.normal(size=(rows, n))
        d = rng.choice([0.02, 0.3, 1.0]) * rng.uniform(0, 1, size=rows)
        if rng.random() < 0.3:
            d = d - 0.15  # zero is outside, often nothing is inside
    levels = [
        Level(rcm, speed * rcm @ rng.normal(size=n), "rcm"),
        Level(tip, speed * tip @ rng.normal(size=n), "tip"),
        Level(np.eye(n), speed * rng.normal(size=n), "posture"),
    ]
    if rng.random() < 0.3:
        levels[2] = Level(rng.normal(size=(1, n)), [speed], "gradient")  # leaves joints to rest
    lower, upper = -limit * rng.uniform(0.05, 1, size=n), limit * rng.uniform(0.05, 1, size=n)
    return Problem(levels, Bounds(lower, upper, C, d))


def touches(found: HierarchySolution) -> bool:
    return bool(found.at_lower.any() or found.at_upper.any())


@pytest.mark.parametrize("backend", ["proxqp", "daqp"])
def test_every_level_is_proved_optimal(backend: str) -> None:
    rng, hierarchy = np.random.default_rng(7), Hierarchy(backend)
    other = Hierarchy("active_set")
    active = 0
    for i in range(COUNT // 2):
        p = problem(rng)
        found = hierarchy.solve(p.levels, p.bounds)
        assert found.exact
        assert max(x.kkt for x in (*found.levels, found.rest)) < 1e-8
        assert (found.v >= p.bounds.lower).all()
        assert (found.v <= p.bounds.upper).all()
        assert max(certificate(p, found.v)) < 1e-8, i
        if i % 4 == 0:
            expected = other.solve(p.levels, p.bounds).v
            np.testing.assert_allclose(found.v, expected, rtol=0, atol=1e-9)
        active += touches(found)
    assert active >= COUNT // 4


def test_every_residual_is_that_of_the_primal_oracle() -> None:
    rng, hierarchy, active = np.random.default_rng(8), Hierarchy(), 0
    for i in range(PRIMAL):
        p = problem(rng)
        found = hierarchy.solve(p.levels, p.bounds)
        norms = [np.linalg.norm(x.residual) for x in (*found.levels, found.rest)]
        np.testing.assert_allclose(norms, primal_norms(p), rtol=0, atol=1e-7, err_msg=str(i))
        active += touches(found)
    assert active >= PRIMAL // 2


@pytest.mark.parametrize("backend", ["proxqp", "daqp"])
def test_hard_rows_hold_or_are_exceeded_least(backend: str) -> None:
    rng, hierarchy = np.random.default_rng(9), Hierarchy(backend)
    held = exceeded = 0
    for i in range(COUNT // 20):
        p = problem(rng, rows=int(rng.choice([1, 4, 40, 300])))
        found = hierarchy.solve(p.levels, p.bounds)
        assert found.exact
        assert max(certificate(p, found.v)) < 1e-8, i
        n, m = found.v.size, found.violation.size
        slack = bounded(  # min |C v + s - d| over the box and s >= 0
            np.hstack([p.bounds.C, np.eye(m)]),
            p.bounds.d,
            np.concatenate([p.bounds.lower, np.zeros(m)]),
            np.concatenate([p.bounds.upper, np.full(m, np.inf)]),
        )
        expected = np.maximum(p.bounds.C @ slack[:n] - p.bounds.d, 0.0)
        np.testing.assert_allclose(found.violation, expected, rtol=0, atol=1e-8)
        held += found.limits_hold and bool(found.at_upper[n:].any())
        exceeded += not found.limits_hold
    assert held >= COUNT // 80
    assert exceeded >= COUNT // 200
