from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, random_placement
from oracles.desired import H4_minus, H4_plus
from scipy.spatial.transform import Rotation

from rcmqp.errors import InvalidCommand
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array

COVERS = pytest.mark.parametrize("cover", [1.0, -1.0], ids=["x", "-x"])
AXES = [np.eye(3)[2], -np.eye(3)[0], np.array([2.0, -3.0, 6.0]) / 7.0]


def quaternion_matrix(q: Array) -> Array:
    """Hamilton's quaternions as (2, 2) complex matrices, whose product is the matrix product."""
    w, x, y, z = q
    return np.array([[w + 1j * x, y + 1j * z], [-y + 1j * z, w - 1j * x]])


def matrix(x: Array) -> Array:
    """A dual quaternion as a (4, 4) complex matrix [[P, D], [0, P]]: eps^2 = 0 by its shape."""
    primary, dual = quaternion_matrix(x[:4]), quaternion_matrix(x[4:])
    return np.block([[primary, dual], [np.zeros((2, 2)), primary]])


def homogeneous(x: Array) -> Array:
    """The (4, 4) homogeneous matrix of a pose, by scipy and t = 2 D P* spelled out."""
    (w, *v), (dw, *dv) = x[:4], x[4:]
    M = np.eye(4)
    M[:3, :3] = Rotation.from_quat([*v, w]).as_matrix()
    M[:3, 3] = 2.0 * (w * np.array(dv) - dw * np.array(v) - np.cross(dv, v))
    return M


def random_pose(rng: np.random.Generator) -> Array:
    return dq.from_se3(random_placement(rng))


# Products and operators --------------------------------------------------------------------


@pytest.mark.parametrize(
    "rule",
    (
        "ij=+k jk=+i ki=+j ji=-k kj=-i ik=-j ii=-1 jj=-1 kk=-1 "
        "11=+1 1i=+i i1=+i 1j=+j j1=+j 1k=+k k1=+k"
    ).split(),
)
def test_product_follows_hamiltons_rules(rule: str) -> None:
    unit = dict(zip("1ijk", np.eye(4), strict=True))
    product = dq.quaternion_mul(unit[rule[0]], unit[rule[1]])
    assert np.array_equal(product, float(rule[3] + "1") * unit[rule[4]])


def test_hamilton_operators_of_many_poses_are_those_of_each() -> None:
    x = np.random.default_rng(3).normal(size=(2, 3, 8))
    for operator in (dq.H8_plus, dq.H8_minus):
        assert operator(x).shape == (2, 3, 8, 8)
        assert np.array_equal(operator(x)[1, 2], operator(x[1, 2]))


def test_products_are_those_of_complex_matrices() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        x, y = rng.normal(size=(2, 8))
        expected = matrix(x) @ matrix(y)
        for product in (dq.mul(x, y), dq.H8_plus(x) @ y, dq.H8_minus(y) @ x):
            assert_allclose(matrix(product), expected, rtol=0, atol=1e-14)
        a, b = x[:4], y[:4]
        for product in (dq.quaternion_mul(a, b), H4_plus(a) @ b, H4_minus(b) @ a):
            assert_allclose(
                quaternion_matrix(product),
                quaternion_matrix(a) @ quaternion_matrix(b),
                rtol=0,
                atol=1e-14,
            )


def test_conjugation_reverses_products() -> None:
    rng = np.random.default_rng(7)
    x, y = rng.normal(size=(2, 8))
    expected = matrix(dq.mul(dq.conj(y), dq.conj(x)))
    assert_allclose(matrix(dq.conj(dq.mul(x, y))), expected, rtol=0, atol=1e-14)
    for half in (dq.P, dq.D):  # of the complex matrices, it is the conjugate transpose
        q, q_conj = quaternion_matrix(half(x)), quaternion_matrix(half(dq.conj(x)))
        assert np.array_equal(q_conj, q.conj().T)
    assert np.array_equal(dq.C8 @ x, dq.conj(x))
    assert np.array_equal(dq.C4 @ x[:4], dq.quaternion_conj(x[:4]))


def test_norm_is_the_dual_root_of_x_times_its_conjugate() -> None:
    rng = np.random.default_rng(7)
    x = rng.normal(size=8)
    a, b = dq.norm(x)  # (a + eps b)^2 = a^2 + eps 2 a b
    expected = [a**2, 0, 0, 0, 2 * a * b, 0, 0, 0]
    assert_allclose(dq.mul(x, dq.conj(x)), expected, rtol=0, atol=1e-14)
    assert_allclose(dq.norm(random_pose(rng)), [1.0, 0.0], rtol=0, atol=1e-15)


def test_vec_and_parts_take_the_numbers_in_order() -> None:
    x = np.arange(8.0)
    assert dq.vec(x).tolist() == [0, 1, 2, 3, 4, 5, 6, 7]
    assert dq.P(x).tolist() == [0, 1, 2, 3]
    assert dq.D(x).tolist() == [4, 5, 6, 7]


@pytest.mark.parametrize("constant", [dq.C4, dq.C8, dq.IDENTITY], ids=["C4", "C8", "IDENTITY"])
def test_constants_cannot_be_written(constant: Array) -> None:
    with pytest.raises(ValueError, match="read-only"):
        constant[0] = 2.0


# Poses -------------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1e-8, 1.0, 30.0])
def test_poses_are_those_of_pinocchio(scale: float) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        aMb, bMc = (pin.exp6(rng.normal(scale=scale, size=6)) for _ in range(2))
        x, y = dq.from_se3(aMb), dq.from_se3(bMc)
        tolerance = 1e-14 * max(1.0, scale)
        assert_allclose(homogeneous(x), aMb.homogeneous, rtol=0, atol=tolerance)
        assert_allclose(dq.translation(x), aMb.translation, rtol=0, atol=tolerance)
        aMc, bMa = homogeneous(dq.mul(x, y)), homogeneous(dq.conj(x))
        assert_allclose(aMc, (aMb * bMc).homogeneous, rtol=0, atol=2 * tolerance)
        assert_allclose(bMa, aMb.inverse().homogeneous, rtol=0, atol=tolerance)
        assert_allclose(dq.to_se3(-x).homogeneous, aMb.homogeneous, rtol=0, atol=tolerance)


def test_pose_is_translation_then_rotation() -> None:
    rng = np.random.default_rng(7)
    aMb = random_placement(rng)
    w, v = pin.Quaternion(aMb.rotation).w, pin.Quaternion(aMb.rotation).vec()
    x = dq.pose([w, *v], aMb.translation)
    assert_allclose(homogeneous(x), aMb.homogeneous, rtol=0, atol=1e-14)
    parts = dq.mul(dq.from_translation(aMb.translation), dq.from_rotation([w, *v]))
    assert_allclose(parts, x, rtol=0, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 3.0, np.pi, -np.pi, 4.0])
def test_from_se3_is_a_unit_with_positive_w_at_every_angle(angle: float) -> None:
    rng = np.random.default_rng(7)
    for axis in AXES:
        aMb = pin.SE3(Rotation.from_rotvec(angle * axis).as_matrix(), rng.normal(size=3))
        x = dq.from_se3(aMb)
        assert x[0] >= 0.0
        assert dq.is_unit(x, 1e-15)
        assert_allclose(dq.to_se3(x).homogeneous, aMb.homogeneous, rtol=0, atol=1e-14)


def test_rotation_and_rotate_agree_with_scipy() -> None:
    rng = np.random.default_rng(7)
    for axis in AXES:
        angle, p = rng.uniform(-6, 6), rng.normal(size=3)
        expected = Rotation.from_rotvec(angle * axis).apply(p)
        assert_allclose(dq.rotate(dq.rotation(axis, angle), p), expected, rtol=0, atol=1e-14)


def test_place_is_pinocchios_act() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        aMb, p = random_placement(rng), rng.normal(size=3)
        assert_allclose(dq.place(dq.from_se3(aMb), p), aMb.act(p), rtol=0, atol=1e-14)


def test_one_element_and_a_row_of_many_have_the_same_bits() -> None:
    rng = np.random.default_rng(4)
    x, y, p = rng.normal(size=(9, 8)), rng.normal(size=(9, 8)), rng.normal(size=(9, 3))
    for many, one in (
        (
            dq.quaternion_mul(x[:, :4], y[:, :4]),
            [dq.quaternion_mul(a[:4], b[:4]) for a, b in zip(x, y, strict=True)],
        ),
        (dq.rotate(x[:, :4], p), [dq.rotate(a[:4], b) for a, b in zip(x, p, strict=True)]),
        (dq.translation(x), [dq.translation(a) for a in x]),
        (dq.place(x, p), [dq.place(a, b) for a, b in zip(x, p, strict=True)]),
    ):
        assert np.array_equal(many, np.array(one))


def test_is_unit_accepts_poses_and_nothing_else() -> None:
    rng = np.random.default_rng(7)
    x = random_pose(rng)
    off_dual = np.concatenate([np.zeros(4), x[:4]])  # along P, where no pose has its dual part
    for good in (x, -x, list(x), x * (1 + 0.9e-9), x + 0.9e-9 * off_dual):
        assert dq.is_unit(good)
        assert np.array_equal(dq.check_unit(good), good)
    assert dq.is_unit(1.01 * x, tolerance=0.1)
    for bad, message in (
        (x[:4], r"wish has shape \(4,\), it must be \(8,\)"),
        (x * np.nan, "wish is not finite"),
        (x * (1 + 1.1e-9), r"wish is not a pose: \|P\| - 1 = 1\.1e-09"),
        (x + 1e-3 * off_dual, r"P\.D = 0\.001, allowed 1e-09; build it with pose\(\)"),
    ):
        assert not dq.is_unit(bad)
        with pytest.raises(InvalidCommand, match=message):
            dq.check_unit(bad, "wish")
        with pytest.raises(InvalidCommand):
            dq.to_se3(bad)


# Logarithm, exponential and power ----------------------------------------------------------

TINY = [1e-300, 1e-200, 1e-155, 1e-17, 1e-8]


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("half", [*TINY, 0.3, 1.5, np.pi / 2, 1.6, 3.0])
def test_log_is_the_axis_times_half_the_angle(half: float, axis: Array) -> None:
    log = dq.quaternion_log([np.cos(half), *(np.sin(half) * axis)])
    assert_allclose(log, half * axis, rtol=4e-16, atol=1e-320)


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("short", TINY)
def test_log_holds_up_to_a_full_turn(short: float, axis: Array) -> None:
    log = dq.quaternion_log([-np.cos(short), *(np.sin(short) * axis)])
    assert_allclose(log, (np.pi - short) * axis, rtol=4e-16, atol=0)


def test_log_at_the_exact_corners() -> None:
    assert dq.quaternion_log([1.0, 0.0, 0.0, 0.0]).tolist() == [0.0, 0.0, 0.0]
    assert dq.quaternion_log([1.0 + 2e-16, 0.0, 0.0, 0.0]).tolist() == [0.0, 0.0, 0.0]
    assert dq.quaternion_log([0.0, 0.0, 1.0, 0.0]).tolist() == [0.0, np.pi / 2, 0.0]
    assert dq.quaternion_log([-1.0, 0.0, 0.0, 0.0]).tolist() == [np.pi, 0.0, 0.0]
    assert dq.quaternion_log([-1.0, -0.0, -0.0, -0.0]).tolist() == [np.pi, 0.0, 0.0]


@COVERS
@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-9, 1.0, np.pi - 1e-9, np.pi, 5.0])
def test_exp_undoes_log_on_both_covers(angle: float, cover: float) -> None:
    rng = np.random.default_rng(7)
    for axis in AXES:
        x = cover * dq.pose(dq.rotation(axis, angle), rng.normal(size=3))
        assert_allclose(dq.exp(dq.log(x)), x, rtol=0, atol=2e-15)


@pytest.mark.parametrize("half", [0.0, *TINY, 1.0, 3.1])
def test_log_undoes_exp_below_a_full_turn(half: float) -> None:
    rng = np.random.default_rng(7)
    for axis in AXES:
        y = np.array([0.0, *(half * axis), 0.0, *rng.normal(size=3)])
        assert_allclose(dq.log(dq.exp(y)), y, rtol=0, atol=1e-14)


def test_log_and_exp_are_those_of_the_paper() -> None:
    rng = np.random.default_rng(7)
    theta, n, t = 2.0, AXES[2], rng.normal(size=3)
    y = [0.0, *(theta / 2 * n), 0.0, *(t / 2)]  # n theta/2 + eps t/2, section II-A
    aMb = pin.SE3(Rotation.from_rotvec(theta * n).as_matrix(), t)
    assert_allclose(dq.log(dq.from_se3(aMb)), y, rtol=0, atol=1e-15)
    assert_allclose(homogeneous(dq.exp(y)), aMb.homogeneous, rtol=0, atol=1e-15)
    group = pin.exp6(0.5 * pin.log6(aMb))  # for rotations alone the group's halfway is the same
    half = dq.to_se3(dq.power(dq.from_se3(aMb), 0.5))
    assert_allclose(half.rotation, group.rotation, rtol=0, atol=1e-15)
    assert np.linalg.norm(half.translation - group.translation) > 0.01


@pytest.mark.parametrize("s", [-1.0, 0.0, 0.25, 1.0, 2.0])
def test_power_multiplies_angle_and_translation(s: float) -> None:
    rng = np.random.default_rng(7)
    theta, n, t = 1.2, AXES[2], rng.normal(size=3)
    x = dq.from_se3(pin.SE3(Rotation.from_rotvec(theta * n).as_matrix(), t))
    expected = pin.SE3(Rotation.from_rotvec(s * theta * n).as_matrix(), s * t)
    assert_allclose(homogeneous(dq.power(x, s)), expected.homogeneous, rtol=0, atol=1e-15)


# The double cover --------------------------------------------------------------------------


@COVERS
def test_angle_between_is_that_of_the_relative_rotation(cover: float) -> None:
    rng = np.random.default_rng(7)
    for angle in (0.0, 1e-150, 1e-9, 1.0, 3.0, np.pi):
        x = random_pose(rng)
        turn = cover * dq.pose(dq.rotation(AXES[2], angle), rng.normal(size=3))
        assert_allclose(dq.angle_between(dq.IDENTITY, turn), angle, rtol=1e-15, atol=0)
        assert_allclose(dq.angle_between(x, dq.mul(x, turn)), angle, rtol=0, atol=2e-15)
    assert_allclose(  # 4 rad one way are less the other way
        dq.angle_between(dq.IDENTITY, dq.from_rotation(dq.rotation(AXES[2], 4.0))),
        2 * np.pi - 4.0,
        rtol=1e-15,
    )


@COVERS
def test_align_sign_keeps_the_pose_and_turns_the_short_way(cover: float) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        x, like = (dq.pose(dq.P(random_pose(rng)), rng.normal(scale=9, size=3)) for _ in "ab")
        like *= cover
        aligned = dq.align_sign(x, like)
        assert np.array_equal(aligned, x) or np.array_equal(aligned, -x)
        turn = dq.log(dq.mul(dq.conj(like), aligned))
        assert 2 * np.linalg.norm(turn[:4]) <= np.pi + 1e-12
        assert np.array_equal(dq.align_sign(aligned, like), aligned)


# Leading axes ------------------------------------------------------------------------------

POSES, QUATERNIONS, VECTORS = (8,), (4,), (3,)


@pytest.mark.parametrize(
    ("function", "shapes"),
    [
        (dq.quaternion_mul, [QUATERNIONS, QUATERNIONS]),
        (dq.quaternion_conj, [QUATERNIONS]),
        (dq.rotate, [QUATERNIONS, VECTORS]),
        (dq.quaternion_exp, [VECTORS]),
        (dq.quaternion_log, [QUATERNIONS]),
        (dq.P, [POSES]),
        (dq.D, [POSES]),
        (dq.mul, [POSES, POSES]),
        (dq.conj, [POSES]),
        (dq.norm, [POSES]),
        (dq.vec, [POSES]),
        (dq.translation, [POSES]),
        (dq.pose, [QUATERNIONS, VECTORS]),
        (dq.from_rotation, [QUATERNIONS]),
        (dq.from_translation, [VECTORS]),
        (dq.log, [POSES]),
        (dq.exp, [POSES]),
        (lambda x: dq.power(x, 0.3), [POSES]),
        (dq.align_sign, [POSES, POSES]),
        (dq.angle_between, [POSES, POSES]),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_leading_axes_broadcast_element_by_element(
    function: Callable[..., Array], shapes: list[tuple[int, ...]]
) -> None:
    rng = np.random.default_rng(7)

    def draw(lead: tuple[int, ...], shape: tuple[int, ...]) -> Array:
        if shape == VECTORS:
            return rng.normal(size=(*lead, 3))
        poses = [random_pose(rng)[: shape[0]] for _ in range(int(np.prod(lead)))]
        return np.reshape(poses, (*lead, *shape))

    leads = [(5, 1), (4,)][-len(shapes) :]
    operands = [draw(lead, shape) for lead, shape in zip(leads, shapes, strict=True)]
    whole = function(*operands)
    lead = np.broadcast_shapes(*leads)
    spread = [np.broadcast_to(operand, (*lead, *operand.shape[-1:])) for operand in operands]
    assert whole.shape[: len(lead)] == lead
    for index in np.ndindex(lead):
        alone = function(*(operand[index] for operand in spread))
        assert_allclose(whole[index], alone, rtol=0, atol=1e-15)
