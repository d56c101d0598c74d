"""How the hands of simulated operators move."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from at_the_device import QUICK, done_at, steering
from helpers import assert_allclose

from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.hand import HandMapping
from rcmqp.references.operators import CameraTrial, Omega7, Operator, draw_operator
from rcmqp.references.operators.camera_task import CameraTask
from rcmqp.references.operators.hand import Hand, Submovement, Tremor, duration


def test_submovements_are_bells() -> None:
    """Minimum jerk: symmetrical, one peak of 1.875 times the mean (Flash and Hogan 1985)."""
    move = Submovement((1.0, 0.0, 0.0), (0.0, 0.03, 0.04), 2.0, 0.8)
    t = np.linspace(2.0, 2.8, 2001)
    along = np.array([move.position(s)[1] / 0.03 for s in t])
    speed = np.gradient(along, t) * 0.8
    assert speed.max() == pytest.approx(1.875, rel=1e-4)
    assert_allclose(speed, speed[::-1], rtol=0, atol=1e-6)
    assert (np.diff(speed[:1001]) >= -1e-9).all()
    assert move.position(0.0) == (1.0, 0.0, 0.0)
    assert_allclose(move.position(9.0), [1.0, 0.03, 0.04], rtol=0, atol=1e-15)


def test_the_hand_moves_in_a_bell_too() -> None:
    """One peak, at 1.4 to 2.2 times the mean: an arm smooths, a device drags."""
    operator = dataclasses.replace(QUICK, tremor=0.0)
    hand = Hand(operator, Omega7(), 1e-3, np.random.default_rng(7))
    move = Submovement((0.0, 0.0, 0.0), (0.04, 0.0, 0.0), 0.0, 0.9)
    x = np.array([hand.step(move.position(1e-3 * k))[0] for k in range(1500)])
    speed = np.diff(x) / 1e-3
    peak = int(np.argmax(speed))
    assert (np.diff(speed[:peak]) >= -1e-9).all()
    moving = speed > 0.05 * speed.max()
    assert 1.4 < speed.max() / speed[moving].mean() < 2.2
    assert x[-1] == pytest.approx(0.04, abs=1e-4)


@pytest.mark.parametrize("viscosity", [0.0, 15.0, 40.0])
def test_the_hand_obeys_its_equation_of_motion(viscosity: float) -> None:
    """The step response of m h'' = K (u - h) - (D + B) h', by its eigenvalues."""
    operator = dataclasses.replace(QUICK, tremor=0.0)
    hand = Hand(operator, Omega7(viscosity=viscosity), 5e-3, np.random.default_rng(7))
    m, K, D = operator.mass, operator.stiffness, operator.damping + viscosity
    first, second = (complex(root) for root in np.roots([m, D, K]))
    for k in range(1, 100):
        t = 5e-3 * k
        decay = (first * np.exp(second * t) - second * np.exp(first * t)) / (first - second)
        assert hand.step((0.01, 0.0, 0.0))[0] == pytest.approx(0.01 * (1.0 - decay.real))


def shaking(viscosity: float, period: float = 4e-3) -> tuple[Operator, Array]:
    """A hand (n, 3) that is held still for two minutes [m]."""
    operator = dataclasses.replace(Operator(), tremor_frequency=9.0)
    device = Omega7(viscosity=viscosity)
    hand = Hand(operator, device, period, np.random.default_rng(7))
    return operator, np.array([hand.step((0.0, 0.0, 0.0)) for _ in range(30000)])


def test_a_free_hand_shakes_in_the_band_of_8_to_12_hz_with_its_rms() -> None:
    """Sources: 8.1 Hz on average (Muerbe), peak in 6-12 Hz (PMC3989364), 49 um (Riviere)."""
    operator, h = shaking(0.0)
    power = np.mean(np.abs(np.fft.rfft(h, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(len(h), 4e-3)
    smooth = np.convolve(power, np.ones(41) / 41.0, "same")
    assert 8.0 <= frequency[np.argmax(smooth)] <= 10.0
    inside = (frequency > 6.0) & (frequency < 12.0)
    assert power[inside].sum() > 0.8 * power.sum()
    assert np.std(h) == pytest.approx(operator.tremor, rel=0.1)


def test_a_viscous_device_damps_the_tremor() -> None:
    """What the paper added viscosity for; by the equation's gains at 9 Hz."""
    free, held = (np.std(shaking(viscosity)[1]) for viscosity in (0.0, 15.0))
    operator, w = Operator(), 2.0 * math.pi * 9.0
    gains = [
        1.0 / abs(complex(operator.stiffness - operator.mass * w**2, (operator.damping + B) * w))
        for B in (0.0, 15.0)
    ]
    assert held / free == pytest.approx(gains[1] / gains[0], rel=0.05)
    assert held < 0.8 * free


def test_tremor_is_the_persons_and_not_the_periods() -> None:
    """The same shaking, looked at more or less often; each axis shakes by itself."""
    made = {T: Tremor(9.0, 0.06, T, np.random.default_rng(7)) for T in (1e-3, 8e-3)}
    often, rarely = (np.array([made[T].step() for _ in range(round(60.0 / T))]) for T in made)
    assert_allclose(often[7::8], rarely, rtol=0, atol=0)
    assert np.std(often) == pytest.approx(1.0, rel=0.1)
    assert np.abs(np.corrcoef(often.T) - np.eye(3)).max() < 0.2


def test_a_hand_at_the_edge_of_the_workspace_can_turn_back_at_once() -> None:
    operator, device = dataclasses.replace(QUICK, tremor=0.0), Omega7(radius=0.03)
    hand = Hand(operator, device, 1e-3, np.random.default_rng(7))
    for _ in range(500):
        hand.step((0.1, 0.05, 0.0))
    assert math.hypot(*hand.position) == pytest.approx(0.03)
    outwards = np.dot(hand.position, hand.velocity)
    assert outwards == pytest.approx(0.0, abs=1e-12)
    hand.step((-0.1, -0.05, 0.0))
    assert math.hypot(*hand.position) < 0.03


def test_objectives_out_of_the_devices_reach_are_refused() -> None:
    trial = CameraTrial(mapping=HandMapping(0.5))
    with pytest.raises(OptionError, match=r"objective 1 is 115 mm of the hand .* reaches 75 mm"):
        steering(trial)


def test_a_period_too_long_for_the_tremor_is_refused() -> None:
    with pytest.raises(OptionError, match=r"cannot show a tremor of 10.0 Hz.*shorter than 0.05"):
        Hand(Operator(), Omega7(), 0.06, np.random.default_rng(7))


def test_far_and_small_targets_take_longer_as_fitts_has_it() -> None:
    """Legs of 2 and 5 cm into 1 mm; throughput 1-2 bit/s, as on flat displays.

    Not past the obstacle, which is made small. A novice's throughput is lower, and in depth,
    which a flat image hardly shows, may fall a little below what is found on flat displays.
    """
    throughput = {}
    for group, person in (("experienced", QUICK), ("novice", draw_operator("novice", 1))):
        operator = dataclasses.replace(person, recognition=0.0, margin=0.0)
        bits, times = [], []
        for side in (0.02, 0.05):
            trial = CameraTrial(operator, CameraTask(side=side, obstacle_radius=1e-3))
            legs = [np.diff(done_at(trial, seed))[[0, 2]] for seed in range(5)]
            bits.append(math.log2(2.0 * side / 2e-3))
            times.append(float(np.mean(legs)))
        assert times[0] < times[1]
        throughput[group] = float(np.mean(np.divide(bits, times)))
    assert 1.0 <= throughput["experienced"] <= 2.2
    assert 0.8 <= throughput["novice"] < throughput["experienced"]


def test_a_submovement_lasts_as_fitts_says_unless_it_would_be_too_fast_or_too_short() -> None:
    operator = Operator()
    assert duration(operator, 1e-5) == operator.shortest
    assert duration(operator, 7e-3) == pytest.approx(0.18 + 0.09 * 3.0)
    assert duration(operator, 0.05) == pytest.approx(1.875 * 0.05 / operator.speed)
