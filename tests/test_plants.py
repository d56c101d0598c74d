"""What a commanded velocity drives: each effect by itself, against its definition."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose
from scipy.integrate import solve_ivp

from rcmqp import Arm, load_arm
from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.plants import PLANTS, Drive, Kinematic, Plant, Servo, first_order

T = 1e-3
SAMPLES: list[Plant] = [
    Kinematic(),
    Servo(),
    Servo(0.01, 2, 2**16, 1e-4, 0.005, velocity_saturation=True, acceleration_saturation=True),
]
every_plant = pytest.mark.parametrize("plant", SAMPLES, ids=str)


def started(plant: Plant, arm: Arm, seed: int = 0) -> Drive:
    return plant.start(arm, arm.configuration(arm.home), T, seed)


def history(plant: Plant, arm: Arm, commands: Array, seed: int = 0) -> dict[str, Array]:
    """Positions and velocities (n + 1, ...), true and measured, before each command and after."""
    drive, rows = started(plant, arm, seed), []
    for u in (*commands, np.zeros(arm.nv)):
        rows.append((drive.q, drive.v, *drive.measure()))
        drive.step(u)
    names = ("q", "v", "q_measured", "v_measured")
    return dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))


def wander(arm: Arm, cycles: int = 300) -> Array:
    """Smooth commands (n, nv) of the order of the speed limits."""
    t = T * np.arange(cycles)[:, None]
    phases = np.arange(arm.nv)
    return np.asarray(0.5 * arm.velocity * np.sin(20.0 * t + phases))


# Every plant -------------------------------------------------------------------------------


def test_every_plant_is_tested_here() -> None:
    assert {type(plant) for plant in SAMPLES} == set(PLANTS.values())


@every_plant
def test_a_drive_is_finite_and_does_the_same_again_to_the_bit(arm: Arm, plant: Plant) -> None:
    assert isinstance(plant, Plant)
    first, again = (history(plant, arm, wander(arm)) for _ in range(2))
    for name, values in first.items():
        assert np.isfinite(values).all()
        assert np.array_equal(values, again[name])
    assert first["q"].shape == first["q_measured"].shape == (301, arm.nq)
    assert first["v"].shape == first["v_measured"].shape == (301, arm.nv)


@every_plant
def test_a_drive_starts_at_rest_and_keeps_nothing_of_what_it_is_given(
    lwa3: Arm, plant: Plant
) -> None:
    drive = started(plant, lwa3)
    assert np.array_equal(drive.q, lwa3.home)
    assert not drive.v.any()
    assert not drive.measure()[1].any()
    u = np.full(7, 0.1)
    drive.step(u)
    twin = started(plant, lwa3)
    twin.measure()
    twin.step(u.copy())
    u[:] = np.nan
    for each in (drive, twin):
        for _ in range(3):  # longer than any delay here
            each.measure()
            each.step(np.zeros(7))
    assert np.array_equal(drive.q, twin.q)
    assert np.array_equal(drive.v, twin.v)


# The ideal one -----------------------------------------------------------------------------


def test_kinematic_joints_do_at_once_what_they_are_told(arm: Arm) -> None:
    commands = wander(arm, 50)
    found = history(Kinematic(), arm, commands)
    q = arm.configuration(arm.home)
    for k, u in enumerate(commands):
        assert np.array_equal(found["q"][k], q)
        q = pin.integrate(arm.model, q, T * u)
        assert np.array_equal(found["v"][k + 1], u)
    assert np.array_equal(found["q_measured"], found["q"])
    assert np.array_equal(found["v_measured"], found["v"])


def test_a_servo_without_any_option_is_ideal_but_for_how_it_measures_velocity(arm: Arm) -> None:
    commands = wander(arm, 100)
    ideal, found = history(Kinematic(), arm, commands), history(Servo(), arm, commands)
    assert_allclose(found["q"], ideal["q"], rtol=0, atol=1e-14)
    assert np.array_equal(found["v"], ideal["v"])
    assert np.array_equal(found["q_measured"], found["q"])
    assert_allclose(found["v_measured"], ideal["v"], rtol=0, atol=1e-11)  # over one period


# Lag ---------------------------------------------------------------------------------------


def test_a_lag_reaches_63_percent_after_its_time_constant(lwa3: Arm) -> None:
    tau, u = 0.02, 0.3
    found = history(Servo(time_constant=tau), lwa3, np.full((200, 7), u))
    t = T * np.arange(201)
    assert_allclose(found["v"][:, 0], u * (1 - np.exp(-t / tau)), rtol=0, atol=1e-14)
    assert_allclose(found["v"][20], u * (1 - 1 / math.e), rtol=1e-12)
    way = u * (t - tau * (1 - np.exp(-t / tau)))
    assert_allclose(found["q"] - lwa3.home, np.outer(way, np.ones(7)), rtol=0, atol=1e-14)


@pytest.mark.parametrize("acceleration", [math.inf, 15.0, 2.0])
@pytest.mark.parametrize("tau", [0.0, 0.004, 0.03])
def test_a_servo_solves_its_differential_equation(tau: float, acceleration: float) -> None:
    """Against scipy's integrator; from and to velocities both ways, and nowhere to go."""
    v, u = np.array([0.0, 0.2, -0.3, 0.1, 0.1]), np.array([0.4, -0.1, 0.0, 0.1, 0.1001])
    period = 0.01
    moved, after = first_order(v, u, tau, np.full(5, acceleration), period)

    def rates(_: float, state: Array) -> Array:
        gap = u - state[5:]
        wanted = gap / max(tau, 1e-5)
        return np.concatenate([state[5:], np.clip(wanted, -acceleration, acceleration)])

    done = solve_ivp(
        rates, (0.0, period), [*np.zeros(5), *v], method="LSODA", rtol=1e-10, atol=1e-13
    )
    slack = 1e-8 if tau else 5e-6  # tau = 1e-5 stands in for zero
    assert_allclose(moved, done.y[:5, -1], rtol=0, atol=slack)
    assert_allclose(after, done.y[5:, -1], rtol=0, atol=slack)


# Delay -------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [1, 2, 5])
def test_a_delay_is_in_whole_periods(arm: Arm, delay: int) -> None:
    commands = wander(arm, 60)
    found = history(Servo(delay=delay), arm, commands)
    assert not found["v"][: delay + 1].any()
    assert np.array_equal(found["v"][delay + 1 :], commands[: 60 - delay])
    assert np.array_equal(found["q"][delay], found["q"][0])


# Saturation --------------------------------------------------------------------------------


def test_speed_is_cut_at_the_arms_limits_if_so_asked(arm: Arm) -> None:
    commands = 4.0 * wander(arm)
    assert (np.abs(commands) > 1.5 * arm.velocity).any()
    free = history(Servo(), arm, commands)
    found = history(Servo(velocity_saturation=True), arm, commands)
    assert np.array_equal(free["v"][1:], commands)
    assert np.array_equal(found["v"][1:], np.clip(commands, -arm.velocity, arm.velocity))


def test_acceleration_is_cut_at_the_arms_limits_if_so_asked() -> None:
    arm = load_arm("panda")
    commands = np.tile(arm.velocity, (300, 1))
    found = history(Servo(acceleration_saturation=True), arm, commands)
    t = T * np.arange(301)[:, None]
    expected = np.minimum(arm.acceleration * t, arm.velocity)
    assert_allclose(found["v"], expected, rtol=0, atol=1e-12)
    free = history(Servo(), arm, commands)
    assert np.array_equal(free["v"][1], arm.velocity)


# Encoders ----------------------------------------------------------------------------------


def test_a_reading_is_the_nearest_count(arm: Arm) -> None:
    counts = 5000
    plant = Servo(counts_per_turn=counts)
    found = history(plant, arm, wander(arm))
    true, read = (np.array([arm.angles(q) for q in found[n]]) for n in ("q", "q_measured"))
    count = 2 * math.pi / counts
    error = np.angle(np.exp(1j * (read - true)))  # joints without limits go round
    assert np.abs(error).max() <= count / 2 + 1e-12
    assert np.abs(error).max() > 0.45 * count
    whole = read / count
    assert_allclose(whole, np.round(whole), rtol=0, atol=1e-9)


def test_noise_has_its_rms_is_independent_and_leaves_the_joints_alone(arm: Arm) -> None:
    rms = 1e-4
    found = history(Servo(noise=rms), arm, np.zeros((2000, arm.nv)))
    assert (found["q"] == found["q"][0]).all()
    home = arm.angles(found["q"][0])
    error = np.array([arm.angles(q) for q in found["q_measured"]]) - home
    error = np.angle(np.exp(1j * error))
    assert_allclose(error.std(axis=0), rms, rtol=0.08)
    assert np.abs(error.mean(axis=0)).max() < 4 * rms / math.sqrt(2000)
    correlation = np.corrcoef(np.hstack([error[1:], error[:-1]]).T)
    assert np.abs(correlation - np.eye(2 * arm.nv)).max() < 0.12


def test_noise_is_that_of_the_seed(lwa3: Arm) -> None:
    plant = Servo(noise=1e-4)
    runs = [history(plant, lwa3, wander(lwa3), seed)["q_measured"] for seed in (3, 3, 4)]
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_a_measured_velocity_is_the_difference_of_two_readings(arm: Arm) -> None:
    found = history(Servo(0.01, counts_per_turn=2**14, noise=1e-5), arm, wander(arm))
    for k in range(1, 301):
        way = pin.difference(arm.model, found["q_measured"][k - 1], found["q_measured"][k])
        assert_allclose(found["v_measured"][k], way / T, rtol=0, atol=1e-12)


def test_a_joint_without_limits_is_measured_as_it_goes_round() -> None:
    arm = load_arm("kinova")
    (joint,) = np.flatnonzero(np.isinf(arm.upper))[-1:]
    angles = arm.home.copy()
    angles[joint] = math.pi - 0.01
    drive = Servo(counts_per_turn=2**16).start(arm, arm.configuration(angles), T, 0)
    measured = []
    for _ in range(50):
        measured.append(drive.measure()[1][joint])
        drive.step(np.where(np.arange(arm.nv) == joint, 0.5, 0.0))
    assert abs(arm.angles(drive.q)[joint]) > 3.0
    assert arm.angles(drive.q)[joint] < 0.0
    assert_allclose(measured[1:], 0.5, rtol=0, atol=2 * math.pi / 2**16 / T)


def test_the_filter_on_the_measured_velocity_is_of_first_order(lwa3: Arm) -> None:
    tau, u = 0.01, 0.2
    found = history(Servo(velocity_filter=tau), lwa3, np.full((100, 7), u))
    t = T * np.arange(101)
    assert_allclose(found["v_measured"][:, 3], u * (1 - np.exp(-t / tau)), rtol=0, atol=1e-11)
    assert np.array_equal(found["v"][1:], np.full((100, 7), u))


# Refusals ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"time_constant": -1e-3}, "time_constant = -0.001 s"),
        ({"time_constant": math.nan}, "time_constant = nan s"),
        ({"noise": -1.0}, "noise = -1.0 rad"),
        ({"noise": math.inf}, "noise = inf rad"),
        ({"velocity_filter": math.nan}, "velocity_filter = nan s"),
        ({"delay": -1}, "delay = -1, it must be a whole number of at least 0"),
        ({"delay": 1.5}, "delay = 1.5"),
        ({"delay": math.nan}, "delay = nan"),
        ({"counts_per_turn": 0}, "counts_per_turn = 0, it must be a whole number of at least 1"),
        ({"counts_per_turn": math.inf}, "counts_per_turn = inf"),
    ],
)
def test_a_servo_that_makes_no_sense_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Servo(**options)


def test_whole_numbers_may_come_as_floats() -> None:
    servo = Servo(delay=2.0, counts_per_turn=4096.0)  # type: ignore[arg-type]
    assert (servo.delay, servo.counts_per_turn) == (2, 4096)
    assert type(servo.delay) is type(servo.counts_per_turn) is int
    assert dataclasses.replace(servo) == servo
