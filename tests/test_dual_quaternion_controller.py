"""The paper's law (6): what it computes, each mend of the printed text, and each option.

The oracle is the law written down literally, with its own dual-quaternion product, Pinocchio's
Jacobian in world axes and numpy's pinv. The tests named test_printed_* show, slip by slip, that
the paper's text fails as it is printed, and that the mend is what makes it work.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose

from rcmqp import (
    ArmState,
    Insertion,
    Instrument,
    Reference,
    Scenario,
    ViewCommand,
    arm_names,
    load_arm,
    load_scenario,
    make_controller,
    simulate,
    view_pose,
)
from rcmqp.controllers import DualQuaternion
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array, angle_between, from_se3, translation
from rcmqp.tasks.objectives import OBJECTIVES, make_objective

PAN = "shoulder_pan_joint"
PERIOD = 8e-3
SEVEN_JOINTS = [name for name in arm_names() if load_arm(name).nv == 7]
SIX_JOINTS = [name for name in arm_names() if load_arm(name).nv == 6]

SINGULAR_STARTS = [
    pytest.param("lwa3", (0.0, math.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0), id="lwa3-stretched"),
    pytest.param("lwa3", (0.0,) * 7, id="lwa3-upright"),
    pytest.param("lwa3", (0.0, 0.0, math.pi / 2, 1.2, 0.0, 1.0, 0.0), id="lwa3-shoulder"),
    pytest.param("lwa3", (0.0, 0.5, 0.0, 1.2, math.pi / 2, 0.0, 0.0), id="lwa3-wrist"),
    pytest.param("lwa3", (0.0, 0.0, 0.3, 1.2, 0.4, 0.0, 0.0), id="lwa3-both"),
    pytest.param("ur5", (0.0, -1.0, 1.0, 0.5, 0.0, 0.0), id="ur5-wrist"),
]


# The oracle --------------------------------------------------------------------------------


def hamilton(a: Array, b: Array) -> Array:
    w = a[0] * b[0] - a[1:] @ b[1:]
    return np.array([w, *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


def product(x: Array, y: Array) -> Array:
    dual = hamilton(x[:4], y[4:]) + hamilton(x[4:], y[:4])
    return np.concatenate([hamilton(x[:4], y[:4]), dual])


def conjugate(x: Array) -> Array:
    return np.array([x[0], *-x[1:4], x[4], *-x[5:]])


def size(v: Array) -> float:
    return float(np.linalg.norm(v))


def nearer(x_d: Array, x: Array) -> Array:
    return x_d if x_d[:4] @ x[:4] >= 0.0 else -x_d


def pose_jacobian(insertion: Insertion, state: ArmState) -> Array:
    """J of (1), (8, n): x' = (omega + eps v) x / 2, with the twist at the world's origin."""
    model = insertion.arm.model
    J = pin.computeJointJacobians(model, model.createData(), state.q)  # in world axes
    twists = np.vstack([np.zeros(model.nv), J[3:], np.zeros(model.nv), J[:3]])
    return np.column_stack([0.5 * product(twist, state.x) for twist in twists.T])


def error(state: ArmState, x_d: Array) -> Array:
    """Error e of (3), (8,)."""
    one: Array = np.eye(8)[0]
    return one - product(conjugate(state.x), x_d)


def matrix_N(insertion: Insertion, state: ArmState, x_d: Array) -> Array:
    """N of (3), (8, n): N v = vec(conj(x') x_d)."""
    columns = pose_jacobian(insertion, state).T
    return np.column_stack([product(conjugate(column), x_d) for column in columns])


def law(
    insertion: Insertion,
    state: ArmState,
    x_d: Array,
    objective: str = "manipulability",
    *,
    K: float = 60.0,
    K_c: float = 7.0,
    c_d: float = 1.0,
    tolerance: float = 1e-7,
) -> Array:
    """The law (6) without its T, for x_d on the side of x."""
    N = matrix_N(insertion, state, x_d)
    N_inv = np.linalg.pinv(N, rcond=tolerance)
    P = np.eye(N.shape[1]) - np.linalg.pinv(N, rcond=1e-12) @ N
    c, J_c = make_objective(objective, insertion.arm).evaluate(state)
    answer: Array = N_inv @ (K * error(state, x_d)) + P @ (K_c * J_c.T * (c_d - c))
    return answer


# What the tests start from -----------------------------------------------------------------


@functools.cache
def inserted(arm: str) -> Insertion:
    return load_scenario("conical_helix", arm).insertion()


def controller(insertion: Insertion, **options: Any) -> DualQuaternion:
    made = make_controller("dual_quaternion", insertion, PERIOD, **options)
    assert isinstance(made, DualQuaternion)
    return made


def near_start(insertion: Insertion, rng: np.random.Generator) -> ArmState:
    """A state some 10 degrees from the start: no symmetry left, no singularity near."""
    angles = insertion.angles_start + rng.uniform(-0.2, 0.2, insertion.arm.nv)
    return insertion.state(insertion.arm.configuration(angles))


def moving(x_d: Array, rate: Array) -> Reference:
    return Reference(x_d, rate, np.zeros(3), np.zeros(3))  # the law does not ask for the trocar


def still(x_d: Array) -> Reference:
    return moving(x_d, np.zeros(8))


def moved(state: ArmState, twist: Array) -> Array:
    """The pose a twist (linear, angular), in the effector's axes, away from a state."""
    return nearer(from_se3(state.oMe * pin.exp6(twist)), state.x)


def walk(
    insertion: Insertion, start: ArmState, steps: int, step: Callable[[ArmState], Array]
) -> list[ArmState]:
    """States under theta(k + 1) = theta(k) + step(state(k)); x_eff turns on without a jump."""
    states = [start]
    for _ in range(steps):
        last = states[-1]
        state = insertion.state(pin.integrate(insertion.arm.model, last.q, step(last)))
        states.append(dataclasses.replace(state, x=nearer(state.x, last.x)))
    return states


def pose_error(state: ArmState, x_d: Array) -> float:
    """Distance in metres plus angle in radians."""
    distance = size(translation(state.x) - translation(x_d))
    return distance + float(angle_between(state.x, x_d))


# The law -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", arm_names())
def test_the_law_is_equation_6_read_literally(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    for tolerance in (1e-7, 1e-2, 0.1):  # from nothing given up to a great deal
        options: dict[str, Any] = {"K_c": 3.0, "c_d": 0.4, "tolerance": tolerance}
        law_under_test = controller(insertion, gain=50.0, objective="manipulability", **options)
        for _ in range(10):
            q = insertion.arm.configuration(insertion.arm.random_angles(rng))
            state = insertion.state(q)
            x_d = moved(state, rng.normal(scale=0.3, size=6))
            expected = law(insertion, state, x_d, K=50.0, **options)
            actual = law_under_test.step(state, still(x_d)).v
            assert_allclose(actual, expected, rtol=0, atol=1e-9 * size(expected))


@pytest.mark.parametrize("name", arm_names())
def test_the_pose_error_decays_at_the_gain(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    state = near_start(insertion, rng)
    x_d = moved(state, 1e-4 * rng.normal(size=6))
    h = 1e-6  # so short that the Euler step's own error does not count
    v = controller(insertion, K_c=0.0).step(state, still(x_d)).v
    (_, after) = walk(insertion, state, 1, lambda _: h * v)
    rate = (pose_error(state, x_d) - pose_error(after, x_d)) / (h * pose_error(state, x_d))
    assert_allclose(rate, 60.0, rtol=1e-3)


@pytest.mark.parametrize("name", arm_names())
def test_the_error_is_answered_in_full_within_the_range_of_N(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    state = near_start(insertion, rng)
    for shift, angle in ((0.02, 0.0), (0.0, 0.05)):
        x_d = moved(state, np.array([shift, 0.0, shift, angle, 0.0, 0.0]))
        N, wanted = matrix_N(insertion, state, x_d), 60.0 * error(state, x_d)
        left = wanted - N @ controller(insertion).step(state, still(x_d)).v
        assert_allclose(N.T @ left, 0.0, rtol=0, atol=1e-11)
        # What N cannot reach is what unit length forbids, of second order in the angle.
        beyond = 60.0 * (1.0 - math.cos(angle / 2))
        assert_allclose(size(left), beyond, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("name", arm_names())
def test_the_sign_of_the_arms_own_pose_does_not_matter(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    state = near_start(insertion, rng)
    x_d = moved(state, rng.normal(scale=0.1, size=6))
    other = dataclasses.replace(state, x=-state.x)
    a, b = (controller(insertion).step(s, still(x_d)).v for s in (state, other))
    assert_allclose(a, b, rtol=0, atol=1e-12 * size(a))


# The slips of the printed text, and their mends ---------------------------------------------


def test_printed_equation_6_without_T_diverges() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    start = near_start(insertion, rng)
    x_d = moved(start, 1e-6 * rng.normal(size=6))

    def errors(T: float) -> list[float]:
        states = walk(insertion, start, 3, lambda s: T * law(insertion, s, x_d, K_c=0.0))
        return [pose_error(state, x_d) for state in states]

    printed, mended = errors(1.0), errors(PERIOD)
    assert_allclose(np.divide(printed[1:], printed[:-1]), 59.0, rtol=0.05)  # |1 - K|
    assert_allclose(np.divide(mended[1:], mended[:-1]), 0.52, rtol=0.01)  # 1 - K T


def test_printed_sign_of_equation_2_runs_away_from_the_view() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    start = near_start(insertion, rng)
    x_d = moved(start, 1e-3 * rng.normal(size=6))

    def final_error(sign: float) -> float:
        def step(state: ArmState) -> Array:
            J_inv = np.linalg.pinv(pose_jacobian(insertion, state), rcond=1e-3)
            return np.asarray(PERIOD * 60.0 * J_inv @ (sign * (state.x - x_d)))

        return pose_error(walk(insertion, start, 10, step)[-1], x_d)

    printed, mended = final_error(+1.0), final_error(-1.0)
    assert printed > 10.0 * pose_error(start, x_d)
    assert mended < 0.01 * pose_error(start, x_d)


def test_printed_projector_has_the_wrong_size() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    N, z = matrix_N(insertion, state, state.x), rng.normal(size=7)
    N_inv = np.linalg.pinv(N, rcond=1e-3)
    with pytest.raises(ValueError, match=r"size 7 is different from 8"):
        (np.eye(8) - N @ N_inv) @ z
    mended = (np.eye(7) - N_inv @ N) @ z
    assert size(mended) > 0.1
    assert_allclose(N @ mended, 0.0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["lwa3", "meka_a2"])
def test_printed_sign_of_the_objective_runs_away_from_c_d(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    start = near_start(insertion, rng)
    objective = make_objective("singularity_product", insertion.arm)

    def final_objective(sign: float) -> float:
        def step(state: ArmState) -> Array:
            x_d = nearer(start.x, state.x)
            return PERIOD * law(insertion, state, x_d, "singularity_product", K_c=sign * 7.0)

        return objective.evaluate(walk(insertion, start, 50, step)[-1])[0]

    printed, mended = final_objective(-1.0), final_objective(+1.0)
    assert printed < objective.evaluate(start)[0] - 1e-3
    assert mended > objective.evaluate(start)[0] + 1e-3


def test_printed_law_unwinds_more_than_300_degrees_for_minus_x_d() -> None:
    insertion = inserted("lwa3")
    start = insertion.state(insertion.q_start)
    x_d = -moved(start, np.array([0.005, 0.0, 0.0, 0.0, 0.0, 0.05]))  # 5 mm and 2.9 degrees

    def travelled(step: Callable[[ArmState], Array]) -> float:
        states = walk(insertion, start, 400, step)
        x = np.array([state.x for state in states])
        assert pose_error(states[-1], x_d) < 1e-6  # both get there
        return math.degrees(angle_between(x[1:], x[:-1]).sum())

    quiet = controller(insertion, K_c=0.0)
    printed = travelled(lambda state: 1e-3 * law(insertion, state, x_d, K_c=0.0))
    mended = travelled(lambda state: 1e-3 * quiet.step(state, still(x_d)).v)
    assert printed > 300.0
    assert mended < 3.0


# The nullspace -----------------------------------------------------------------------------


def objectives_of(arm: str) -> list[str]:
    srs = load_arm(arm).srs_offsets is not None
    return [name for name in OBJECTIVES if srs or name != "singularity_product"]


@pytest.mark.parametrize(
    ("name", "objective"), [(name, c) for name in SEVEN_JOINTS for c in objectives_of(name)]
)
@pytest.mark.parametrize("c_d", [10.0, -10.0])
def test_the_nullspace_term_serves_its_objective_and_leaves_the_pose_alone(
    name: str, objective: str, c_d: float
) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    state = near_start(insertion, rng)
    with_c, without_c = (
        controller(insertion, objective=objective, K_c=K_c, c_d=c_d).step(state, still(state.x)).v
        for K_c in (7.0, 0.0)
    )
    v_0 = with_c - without_c
    N = matrix_N(insertion, state, state.x)
    assert size(v_0) > 1e-3
    assert size(N @ v_0) <= 1e-12 * size(v_0)

    c = make_objective(objective, insertion.arm)
    h = 1e-5 / size(v_0)
    after, before = (
        c.evaluate(insertion.state(insertion.arm.integrate(state.q, v_0, sign * h)))[0]
        for sign in (1.0, -1.0)
    )
    assert (after - before) * c_d > 0.0  # up to a c_d above it, down to one below


@pytest.mark.parametrize("name", SIX_JOINTS)
def test_six_joints_have_no_nullspace(name: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    state = near_start(insertion, rng)
    with_c, without_c = (
        controller(insertion, K_c=K_c).step(state, still(state.x)).v for K_c in (7.0, 0.0)
    )
    assert_allclose(with_c, without_c, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", SEVEN_JOINTS)
@pytest.mark.parametrize("options", [{}, {"damping": 0.05}, {"tolerance": 0.05}], ids=str)
def test_the_nullspace_term_leaves_every_pose_alone(name: str, options: dict[str, float]) -> None:
    rng, insertion = np.random.default_rng(7), inserted(name)
    with_c = controller(insertion, **options)
    without = controller(insertion, K_c=0.0, **options)
    for _ in range(300):
        state = insertion.state(insertion.arm.configuration(insertion.arm.random_angles(rng)))
        v_0 = with_c.step(state, still(state.x)).v - without.step(state, still(state.x)).v
        N = matrix_N(insertion, state, state.x)
        assert size(N @ v_0) <= 1e-12 * max(1.0, size(v_0))


def test_an_arm_of_five_joints_is_refused() -> None:
    urdf = load_arm("ur5").urdf
    arm = load_arm(str(urdf), "tool0", home=[-1.6, 1.4, -1.4, -1.6, 0.0], locked={PAN: 0.0})
    insertion = Insertion.on_shaft(arm, Instrument())
    with pytest.raises(OptionError, match=r"has 5 joints; the law .* needs six or more"):
        make_controller("dual_quaternion", insertion, PERIOD)


# Near singularities ------------------------------------------------------------------------


def helix_from(arm: str, angles: Sequence[float], duration: float = 2.0) -> Scenario:
    """The helix, its trocar where the shaft is at ``angles``."""
    insertion = Insertion.on_shaft(load_arm(arm), Instrument(), angles)
    return load_scenario(
        "conical_helix",
        arm,
        angles_start=tuple(insertion.angles_start),
        trocar=insertion.trocar,
        duration=duration,
        period=PERIOD,
    )


def ready(scenario: Scenario) -> tuple[Scenario, DualQuaternion]:
    return scenario, controller(scenario.insertion())


@pytest.mark.parametrize(("arm", "angles"), SINGULAR_STARTS)
@pytest.mark.parametrize("options", [{}, {"damping": 0.05}], ids=["plain", "damped"])
def test_from_a_singular_start_velocities_stay_below_the_bound(
    arm: str, angles: Sequence[float], options: dict[str, float]
) -> None:
    """|v| <= K |e| g + |v_0|, where g is the largest number that N^+ multiplies by.

    Plain, g = 1 / (tolerance sigma_1); damped with damping >= damping_from / sqrt(2), as here,
    g = 1 / damping_from: s / (s^2 + lambda^2) grows up to s = damping_from, where lambda is 0.
    """
    scenario = helix_from(arm, angles)
    law_under_test = controller(scenario.insertion(), **options)
    run = simulate(scenario, law_under_test)
    assert run.singular_value[0] < 1e-10
    assert np.isfinite(run.v).all()
    objective = make_objective(law_under_test.options["objective"], law_under_test.insertion.arm)
    for q, v, x_d in zip(run.q, run.v, run.x_d, strict=True):
        state = law_under_test.insertion.state(q)
        x_d = nearer(x_d, state.x)
        sigma_1 = np.linalg.norm(matrix_N(law_under_test.insertion, state, x_d), 2)
        c, J_c = objective.evaluate(state)
        g = (
            1.0 / law_under_test.damping_from
            if options
            else 1.0 / (law_under_test.tolerance * sigma_1)
        )
        v_0 = 7.0 * abs(1.0 - c) * size(J_c)
        assert size(v) <= 60.0 * size(error(state, x_d)) * g + v_0 + 1e-9


@pytest.mark.parametrize(("arm", "angles"), SINGULAR_STARTS)
@pytest.mark.parametrize("velocity_limit", ["scale", "clip"])
@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_from_a_singular_start_speed_limits_are_kept_exactly(
    arm: str, angles: Sequence[float], velocity_limit: str, damping: float
) -> None:
    scenario = helix_from(arm, angles)
    insertion = scenario.insertion()
    options = {"velocity_limit": velocity_limit, "damping": damping}
    run = simulate(scenario, controller(insertion, **options))
    assert (np.abs(run.v) - insertion.arm.velocity).max() <= 0.0
    assert (run.diagnostics["scale"] < 1.0).any()  # there was something to limit


@pytest.mark.parametrize("q6", [0.003, 0.01, 0.02])
def test_near_a_singularity_that_the_path_leaves_the_rcm_holds(q6: float) -> None:
    """Wrist almost straight, rank full: a cut-off that gave this direction up lost the RCM."""
    run = simulate(*ready(helix_from("lwa3", (0.0, 0.5, 0.0, 1.2, math.pi / 2, q6, 0.0), 6.0)))
    assert (run.diagnostics["rank"] == 6).all()
    assert run.rcm_error.max() < 0.05e-3
    assert np.abs(run.v).max() < 1.5


# Options -----------------------------------------------------------------------------------


def test_feed_forward_follows_a_moving_view_without_lag() -> None:
    insertion, T = inserted("lwa3"), 1e-4
    rates = {"alpha_dot": 0.2, "beta_dot": -0.1, "gamma_dot": 0.3, "t_z_dot": 0.02}

    def view(t: float) -> Reference:
        angles = {name.removesuffix("_dot"): rate * t for name, rate in rates.items()}
        return view_pose(insertion.x_rcm, ViewCommand(**{**angles, **rates}))

    def lag(feed_forward: bool) -> float:
        law_under_test = controller(insertion, feed_forward=feed_forward, K_c=0.0)
        state = insertion.state(insertion.q_start)
        for k in range(2000):  # 12 time constants
            v = law_under_test.step(state, view(k * T)).v
            state = insertion.state(insertion.arm.integrate(state.q, v, T))
        return float(angle_between(state.x, view(2000 * T).x_d))

    speed = math.sqrt(0.2**2 + 0.1**2 + 0.3**2)
    assert_allclose(lag(False), speed / 60.0, rtol=0.02)  # v / K
    assert lag(True) < 1e-3 * speed / 60.0


def test_feed_forward_takes_minus_x_d_with_minus_its_rate() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    x_d = moved(state, rng.normal(scale=0.1, size=6))
    rate = 0.5 * product(x_d, np.array([0.0, 0.1, -0.2, 0.3, 0.0, 0.01, 0.02, -0.01]))
    law_under_test = controller(insertion, feed_forward=True)
    a, b = (law_under_test.step(state, moving(s * x_d, s * rate)).v for s in (1.0, -1.0))
    assert np.array_equal(a, b)
    still_v = law_under_test.step(state, still(x_d)).v
    assert size(a - still_v) > 0.1


def test_damping_changes_nothing_far_from_singularities() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    reference = still(moved(state, rng.normal(scale=0.1, size=6)))
    plain, damped = (controller(insertion, damping=d).step(state, reference) for d in (0.0, 0.05))
    assert plain.diagnostics["sigma_6_of_N"] > 0.02
    assert np.array_equal(plain.v, damped.v)


def test_damping_slows_the_arm_near_a_singularity_the_more_the_nearer() -> None:
    scenario = helix_from("lwa3", (0.0, 0.5, 0.0, 1.2, math.pi / 2, 1e-3, 0.0))
    insertion = scenario.insertion()
    state = insertion.state(insertion.q_start)
    N, x_d = matrix_N(insertion, state, state.x), moved(state, np.full(6, 1e-3))
    s = np.linalg.svd(N, compute_uv=False)[:6]
    assert s[-1] < 1e-3
    speeds = []
    for damping in (0.0, 0.01, 0.05):
        law_under_test = controller(insertion, damping=damping, K_c=0.0, tolerance=1e-7)
        v = law_under_test.step(state, still(x_d)).v
        lambda_2 = damping**2 * (1.0 - (s[-1] / 0.02) ** 2)
        N = matrix_N(insertion, state, x_d)
        if damping:  # the damped inverse as a regularised least-squares problem
            normal = N.T @ N + lambda_2 * np.eye(7)
            expected = np.linalg.solve(normal, N.T @ (60.0 * error(state, x_d)))
            assert_allclose(v, expected, rtol=0, atol=1e-8)
        speeds.append(size(v))
    assert speeds[0] > 5.0 * speeds[1] > 5.0 * speeds[2]


def test_scale_keeps_the_direction_and_reaches_the_limit() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    limits, reached = insertion.arm.velocity, []
    for _ in range(50):
        reference = still(moved(state, rng.normal(scale=0.3, size=6)))
        free = controller(insertion).step(state, reference)
        kept = controller(insertion, velocity_limit="scale").step(state, reference)
        assert_allclose(kept.v, kept.diagnostics["scale"] * free.v, rtol=1e-14, atol=0)
        assert free.diagnostics["scale"] == 1.0
        assert (np.abs(kept.v) - limits).max() <= 0.0
        reached.append(np.max(np.abs(kept.v) / limits))
    assert_allclose(reached, 1.0, rtol=1e-15)


def test_clip_holds_each_joint_by_itself() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    reference = still(moved(state, rng.normal(scale=0.03, size=6)))
    free = controller(insertion).step(state, reference).v
    kept = controller(insertion, velocity_limit="clip").step(state, reference).v
    limits = insertion.arm.velocity
    over = np.abs(free) > limits
    assert 0 < over.sum() < 7
    assert np.array_equal(kept[~over], free[~over])
    assert np.array_equal(kept[over], (np.sign(free) * limits)[over])


@pytest.mark.parametrize("velocity_limit", ["scale", "clip"])
def test_a_velocity_inside_the_limits_is_left_as_it_is(velocity_limit: str) -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    reference = still(moved(state, 1e-4 * rng.normal(size=6)))
    free = controller(insertion).step(state, reference)
    kept = controller(insertion, velocity_limit=velocity_limit).step(state, reference)
    assert np.array_equal(kept.v, free.v)
    assert kept.diagnostics == free.diagnostics


def test_tolerance_decides_which_directions_are_given_up() -> None:
    scenario = helix_from("lwa3", (0.0, 0.5, 0.0, 1.2, math.pi / 2, 1e-3, 0.0))
    insertion = scenario.insertion()
    state = insertion.state(insertion.q_start)
    x_d = moved(state, np.full(6, 1e-3))
    N = matrix_N(insertion, state, x_d)
    U, s, _ = np.linalg.svd(N)
    ratio = s[5] / s[0]
    for tolerance, rank in ((0.5 * ratio, 6), (2.0 * ratio, 5)):
        answer = controller(insertion, tolerance=tolerance, K_c=0.0).step(state, still(x_d))
        assert_allclose(U[:, rank:6].T @ N @ answer.v, 0.0, rtol=0, atol=1e-12)
        assert_allclose(
            U[:, :rank].T @ (N @ answer.v - 60.0 * error(state, x_d)), 0.0, rtol=0, atol=1e-12
        )
        assert_allclose(answer.diagnostics["sigma_6_of_N"], s[5], rtol=1e-9)


def test_the_diagnostics_are_what_they_are_said_to_be() -> None:
    rng, insertion = np.random.default_rng(7), inserted("lwa3")
    state = near_start(insertion, rng)
    found = controller(insertion, objective="manipulability").step(state, still(state.x))
    J = state.J_local
    expected = {
        "objective": math.sqrt(np.linalg.det(J @ J.T)),
        "sigma_6_of_N": np.linalg.svd(J, compute_uv=False)[-1] / 2.0,
        "rank": 6.0,
        "scale": 1.0,
        "safe_stop": 0.0,
    }
    assert found.diagnostics.keys() == expected.keys()
    for name, value in expected.items():
        assert_allclose(found.diagnostics[name], value, rtol=1e-9)


@pytest.mark.parametrize("name", SEVEN_JOINTS)
def test_the_arms_own_objective_is_taken_where_none_is_named(name: str) -> None:
    srs = load_arm(name).srs_offsets is not None
    own = "singularity_product" if srs else "manipulability"
    assert controller(inserted(name)).options["objective"] == own


@pytest.mark.parametrize(
    ("option", "value", "hint"),
    [
        ("objective", "manipulabilty", "did you mean manipulability"),
        ("velocity_limit", "scaled", "did you mean scale"),
        ("dampning", 0.1, "did you mean damping"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest(
    option: str, value: object, hint: str
) -> None:
    with pytest.raises(UnknownName, match=hint):
        controller(inserted("lwa3"), **{option: value})


@pytest.mark.parametrize("gain", [0.0, -1.0, 250.0, 300.0, math.nan, math.inf])
def test_a_gain_that_is_unstable_at_this_period_is_refused_with_the_number(gain: float) -> None:
    if 0.0 < gain < math.inf:
        message = rf"= {gain * PERIOD:.3g}, it must be below 2, or the law is unstable"
    else:
        message = f"gain = {gain} 1/s, it must be positive and finite"
    with pytest.raises(OptionError, match=message):
        controller(inserted("lwa3"), gain=gain)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("K_c", -1.0),
        ("K_c", math.nan),
        ("c_d", math.inf),
        ("damping", -0.1),
        ("damping", math.nan),
        ("damping_from", 0.0),
        ("damping_from", math.nan),
        ("tolerance", 0.0),
        ("tolerance", 1.0),
        ("tolerance", math.nan),
    ],
)
def test_an_option_out_of_range_is_refused_by_its_name(option: str, value: float) -> None:
    with pytest.raises(OptionError, match=rf"\b{option} = {value}"):
        controller(inserted("lwa3"), **{option: value})
