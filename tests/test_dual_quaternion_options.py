"""The paper's law near singularities, and each of its options."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from helpers import assert_allclose, inserted, near_start, nearer, size
from paper_law import (
    PERIOD,
    SEVEN_JOINTS,
    controller,
    error,
    matrix_N,
    moved,
    moving,
    product,
    still,
)

from rcmqp import (
    Insertion,
    Instrument,
    Reference,
    Scenario,
    ViewCommand,
    load_arm,
    load_scenario,
    simulate,
    view_pose,
)
from rcmqp.controllers import DualQuaternion
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import angle_between
from rcmqp.tasks.objectives import make_objective

SINGULAR_STARTS = [
    pytest.param("lwa3", (0.0, math.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0), id="lwa3-stretched"),
    pytest.param("lwa3", (0.0,) * 7, id="lwa3-upright"),
    pytest.param("lwa3", (0.0, 0.0, math.pi / 2, 1.2, 0.0, 1.0, 0.0), id="lwa3-shoulder"),
    pytest.param("lwa3", (0.0, 0.5, 0.0, 1.2, math.pi / 2, 0.0, 0.0), id="lwa3-wrist"),
    pytest.param("lwa3", (0.0, 0.0, 0.3, 1.2, 0.4, 0.0, 0.0), id="lwa3-both"),
    pytest.param("ur5", (0.0, -1.0, 1.0, 0.5, 0.0, 0.0), id="ur5-wrist"),
]


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
