from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, derivative, random_placement, shaft_distance

from rcmqp import Reference, ViewCommand, view_pose
from rcmqp.errors import InvalidCommand
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.view import carried, view_of_tip

TIP_DEPTH = 0.1


def random_commands(rng: np.random.Generator) -> list[ViewCommand]:
    scale = [1.0, 1.0, 3.0, 0.1, 1.0, 1.0, 1.0, 0.1]
    return [ViewCommand(*row) for row in rng.uniform(-1, 1, (20, 8)) * scale]


def values(command: ViewCommand) -> Array:
    """(8,): angles and depth, then their rates."""
    return np.array(dataclasses.astuple(command))


def later(command: ViewCommand, t: float) -> ViewCommand:
    """The view after a time t at constant rates."""
    now = values(command)
    return ViewCommand(*(now[:4] + t * now[4:]), *now[4:])


def tip_of(x_d: Array, x_rcm: Array) -> Array:
    """Tip seen from the trocar, in the axes of x_rcm."""
    tip = dq.to_se3(x_d).act(np.array([0.0, 0.0, TIP_DEPTH]))
    return np.array(dq.to_se3(x_rcm).actInv(tip))


# Equation (5) ------------------------------------------------------------------------------


def test_view_pose_is_the_product_of_equation_5() -> None:
    rng = np.random.default_rng(7)
    i, j, k = np.eye(3)
    for command in random_commands(rng):
        x_rcm = dq.from_se3(random_placement(rng))
        r_alpha = dq.from_rotation(dq.rotation(j, command.alpha))
        r_beta = dq.from_rotation(dq.rotation(i, command.beta))
        r_gamma = dq.from_rotation(dq.rotation(k, command.gamma))
        shift = np.array([1, 0, 0, 0, 0, 0, 0, command.t_z / 2])  # 1 + eps k t_z / 2
        expected = dq.mul(dq.mul(dq.mul(dq.mul(x_rcm, r_alpha), r_beta), r_gamma), shift)
        assert_allclose(view_pose(x_rcm, command).x_d, expected, rtol=0, atol=1e-14)


def test_the_view_at_the_start_is_x_rcm_at_rest() -> None:
    rng = np.random.default_rng(7)
    x_rcm = dq.from_se3(random_placement(rng))
    reference = view_pose(x_rcm, ViewCommand())
    assert np.array_equal(reference.x_d, x_rcm)
    assert not reference.x_d_dot.any()


@pytest.mark.parametrize(
    ("command", "towards"),
    [
        (ViewCommand(alpha=0.1), [1, 0, 0]),  # right in the image
        (ViewCommand(beta=0.1), [0, -1, 0]),  # up: the image's y points down
        (ViewCommand(t_z=0.1), [0, 0, 1]),  # further in
    ],
    ids=["alpha looks right", "beta looks up", "t_z goes in"],
)
def test_positive_commands_move_the_tip_as_promised(
    command: ViewCommand, towards: list[int]
) -> None:
    moved = tip_of(view_pose(dq.IDENTITY, command).x_d, dq.IDENTITY) - [0, 0, TIP_DEPTH]
    assert moved @ towards > 0.99 * np.linalg.norm(moved) > 0


def test_gamma_turns_the_image_and_nothing_else() -> None:
    view, rolled = (
        dq.to_se3(view_pose(dq.IDENTITY, ViewCommand(0.3, 0.2, gamma, 0.05)).x_d)
        for gamma in (0.0, 0.4)
    )
    about_z = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.4])), np.zeros(3))
    assert_allclose(rolled.homogeneous, (view * about_z).homogeneous, rtol=0, atol=1e-15)


def test_every_view_keeps_the_shaft_on_the_pivot() -> None:
    rng = np.random.default_rng(7)
    for command in random_commands(rng):
        oMrcm = random_placement(rng)
        x_d = view_pose(dq.from_se3(oMrcm), command).x_d
        assert shaft_distance(dq.to_se3(x_d), oMrcm.translation) < 1e-12


def test_x_d_dot_is_the_derivative_of_x_d() -> None:
    rng = np.random.default_rng(7)
    for command in random_commands(rng):
        x_rcm = dq.from_se3(random_placement(rng))

        def x_d(t: float, x_rcm: Array = x_rcm, command: ViewCommand = command) -> Array:
            return view_pose(x_rcm, later(command, t)).x_d

        assert_allclose(view_pose(x_rcm, command).x_d_dot, derivative(x_d), rtol=0, atol=1e-11)


# A trocar that moves -----------------------------------------------------------------------


def test_a_carried_pose_is_moved_in_the_worlds_axes_and_not_turned() -> None:
    rng = np.random.default_rng(7)
    oMe, offset = random_placement(rng), rng.normal(size=3)
    expected = pin.SE3(np.eye(3), offset) * oMe
    x = dq.from_se3(oMe)
    assert_allclose(
        dq.to_se3(carried(x, offset)).homogeneous, expected.homogeneous, rtol=0, atol=1e-14
    )
    assert_allclose(x, dq.from_se3(oMe), rtol=0, atol=0)
    assert carried(x, np.zeros(3)) is x


def test_x_d_dot_is_the_derivative_of_x_d_when_the_trocar_moves_too() -> None:
    rng = np.random.default_rng(7)
    for command in random_commands(rng):
        x_rcm = dq.from_se3(random_placement(rng))
        velocity = rng.normal(scale=0.1, size=3)

        def x_d(
            t: float, x_rcm: Array = x_rcm, view: ViewCommand = command, v: Array = velocity
        ) -> Array:
            return view_pose(carried(x_rcm, t * v), later(view, t)).x_d

        reference = view_pose(x_rcm, command, velocity)
        assert_allclose(reference.x_d_dot, derivative(x_d), rtol=0, atol=1e-11)
        assert np.array_equal(reference.pivot_dot, velocity)
        assert_allclose(reference.pivot, dq.to_se3(x_rcm).translation, rtol=0, atol=1e-15)


# Its inverse -------------------------------------------------------------------------------


def random_tips(rng: np.random.Generator) -> list[tuple[Array, Array]]:
    """Tips inside the patient and their velocities."""
    low, high = [-0.1, -0.1, 0.02], [0.1, 0.1, 0.2]
    return [(rng.uniform(low, high), rng.normal(scale=0.05, size=3)) for _ in range(20)]


def test_view_of_tip_is_the_view_whose_tip_is_there_and_moves_so() -> None:
    rng = np.random.default_rng(7)
    x_rcm = dq.from_se3(random_placement(rng))
    for p, p_dot in random_tips(rng):
        command = view_of_tip(p, p_dot, TIP_DEPTH)
        reference = view_pose(x_rcm, command)
        assert_allclose(tip_of(reference.x_d, x_rcm), p, rtol=0, atol=1e-14)
        assert (command.gamma, command.gamma_dot) == (0.0, 0.0)

        def tip(t: float, x_rcm: Array = x_rcm, command: ViewCommand = command) -> Array:
            return tip_of(view_pose(x_rcm, later(command, t)).x_d, x_rcm)

        assert_allclose(derivative(tip), p_dot, rtol=0, atol=1e-11)


def test_rates_of_view_of_tip_are_derivatives_of_its_values() -> None:
    rng = np.random.default_rng(7)
    for p, p_dot in random_tips(rng):

        def view(t: float, p: Array = p, p_dot: Array = p_dot) -> Array:
            return values(view_of_tip(p + t * p_dot, p_dot, TIP_DEPTH))[:4]

        rates = values(view_of_tip(p, p_dot, TIP_DEPTH))[4:]
        assert_allclose(rates, derivative(view, 1e-4), rtol=0, atol=1e-9)


def test_view_of_tip_gives_back_the_view() -> None:
    rng = np.random.default_rng(7)
    for command in random_commands(rng):
        plain = dataclasses.replace(command, gamma=0.0, gamma_dot=0.0, t_z=abs(command.t_z))
        p = tip_of(view_pose(dq.IDENTITY, plain).x_d, dq.IDENTITY)
        assert_allclose(
            values(view_of_tip(p, np.zeros(3), TIP_DEPTH))[:4],
            values(plain)[:4],
            rtol=0,
            atol=1e-14,
        )


# What is no view ---------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(ViewCommand)])
def test_a_command_that_is_not_finite_is_refused(field: str, bad: float) -> None:
    with pytest.raises(InvalidCommand, match=rf"not finite: .*{field}={bad}.*eight finite"):
        ViewCommand(**{field: bad})


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_tip_that_is_not_finite_is_refused(index: int, bad: float) -> None:
    good, wrong = np.array([0.01, 0.02, 0.1]), np.array([0.01, 0.02, 0.1])
    wrong[index] = bad
    for p, p_dot in ((wrong, good), (good, wrong)):
        with pytest.raises(InvalidCommand):
            view_of_tip(p, p_dot, TIP_DEPTH)


@pytest.mark.parametrize("z", [0.0, -0.1])
def test_a_tip_outside_the_patient_is_refused(z: float) -> None:
    with pytest.raises(InvalidCommand, match=rf"tip at z = {z} m .*must be inside"):
        view_of_tip([0.01, 0.0, z], [0.0, 0.0, 0.0], TIP_DEPTH)


def test_commands_and_references_are_frozen() -> None:
    reference = Reference(dq.IDENTITY, np.zeros(8), np.zeros(3), np.zeros(3))
    for data, field in ((ViewCommand(), "alpha"), (reference, "x_d")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(data, field, 0.0)


def test_a_reference_is_nobody_elses_and_cannot_be_written() -> None:
    x_rcm, drift = dq.from_se3(random_placement(np.random.default_rng(3))), np.ones(3)
    made = view_pose(x_rcm, ViewCommand(alpha=0.1), drift)
    drift[:] = 0.0
    assert np.array_equal(made.pivot_dot, np.ones(3))
    for array in (made.x_d, made.x_d_dot, made.pivot, made.pivot_dot):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
