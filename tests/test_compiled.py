"""What is compiled says what numpy says, at every state."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import astuple
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, inserted
from oracles.drawn import tip_of
from oracles.law import law

from rcmqp import (
    ArmState,
    Insertion,
    Reference,
    ViewCommand,
    _kernel,
    view_pose,
)
from rcmqp.controllers import DualQuaternion
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array, from_se3
from rcmqp.references.paths import Circle, ConicalHelix, Lissajous
from rcmqp.references.view import carried, view_of_tip
from rcmqp.tasks.objectives import Manipulability
from rcmqp.world.insertion import rcm_error, tilt

OPTIONS: list[dict[str, Any]] = [
    {},
    {"feed_forward": True, "velocity_limit": "scale"},
    {"damping": 0.05, "velocity_limit": "clip"},
    {"tolerance": 0.05, "K_c": 3.0, "c_d": 0.4, "objective": "joint_centring"},
]


def some_state(insertion: Insertion, rng: np.random.Generator, k: int) -> ArmState:
    """Anywhere; every other one with a joint near where elbows and wrists are singular."""
    arm = insertion.arm
    angles = arm.random_angles(rng)
    if k % 2:
        angles[rng.integers(arm.nv)] = rng.choice([-0.5, 0.0, 0.5]) * np.pi + 10.0 ** rng.uniform(
            -7.0, -1.0
        )
    return insertion.state(arm.configuration(angles))


def some_reference(state: ArmState, rng: np.random.Generator) -> Reference:
    """Up to a metre and a radian away, on either cover, moving."""
    x_d = rng.choice([-1.0, 1.0]) * from_se3(state.oMe * pin.exp6(rng.normal(scale=0.3, size=6)))
    return Reference(x_d, rng.normal(size=8), np.zeros(3), np.zeros(3))


def off(found: Array, expected: Array) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


# The law -----------------------------------------------------------------------------------


@pytest.mark.parametrize("arm", ["lwa3", "panda", "ur5", "kinova"])
def test_the_law_is_that_of_numpy_at_10000_states(arm: str) -> None:
    """To 1e-10, or, where N's condition is above 1e4, to what rounding makes of it there."""
    rng, insertion, unconditioned = np.random.default_rng(7), inserted(arm), 0
    controllers = [DualQuaternion(insertion, 8e-3, **options) for options in OPTIONS]
    limited = 0
    for k in range(2500):
        controller = controllers[k // 2 % len(OPTIONS)]
        state = some_state(insertion, rng, k)
        reference = some_reference(state, rng)
        found, expected = controller.step(state, reference), law(controller, state, reference)
        sigma_6 = expected.diagnostics["sigma_6_of_N"]
        condition = float(np.linalg.norm(state.J_local, 2)) / sigma_6
        assert off(found.v, expected.v) < 1e-14 * max(condition, 1e4)
        assert found.diagnostics.keys() == {*expected.diagnostics, "safe_stop"}
        assert found.diagnostics["rank"] == expected.diagnostics["rank"]
        assert abs(found.diagnostics["sigma_6_of_N"] - sigma_6) < 1e-14
        assert_allclose(found.diagnostics["scale"], expected.diagnostics["scale"], rtol=1e-8)
        limited += int(found.diagnostics["scale"] < 1.0)
        unconditioned += int(condition > 1e4)
    assert limited > 100
    assert unconditioned > (0 if arm == "panda" else 20)


def test_a_law_takes_arrays_in_any_order() -> None:
    rng, insertion = np.random.default_rng(7), inserted("panda")
    controller = DualQuaternion(insertion, 8e-3, feed_forward=True)
    state = some_state(insertion, rng, 0)
    reference = some_reference(state, rng)
    other = dataclasses.replace(state, J_local=np.asfortranarray(state.J_local))
    x_d, x_d_dot = np.array([reference.x_d, reference.x_d_dot]).repeat(2, axis=1)[:, ::2]
    again = Reference(x_d, x_d_dot, reference.pivot, reference.pivot_dot)
    expected = controller.step(state, reference).v
    assert state.J_local.flags.c_contiguous
    assert not x_d.flags.c_contiguous
    assert np.array_equal(controller.step(other, again).v, expected)


# The pose ----------------------------------------------------------------------------------


def test_a_states_pose_is_that_of_from_se3_with_w_never_below_zero() -> None:
    rng, insertion, turned = np.random.default_rng(7), inserted("panda"), 0
    for k in range(200):
        state = some_state(insertion, rng, k)
        assert_allclose(state.x, from_se3(state.oMe), rtol=0, atol=1e-15)
        turned += int(pin.SE3ToXYZQUAT(state.oMe)[6] < 0.0)
    assert turned > 10


# The objectives ----------------------------------------------------------------------------


def test_manipulability_is_finite_in_a_singularity_of_any_depth() -> None:
    arm = inserted("lwa3").arm
    stretched, wrist = [0.0, np.pi / 2, *[0.0] * 5], [0.0, 0.5, 0.0, 1.2, np.pi / 2, 0.0, 0.0]
    for angles in ([0.0] * 7, stretched, wrist):
        m, gradient = Manipulability().evaluate(arm.state(angles))
        assert abs(m) < 1e-15
        assert np.isfinite(gradient).all()


# Views, references and poses, a block at a time --------------------------------------------


@pytest.mark.parametrize(
    "path", [ConicalHelix(turns=2.5), Circle(turns=1.3), Lissajous()], ids=str
)
def test_the_views_of_a_drawn_path_are_those_of_its_tip(
    path: Circle | ConicalHelix | Lissajous,
) -> None:
    times = np.linspace(-0.5, path.duration + 0.5, 400)
    found = path.views_at(times, 0.1)
    expected = [astuple(view_of_tip(*tip_of(path, t, 0.1), 0.1)) for t in times]
    assert_allclose(found, expected, rtol=0, atol=1e-13)
    assert np.ptp(found[:, 0]) > 0.1


def test_the_references_of_a_block_are_those_of_its_views_to_the_bit() -> None:
    rng, x_rcm = np.random.default_rng(7), inserted("panda").x_rcm
    views, offsets = rng.normal(size=(50, 8)), rng.normal(size=(50, 3))
    offsets[::3], rates = 0.0, rng.normal(size=(50, 3))
    blocks = _kernel.view_poses(x_rcm, views, offsets, rates)
    for view, offset, rate, *found in zip(views, offsets, rates, *blocks, strict=True):
        one = view_pose(carried(x_rcm, offset), ViewCommand(*view), rate)
        for values, expected in zip(found, (one.x_d, one.x_d_dot, one.pivot), strict=True):
            assert np.array_equal(values, expected)


def test_what_a_record_says_of_poses_is_what_numpy_says() -> None:
    rng, axis = np.random.default_rng(7), np.array([0.36, -0.48, 0.8])
    x, x_d = (
        np.array(
            [sign * from_se3(pin.exp6(rng.normal(size=6))) for sign in rng.choice([-1, 1], 99)]
        )
        for _ in range(2)
    )
    pivot = rng.normal(size=(99, 3))
    insertion = inserted("panda")
    tip, tip_d, seen = _kernel.observed(x, x_d, pivot, axis, insertion.tip_depth)
    expected = (
        np.linalg.norm(insertion.tip(x) - insertion.tip(x_d), axis=1),
        np.linalg.norm(dq.translation(x) - dq.translation(x_d), axis=1),
        dq.angle_between(x, x_d),
        rcm_error(x, pivot),
        insertion.depth(x, pivot),
        tilt(x, axis),
    )
    assert_allclose(seen, np.transpose(expected), rtol=0, atol=1e-14)
    assert_allclose(tip, insertion.tip(x), rtol=0, atol=1e-14)
    assert_allclose(tip_d, insertion.tip(x_d), rtol=0, atol=1e-14)


def test_a_row_is_stored_whole_or_refused() -> None:
    table = np.zeros((3, 5))
    _kernel.store(table, 1, np.arange(2.0), np.array([[7.0, 8.0, 9.0]]))
    assert np.array_equal(table, [[0.0] * 5, [0.0, 1.0, 7.0, 8.0, 9.0], [0.0] * 5])
    for arrays in ([np.zeros(4)], [np.zeros(6)], [np.zeros(2), np.zeros(4)]):
        with pytest.raises(ValueError, match="numbers for a row of 5"):
            _kernel.store(table, 0, *arrays)
    with pytest.raises(ValueError, match="from 0 to 2"):
        _kernel.store(table, 3, np.zeros(5))
    with pytest.raises(TypeError, match="float64"):
        _kernel.store(table, 0, np.zeros(5, dtype=np.float32))


# The record --------------------------------------------------------------------------------


@pytest.mark.parametrize("duration", [-1.0, 0.0, np.nan])
def test_a_drawing_of_no_duration_is_refused(duration: float) -> None:
    with pytest.raises(ValueError, match="duration must be positive"):
        _kernel.views(_kernel.CIRCLE, np.ones(4), duration, 0.1, np.zeros(3), 0.1)


def test_the_first_argument_that_fails_is_the_error_whatever_comes_after_it() -> None:
    class Refuses:
        def __float__(self) -> float:
            raise ZeroDivisionError

        __bool__ = __index__ = __float__

    bad: Any = Refuses()
    x, three, table = np.ones(8), np.ones(3), np.ones((1, 8))
    J, numbers, seven = np.ones((6, 7)), np.ones(7), np.ones(7)
    kernel: Any = _kernel
    failing: tuple[Callable[[], object], ...] = (
        lambda: kernel.law(bad, J, seven, x, x, (1.0, seven), numbers, seven, bad, bad),
        lambda: kernel.approach(bad, three, x, x, bad, bad, bad, x, three, three, bad, bad),
        lambda: kernel.observed(bad, table, np.ones((1, 3)), three, bad),
        lambda: kernel.views(_kernel.CIRCLE, bad, bad, bad, three, bad),
    )
    for call in failing:
        with pytest.raises(TypeError, match="must be a C-contiguous array"):
            call()
    with pytest.raises(TypeError, match="figure must be an int"):  # it is not asked
        kernel.views(bad, np.ones(4), bad, bad, three, bad)
    with pytest.raises(TypeError, match="Refuses given, it must be a number"):
        kernel.views(0, np.ones(4), bad, bad, three, bad)
    for number in (np.complex64(60.0), np.complex128(60.0)):  # numpy's warning is Python code
        with pytest.raises(TypeError, match=r"complex\d+ given, it must be a number"):
            kernel.paced(number, 0.2, 0.01)
    assert kernel.paced(np.float32(60.0), 0.2, np.int64(1)) == kernel.paced(60.0, 0.2, 1.0)
    with pytest.raises(ZeroDivisionError):
        kernel.view_pose(Reference, x, *[bad] * 8, three)
    with pytest.raises(ZeroDivisionError):
        kernel.law(x, J, seven, x, x, (bad, seven), numbers, seven, False, 0)
    with pytest.raises(TypeError, match="the objective must be a Block or a tuple"):
        kernel.law(x, J, seven, x, x, bad, numbers, seven, False, 0)


@pytest.mark.parametrize("n", [3, 6, 7, 9])
def test_least_singular_values_are_those_of_lapack(n: int) -> None:
    rng = np.random.default_rng(7)
    J = rng.normal(size=(50, 6, n)) * 10.0 ** rng.uniform(-3.0, 0.0, size=(50, 6, 1))
    found = _kernel.least_singular_values(J)
    assert_allclose(found, np.linalg.svd(J, compute_uv=False)[:, -1], rtol=1e-9, atol=1e-15)
    twins = np.eye(6, n)[None]
    twins[0, 1, 0] = 0.9e-9  # equal values, rows that are hardly not orthogonal
    assert_allclose(_kernel.least_singular_values(twins), 1.0, rtol=1e-9)
