"""Errors are approached no faster than the joints can stop them."""

from __future__ import annotations

import numpy as np
import pytest

from rcmqp import _kernel
from rcmqp.maths.dualquaternion import Array

T, GAIN, DAMPING = 1e-3, 60.0, 0.01
ABOVE = np.sqrt(1e3)
"""Weight of the rows above against those of the task."""

POSE, POINT, LEVER = np.eye(8)[0], np.zeros(3), 0.3


class Joint:
    """One joint, which moves the error by LEVER, and a task on a level of its own."""

    def __init__(self, acceleration: float, jerk: float, share: float = 0.8) -> None:
        self._stack = _kernel.Stack(
            levels=((DAMPING, ((None, GAIN, 1.0),)),),
            limits=(),
            acceleration=np.array([acceleration]),
            jerk=np.array([jerk]),
            share=share,
            period=T,
            guarded=0,
            max_rounds=1,
            names=tuple("abcde"),
        )

    def rate(self, error: float, v: float = 0.0, a: float = 0.0) -> float:
        """What rate of its error the task asks for."""
        given = np.array([error]), np.array([[LEVER]]), np.zeros(1)
        state = POSE, np.zeros((6, 1)), np.zeros(1), np.array([v]), np.array([a])
        found = self._stack.problem(*state, POSE, np.zeros(8), POINT, POINT, (0.0,), [given])
        assert found is not None
        return float(found[1][0])


@pytest.mark.parametrize("error", [1e-9, 1e-3, 0.1])
def test_without_limits_or_without_a_share_an_error_is_reduced_in_proportion(error: float) -> None:
    assert Joint(np.inf, np.inf).rate(error) == -GAIN * error
    assert Joint(2.0, 40.0, share=0.0).rate(error) == -GAIN * error


@pytest.mark.parametrize(
    ("above", "rows", "joints"), [(0, 2, 5), (2, 3, 7), (0, 3, 3), (0, 5, 3), (2, 3, 4)]
)
def test_what_joints_can_do_is_that_of_the_damped_pseudo_inverse(
    above: int, rows: int, joints: int
) -> None:
    """w = [above; A]^+ [0; e / |e|], with fewer rows than joints, as many, and more."""
    rng = np.random.default_rng(above + 10 * rows + joints)
    limits, share, damping = rng.uniform(1.0, 3.0, joints), 0.8, 0.05
    A, e = rng.normal(size=(above + rows, joints)), rng.normal(size=above + rows)
    level = damping, ((None, GAIN, 1.0),)
    stack = _kernel.Stack(
        levels=((0.0, ((None, GAIN, 1.0),)), level) if above else (level,),
        limits=(),
        acceleration=limits,
        jerk=np.full(joints, np.inf),
        share=share,
        period=T,
        guarded=0,
        max_rounds=1,
        names=tuple("abcdef" if above else "abcde"),
    )
    parts = ((0, above), (above, above + rows)) if above else ((0, rows),)
    given: list[tuple[Array, ...]] = [(e[i:j], A[i:j], np.zeros(j - i)) for i, j in parts]
    zero = np.zeros(joints)
    state = POSE, np.zeros((6, joints)), zero, zero, zero
    found = stack.problem(*state, POSE, np.zeros(8), POINT, POINT, (0.0,), given)
    assert found is not None
    B = np.vstack([ABOVE * A[:above], A[above:]])
    size = float(np.linalg.norm(e[above:]))
    wanted = np.concatenate([np.zeros(above), e[above:] / size])
    damped = np.vstack([B, damping * np.eye(joints)])  # least squares are B^+ with the damping
    w = np.linalg.lstsq(damped, np.concatenate([wanted, np.zeros(joints)]), rcond=None)[0]
    speed = np.sqrt(2.0 * size * share * np.min(limits / abs(w)))
    speed /= 1.0 + 2.0 * T * speed / size
    assert speed / size < GAIN
    np.testing.assert_allclose(found[1][above : above + rows], -e[above:] / size * speed, 1e-9)


def settled(error: float, acceleration: float, jerk: float, share: float) -> Array:
    """Errors of one joint that does what is asked as well as its limits allow."""
    v, a, found = 0.0, 0.0, []
    joint = Joint(acceleration, jerk, share)
    for _ in range(4000):
        asked = joint.rate(error, v, a) / LEVER
        low, up = (max(-acceleration, a - jerk * T), min(acceleration, a + jerk * T))
        a = float(np.clip((asked - v) / T, low, up))
        v += T * a
        error += LEVER * T * v
        found.append(error)
    return np.array(found)


@pytest.mark.parametrize("jerk", [np.inf, 2000.0, 40.0])
@pytest.mark.parametrize("start", [0.1, 0.01, 1e-3])
def test_an_error_ends_at_zero_without_overshoot_where_proportion_would_overshoot(
    start: float, jerk: float
) -> None:
    found = settled(start, 2.0, jerk, 0.8)
    assert found.min() > -0.01 * start
    assert abs(found[-1]) < 1e-6
    if start == 0.1:
        assert settled(start, 2.0, jerk, 0.0).min() < -0.2 * start
