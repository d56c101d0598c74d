from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, derivative, random_placement, robot_toml
from numpy.typing import ArrayLike
from oracles.kinematics import kinematic_hessian
from scipy.spatial.transform import Rotation

from rcmqp import Arm, ArmState, load_arm
from rcmqp.errors import FrameNotFound, InvalidCommand, JointLimitViolated, OptionError
from rcmqp.maths.dualquaternion import Array


def along_joints(arm: Arm, q: Array, f: Callable[[ArmState], ArrayLike]) -> Array:
    """Derivative of f(state) along pin.integrate, one joint after the other: (..., nv)."""

    def along(v: Array) -> Array:
        return derivative(lambda t: f(arm.state(pin.integrate(arm.model, q, t * v))))

    return np.stack([along(v) for v in np.eye(arm.nv)], axis=-1)


def random_q(arm: Arm, rng: np.random.Generator) -> Array:
    return arm.configuration(arm.random_angles(rng))


def transform(rotation: Rotation, xyz: Sequence[float]) -> Array:
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = rotation.as_matrix(), xyz
    return M


# Forward kinematics ------------------------------------------------------------------------


def test_flange_is_where_the_whole_urdf_puts_it(arm: Arm) -> None:
    """With grippers and all, as Pinocchio reads it, then robot.toml's offset by scipy."""
    rng = np.random.default_rng(7)
    assert arm.urdf is not None
    whole = pin.buildModelFromUrdf(str(arm.urdf))
    data, frame_id = whole.createData(), whole.getFrameId(arm.flange)
    entry = robot_toml(arm.name)
    offset = transform(
        Rotation.from_euler("xyz", entry["flange"].get("rpy", [0.0, 0.0, 0.0])),
        entry["flange"].get("xyz", [0.0, 0.0, 0.0]),
    )
    for _ in range(5):
        angles = arm.random_angles(rng)
        positions = {**entry.get("locked", {}), **dict(zip(arm.joints, angles, strict=True))}
        q = pin.neutral(whole)
        for name, angle in positions.items():
            joint = whole.joints[whole.getJointId(name)]
            coordinates = [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
            q[joint.idx_q : joint.idx_q + joint.nq] = coordinates
        pin.framesForwardKinematics(whole, data, q)
        expected = data.oMf[frame_id].homogeneous @ offset
        oMe = arm.state(arm.configuration(angles)).oMe
        assert_allclose(oMe.homogeneous, expected, rtol=0, atol=1e-14)


def test_lwa3_is_the_published_chain() -> None:
    """Standard DH of dqrobotics/cpp a02bb8f, robot_dh/Schunk.h: theta 0, a 0."""
    d = [0.3, 0.0, 0.328, 0.0, 0.2765, 0.0, 0.1793]
    alpha = np.radians([-90, 90, -90, 90, -90, 90, 0])
    rng = np.random.default_rng(7)
    arm = load_arm("lwa3")
    for _ in range(20):
        theta, expected = arm.random_angles(rng), np.eye(4)
        for i in range(7):
            expected = expected @ transform(Rotation.from_euler("z", theta[i]), [0, 0, d[i]])
            expected = expected @ transform(Rotation.from_euler("x", alpha[i]), [0, 0, 0])
        assert_allclose(arm.state(theta).oMe.homogeneous, expected, rtol=0, atol=1e-12)


def test_meka_a2_is_the_makers_chain() -> None:
    """Craig's DH of CentralLabFacilities/m3meka 6e5d6b7, config_arm_a2r2.py, tool included.

    Ours has the same base and tool point; our flange is the maker's end frame turned about z.
    """
    alpha = np.radians([90, 90, 90, 90, -90, 90, 90, 90])
    a = [0.0, 0.0, 0.03175, -0.00502, 0.0, 0.0, 0.0, 0.0]
    d = [0.18465, 0.0, 0.27857, 0.0, 0.27747, 0.0, 0.0, 0.04414]
    offset = np.radians([-90, 90, 90, 0, 0, 90, 90, 0])
    rng = np.random.default_rng(7)
    arm = load_arm("meka_a2")
    for _ in range(20):
        angles, expected = arm.random_angles(rng), np.eye(4)
        theta = np.append(angles, 0.0) + offset
        for i in range(8):
            expected = expected @ transform(Rotation.from_euler("x", alpha[i]), [a[i], 0, 0])
            expected = expected @ transform(Rotation.from_euler("z", theta[i]), [0, 0, d[i]])
        expected = expected @ transform(Rotation.from_euler("z", -np.pi / 2), [0, 0, 0])
        assert_allclose(arm.state(angles).oMe.homogeneous, expected, rtol=0, atol=1e-12)


def test_with_effector_moves_the_effector_and_leaves_the_arm_alone(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    flangeMe, q = random_placement(rng), random_q(arm, rng)
    moved = arm.with_effector(flangeMe)
    flange, effector = arm.state(q), moved.state(q)
    expected = flange.oMe * flangeMe
    assert_allclose(effector.oMe.homogeneous, expected.homogeneous, rtol=0, atol=1e-14)
    assert_allclose(
        effector.J_local, flangeMe.inverse().action @ flange.J_local, rtol=0, atol=1e-13
    )
    assert arm.state(q).oMe == flange.oMe
    back = moved.with_effector(pin.SE3.Identity()).state(q)  # counted from the flange again
    assert back.oMe == flange.oMe


# Differential kinematics -------------------------------------------------------------------


def test_jacobians_are_derivatives_of_the_placement(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    for effector in (arm, arm.with_effector(random_placement(rng))):
        q = random_q(arm, rng)
        state = effector.state(q)
        M, x = state.oMe, state.x

        def local_twist(s: ArmState, M: pin.SE3 = M) -> Array:
            return np.array(pin.log6(M.actInv(s.oMe)).vector)

        def aligned_twist(s: ArmState, M: pin.SE3 = M) -> Array:
            turn = pin.log3(s.oMe.rotation @ M.rotation.T)
            return np.concatenate([s.oMe.translation, turn])

        def same_cover(s: ArmState, x: Array = x) -> Array:
            return s.x if s.x @ x > 0 else -s.x

        for found, f in (
            (state.J_local, local_twist),
            (state.J_world_aligned, aligned_twist),
            (state.J_dq, same_cover),
        ):
            assert found.shape == (8 if f is same_cover else 6, arm.nv)
            assert_allclose(found, along_joints(effector, q, f), rtol=0, atol=1e-10)


def test_kinematic_hessian_is_the_derivative_of_the_jacobian(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    for effector in (arm, arm.with_effector(random_placement(rng))):
        q = random_q(arm, rng)
        expected = along_joints(effector, q, lambda s: s.J_local)
        found = kinematic_hessian(effector.state(q).J_local)
        assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_dual_quaternion_is_that_of_the_placement(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    state = arm.state(random_q(arm, rng))
    xyz_xyzw = pin.SE3ToXYZQUAT(state.oMe)
    t, (x, y, z, w) = xyz_xyzw[:3], xyz_xyzw[3:]
    r, v = np.array([w, x, y, z]), np.array([x, y, z])
    expected = np.concatenate([r, 0.5 * np.array([-t @ v, *(w * t + np.cross(t, v))])])
    assert_allclose(state.x * np.sign(state.x @ expected), expected, rtol=0, atol=1e-14)


# States ------------------------------------------------------------------------------------


def test_state_cannot_be_written_and_survives_the_next_one(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    q = random_q(arm, rng)
    state = arm.state(q)
    placement, *kept = (
        value.copy() for value in (state.oMe, state.q, state.angles, state.x, state.J_local)
    )
    q_next = random_q(arm, rng)
    assert arm.state(q_next).oMe != placement
    q[:] = q_next  # nor is it a view of what it was made from
    assert state.oMe == placement
    for array, copy in zip((state.q, state.angles, state.x, state.J_local), kept, strict=True):
        assert np.array_equal(array, copy)
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_state_is_the_same_to_the_bit_whatever_came_before(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    q = random_q(arm, rng)
    first = arm.state(q)
    arm.state(random_q(arm, rng))
    again = arm.state(q)
    assert first.oMe == again.oMe
    assert np.array_equal(first.x, again.x)
    assert np.array_equal(first.J_local, again.J_local)


@pytest.mark.parametrize(
    ("q", "message"),
    [
        ([0.0] * 6, r"configuration q has shape \(6,\), it must be \(7,\)"),
        ([[0.0] * 7], r"configuration q has shape \(1, 7\), it must be \(7,\)"),
    ],
)
def test_state_refuses_what_is_no_configuration(lwa3: Arm, q: list[float], message: str) -> None:
    with pytest.raises(InvalidCommand, match=message):
        lwa3.state(q)


# Configurations and angles -----------------------------------------------------------------


def test_angles_and_configurations_are_each_others_inverse(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    angles = arm.random_angles(rng)
    q = arm.configuration(angles)
    assert q.shape == (arm.nq,)
    assert_allclose(arm.angles(q), angles, rtol=0, atol=1e-15)
    assert np.array_equal(arm.state(q).angles, arm.angles(q))
    assert pin.isNormalized(arm.model, q, 1e-15)
    q = pin.integrate(arm.model, pin.neutral(arm.model), rng.uniform(-3, 3, arm.nv))
    assert_allclose(arm.configuration(arm.angles(q)), q, rtol=0, atol=1e-15)


def test_angles_run_as_pinocchio_integrates(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    angles, v = arm.random_angles(rng) / 2, rng.normal(size=arm.nv)
    q = arm.integrate(arm.configuration(angles), v, 0.1)
    assert np.array_equal(q, pin.integrate(arm.model, arm.configuration(angles), 0.1 * v))
    assert_allclose(arm.angles(q), angles + 0.1 * v, rtol=0, atol=1e-14)


def test_continuous_joints_have_no_limits_and_two_coordinates() -> None:
    arm = load_arm("kinova")
    continuous = [joint.nq == 2 for joint in arm.model.joints[1:]]
    assert (arm.nq, arm.nv) == (9, 6)
    assert np.array_equal(np.isinf(arm.lower), continuous)
    assert np.array_equal(np.isinf(arm.upper), continuous)
    assert np.array_equal(np.isinf(arm.limit_margin(arm.home)), continuous)


# Limits ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "lower", "upper", "velocity"),
    [
        (  # position: ipa320/schunk_modular_robotics b2d73bd lwa.urdf.xacro (joints 1, 2, 4, 6),
            # rdiankov/collada_robots 98c0760 schunk-lwa3.zae (3, 5, 7); velocity: the latter
            "lwa3",
            [-3.1415, -1.97, -2.7925, -1.97, -2.7925, -1.97, -2.7925],
            [3.1415, 1.97, 2.7925, 1.97, 2.7925, 1.97, 2.7925],
            [0.43808, 0.58469, 0.41888, 0.55851, 0.47473, 0.87266, 0.87266],
        ),
        (  # CentralLabFacilities/meka-ros-pkg 468acd8..ed35893 A2R2_r_arm_defs.urdf.xacro
            "meka_a2",
            [-1.39626, -0.41888, -1.48353, 0.00318, -0.86219, -1.02678, -1.04720],
            [3.49066, 2.61799, 1.48353, 2.31810, 4.00379, 1.02678, 1.04720],
            [0.52360, 0.52360, 0.87266, 0.87266, 2.61799, 0.69813, 0.69813],
        ),
    ],
)
def test_limits_are_those_of_the_sources(
    name: str, lower: list[float], upper: list[float], velocity: list[float]
) -> None:
    arm = load_arm(name)
    for found, expected in (
        (arm.lower, lower),
        (arm.upper, upper),
        (arm.velocity, velocity),
    ):
        assert_allclose(found, expected, rtol=0, atol=5.1e-6)  # noted to five digits


def test_limit_margin_is_the_distance_to_the_nearer_limit(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    angles = rng.uniform(-4, 4, size=(3, 2, arm.nv))
    margin = arm.limit_margin(angles)
    for index in np.ndindex(margin.shape):
        angle, joint = angles[index], index[-1]
        assert margin[index] == min(angle - arm.lower[joint], arm.upper[joint] - angle)


def test_check_limits_names_the_joint_farthest_outside(arm: Arm) -> None:
    for joint in np.flatnonzero(np.isfinite(arm.upper)):
        for limit, outwards in ((arm.lower, -1.0), (arm.upper, 1.0)):
            angles = arm.home.copy()
            angles[joint] = limit[joint]
            arm.check_limits(angles)  # on the limit is inside
            angles[joint] = limit[joint] + 0.01 * outwards
            with pytest.raises(JointLimitViolated, match="start from") as caught:
                arm.check_limits(angles)
            assert caught.value.joint == arm.joints[joint]
            assert caught.value.position == angles[joint]
            angles[joint] = limit[joint] + 0.3 * outwards
            other = next(i for i in np.flatnonzero(np.isfinite(arm.upper)) if i != joint)
            angles[other] = arm.upper[other] + 0.2
            with pytest.raises(JointLimitViolated, match=arm.joints[joint]):
                arm.check_limits(angles)


def test_a_limit_violation_says_by_how_much(lwa3: Arm) -> None:
    with pytest.raises(JointLimitViolated, match=r"at 2\.0000 rad, allowed \[-1\.9700, 1\.9700\]"):
        lwa3.check_limits([0, 2.0, 0, 0, 0, 0, 0])
    with pytest.raises(InvalidCommand, match=r"joint angles has shape \(6,\)"):
        lwa3.check_limits([0.0] * 6)


def test_random_angles_fill_the_limits_and_a_turn_where_there_are_none(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    angles = np.array([arm.random_angles(rng) for _ in range(300)])
    assert (arm.limit_margin(angles) >= 0).all()
    limited = np.isfinite(arm.upper)
    assert (np.abs(angles[:, ~limited]) <= np.pi).all()
    widths = np.full(arm.nv, 2 * np.pi)
    widths[limited] = (arm.upper - arm.lower)[limited]
    assert (np.ptp(angles, axis=0) > 0.9 * widths).all()


# Reach and construction --------------------------------------------------------------------


def test_reach_is_that_of_the_straight_arm_without_its_instrument() -> None:
    instrument = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0]))
    for arm in (load_arm("lwa3"), load_arm("lwa3").with_effector(instrument)):
        assert arm.reach == pytest.approx(0.328 + 0.2765 + 0.1793, abs=1e-6)


def test_reach_bounds_every_configuration_and_is_found_with_bounded_effort(
    arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(7)
    shoulder = arm.model.jointPlacements[1].translation
    distances = [
        np.linalg.norm(arm.state(random_q(arm, rng)).oMe.translation - shoulder)
        for _ in range(1000)
    ]
    passes, state = itertools.count(), Arm.state

    def counted(self: Arm, q: ArrayLike) -> ArmState:
        assert next(passes) < 20_000
        return state(self, q)

    monkeypatch.setattr(Arm, "state", counted)
    assert max(distances) <= arm.reach <= 1.2 * max(distances)


def test_arm_refuses_what_does_not_fit_its_model(lwa3: Arm) -> None:
    model = lwa3.model
    with pytest.raises(FrameNotFound, match=r"'flang' .*did you mean flange\? \(the last"):
        Arm(model, "flang", name="x")
    with pytest.raises(FrameNotFound, match=r"model; \(the last ones are .*flange\)"):
        Arm(model, "tool0", name="x")
    for key in ("home", "acceleration", "srs_offsets"):
        options: dict[str, Any] = {key: [0.0] * 6}
        with pytest.raises(OptionError, match=rf"{key} has shape \(6,\), the arm has 7 joints"):
            Arm(model, "flange", name="x", **options)


def test_arm_without_a_home_starts_in_the_middle_and_cannot_be_written(arm: Arm) -> None:
    plain = Arm(arm.model, arm.flange, name="x")
    for joint, (low, high) in enumerate(zip(arm.lower, arm.upper, strict=True)):
        middle = (low + high) / 2 if np.isfinite(high) else 0.0
        assert plain.home[joint] == plain.middle[joint] == pytest.approx(middle, abs=1e-15)
    assert plain.assumed == {"acceleration", "jerk"}
    for array in (plain.home, plain.middle, plain.lower, plain.upper, plain.velocity):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


# The joint velocity ------------------------------------------------------------------------


def test_a_state_carries_the_joint_velocity_that_was_measured(arm: Arm) -> None:
    q = arm.configuration(arm.home)
    assert not arm.state(q).v.any()
    v = np.linspace(-1.0, 1.0, arm.nv)
    state = arm.state(q, v)
    v[:] = np.nan
    assert np.array_equal(state.v, np.linspace(-1.0, 1.0, arm.nv))
    with pytest.raises(ValueError, match="read-only"):
        state.v[0] = 0.0
    assert np.array_equal(state.x, arm.state(q).x)


def test_a_joint_velocity_or_acceleration_of_another_size_is_refused(lwa3: Arm) -> None:
    six = np.zeros(6)
    for v in (six, [[0.0] * 7]):
        shape = re.escape(str(np.shape(v)))
        with pytest.raises(InvalidCommand, match=rf"joint velocity v has shape {shape}"):
            lwa3.state(lwa3.home, v, six)
    for given in (None, lwa3.home):
        with pytest.raises(InvalidCommand, match=r"joint acceleration a has shape \(6,\)"):
            lwa3.state(lwa3.home, given, six)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_reading_that_failed_is_carried_and_nothing_finite_is_made_of_it(
    arm: Arm, bad: float
) -> None:
    q = arm.configuration(arm.home)
    q[0] = bad
    state = arm.state(q, np.full(arm.nv, bad))
    assert np.array_equal(state.q, q, equal_nan=True)
    assert not np.isfinite(state.v).any()
    assert np.isnan(state.x).all()
    assert not np.isfinite(state.oMe.translation).any()
    assert arm.state(arm.configuration(arm.home)).x @ arm.state(q).x != 1.0
    assert np.isfinite(arm.state(arm.configuration(arm.home)).J_local).all()  # nothing is left
