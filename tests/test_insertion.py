from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, random_placement, shaft_distance

from rcmqp import Arm, Insertion, Instrument, Trocar
from rcmqp.errors import InsertionError, InvalidCommand, JointLimitViolated, TrocarOffShaft
from rcmqp.maths import dualquaternion as dq
from rcmqp.world.insertion import rcm_error
from rcmqp.world.instrument import vector3
from rcmqp.world.obstacles import Sphere

INSTRUMENT = Instrument(length=0.33, mount_offset=0.05)


def flange_at_home(arm: Arm) -> pin.SE3:
    return arm.with_effector(pin.SE3.Identity()).state(arm.configuration(arm.home)).oMe


def trocar_at(oMf: pin.SE3, p: tuple[float, float, float]) -> Trocar:
    """A trocar at p, seen from the flange."""
    return Trocar(vector3("pivot", oMf.act(np.array(p))), vector3("axis", oMf.rotation[:, 2]))


def test_the_effector_is_the_point_of_the_shaft_on_the_trocar(arm: Arm) -> None:
    insertion = Insertion.on_shaft(arm, INSTRUMENT, depth=0.12)
    oMf, state = flange_at_home(arm), insertion.state(insertion.q_start)
    effector = oMf * pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.05 + 0.33 - 0.12]))
    assert_allclose(state.oMe.homogeneous, effector.homogeneous, rtol=0, atol=1e-14)
    assert_allclose(insertion.trocar.pivot, effector.translation, rtol=0, atol=1e-14)
    assert_allclose(insertion.trocar.axis, effector.rotation[:, 2], rtol=0, atol=1e-14)
    assert_allclose(
        dq.to_se3(insertion.x_rcm).homogeneous, effector.homogeneous, rtol=0, atol=1e-14
    )
    assert insertion.tip_depth == pytest.approx(0.12, abs=1e-14)
    assert insertion.trocar_offset < 1e-14


def test_the_start_is_the_home_or_what_is_asked_for(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    angles = arm.home + rng.uniform(-0.1, 0.1, arm.nv)
    for insertion, expected in (
        (Insertion.on_shaft(arm, INSTRUMENT), arm.home),
        (Insertion.on_shaft(arm, INSTRUMENT, angles), angles),
    ):
        turns = (insertion.angles_start - expected) / (2 * np.pi)  # of continuous joints
        assert_allclose(turns, np.round(turns), rtol=0, atol=1e-15)
        assert_allclose(insertion.q_start, arm.configuration(expected), rtol=0, atol=1e-15)
        for array in (insertion.angles_start, insertion.q_start, insertion.x_rcm):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0.0


def test_the_tip_is_at_the_end_of_the_shaft_wherever_the_arm_goes(arm: Arm) -> None:
    rng = np.random.default_rng(7)
    insertion = Insertion.on_shaft(arm, INSTRUMENT)
    flange = arm.with_effector(pin.SE3.Identity())
    qs = [arm.configuration(arm.random_angles(rng)) for _ in range(5)]
    expected = [flange.state(q).oMe.act(np.array([0.0, 0.0, 0.38])) for q in qs]
    x = np.array([insertion.state(q).x for q in qs])
    assert_allclose(insertion.tip(x), expected, rtol=0, atol=1e-14)
    assert_allclose(insertion.tip(x[0]), expected[0], rtol=0, atol=1e-14)


def test_rcm_error_and_depth_are_the_distances_of_the_geometry(lwa3: Arm) -> None:
    rng = np.random.default_rng(7)
    placements = [random_placement(rng) for _ in range(6)]
    pivots, inserted = rng.normal(size=(2, 1, 3)), Insertion.on_shaft(lwa3, INSTRUMENT)
    x = np.array([dq.from_se3(oMe) for oMe in placements])
    errors = rcm_error(x, pivots)
    depths = inserted.depth(x, pivots)
    assert errors.shape == depths.shape == (2, 6)
    for i, j in np.ndindex(2, 6):
        oMe, pivot = placements[j], pivots[i, 0]
        beyond = oMe.act(np.array([0.0, 0.0, inserted.tip_depth])) - pivot
        assert errors[i, j] == pytest.approx(shaft_distance(oMe, pivot), abs=1e-14)
        assert depths[i, j] == pytest.approx(beyond @ oMe.rotation[:, 2], abs=1e-14)
        assert rcm_error(-x[j], pivot) == pytest.approx(errors[i, j], abs=1e-15)


def test_rcm_error_is_zero_along_the_whole_shaft(lwa3: Arm) -> None:
    rng = np.random.default_rng(7)
    oMe, inserted = random_placement(rng), Insertion.on_shaft(lwa3, INSTRUMENT)
    for along in (-0.2, 0.0, 0.1):
        pivot = oMe.act(np.array([0.0, 0.0, along]))
        assert rcm_error(dq.from_se3(oMe), pivot) < 1e-15
        assert inserted.depth(dq.from_se3(oMe), pivot) == pytest.approx(0.1 - along)


def test_a_trocar_off_the_shaft_is_refused_and_said_by_how_much(lwa3: Arm) -> None:
    trocar = trocar_at(flange_at_home(lwa3), (0.003, -0.004, 0.3))
    with pytest.raises(TrocarOffShaft, match=r"is 5\.000 mm off .*allowed 0\.001 mm") as caught:
        Insertion(lwa3, INSTRUMENT, trocar, lwa3.home)
    assert caught.value.distance == pytest.approx(0.005, abs=1e-14)
    with pytest.raises(TrocarOffShaft, match=r"allowed 4\.900 mm"):
        Insertion(lwa3, INSTRUMENT, trocar, lwa3.home, tolerance=4.9e-3)


def test_a_tolerated_offset_leaves_x_rcm_at_the_pivot_and_the_effector_beside_it(
    lwa3: Arm,
) -> None:
    oMf = flange_at_home(lwa3)
    trocar = trocar_at(oMf, (0.003, -0.004, 0.3))
    insertion = Insertion(lwa3, INSTRUMENT, trocar, lwa3.home, tolerance=5.1e-3)
    assert insertion.trocar_offset == pytest.approx(0.005, abs=1e-14)
    x_rcm, oMe = dq.to_se3(insertion.x_rcm), insertion.state(insertion.q_start).oMe
    assert_allclose(x_rcm.translation, trocar.pivot, rtol=0, atol=1e-14)
    assert_allclose(x_rcm.rotation, oMf.rotation, rtol=0, atol=1e-14)
    nearest = oMf.act(np.array([0.0, 0.0, 0.3]))  # of the shaft's points to the pivot
    assert_allclose(oMe.translation, nearest, rtol=0, atol=1e-14)
    assert insertion.tip_depth == pytest.approx(0.38 - 0.3, abs=1e-14)


def test_the_trocar_must_lie_between_the_ends_of_the_shaft(lwa3: Arm) -> None:
    assert Insertion.on_shaft(lwa3, INSTRUMENT, depth=0.249).tip_depth == pytest.approx(0.249)
    short = Instrument(length=0.1, mount_offset=0.05)
    with pytest.raises(
        InsertionError, match=r"would be 110\.0 mm inside, the shaft is only 100\.0 mm long"
    ):
        Insertion.on_shaft(lwa3, short, depth=0.11)


@pytest.mark.parametrize(("depth", "allowed"), [(0.04, False), (0.06, True), (0.11, False)])
def test_the_tip_must_start_in_the_depth_range(lwa3: Arm, depth: float, allowed: bool) -> None:
    trocar = dataclasses.replace(
        trocar_at(flange_at_home(lwa3), (0.0, 0.0, INSTRUMENT.tip - depth)),
        depth_range=(0.05, 0.1),
    )
    if allowed:
        assert Insertion(lwa3, INSTRUMENT, trocar, lwa3.home).tip_depth == pytest.approx(depth)
    else:
        message = rf"starts {1e3 * depth:.1f} mm beyond .* range is \[50\.0, 100\.0\] mm"
        with pytest.raises(InsertionError, match=message):
            Insertion(lwa3, INSTRUMENT, trocar, lwa3.home)


def test_the_start_must_be_inside_the_joint_limits(lwa3: Arm) -> None:
    angles = lwa3.home.copy()
    angles[1] = 2.0
    trocar = trocar_at(flange_at_home(lwa3), (0.0, 0.0, 0.3))
    with pytest.raises(JointLimitViolated, match=r"lwa3_joint_2 at 2\.0000 rad"):
        Insertion(lwa3, INSTRUMENT, trocar, angles)
    with pytest.raises(JointLimitViolated, match=r"lwa3_joint_2 at 2\.0000 rad"):
        Insertion.on_shaft(lwa3, INSTRUMENT, angles)
    with pytest.raises(InvalidCommand, match=r"joint angles has shape \(6,\)"):
        Insertion.on_shaft(lwa3, INSTRUMENT, [0.0] * 6)


def test_a_vector_from_the_start_is_turned_as_the_shaft_is(arm: Arm) -> None:
    insertion = Insertion.on_shaft(arm, INSTRUMENT)
    R = flange_at_home(arm).rotation
    for vector in ((1.0, 0.0, 0.0), (0.0, -2.0, 0.0), (0.1, 0.2, 0.3)):
        assert_allclose(insertion.from_start(vector), R @ vector, rtol=0, atol=1e-14)
    assert_allclose(insertion.from_start((0.0, 0.0, 1.0)), insertion.trocar.axis, atol=1e-15)


def test_obstacles_are_kept_as_they_are_given(lwa3: Arm) -> None:
    trocar, sphere = trocar_at(flange_at_home(lwa3), (0.0, 0.0, 0.3)), Sphere((0, 0, 0), 0.1)
    assert Insertion(lwa3, INSTRUMENT, trocar, lwa3.home).obstacles == ()
    found = Insertion(lwa3, INSTRUMENT, trocar, lwa3.home, obstacles=[sphere])
    assert found.obstacles == (sphere,)


def test_a_shaft_outside_the_cone_at_the_start_is_refused(lwa3: Arm) -> None:
    trocar = Insertion.on_shaft(lwa3, INSTRUMENT).trocar
    away = dataclasses.replace(trocar, axis=vector3("axis", -np.array(trocar.axis)))
    with pytest.raises(InsertionError, match=r"starts 180\.0 deg from the trocar's axis"):
        Insertion(lwa3, INSTRUMENT, away, lwa3.home)
