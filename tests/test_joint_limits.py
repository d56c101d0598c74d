"""The joints' box: limits of position, speed, acceleration and jerk, in every cycle to come."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose

from rcmqp import arm_names, load_arm
from rcmqp.errors import OptionError
from rcmqp.limits import Constraint, JointLimits, braking_speed
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.view import STILL, Reference
from rcmqp.world.arm import Arm, ArmState

NOW = Reference(dq.IDENTITY, np.zeros(8), STILL, STILL)


def arm_of(lower: Array, upper: Array, velocity: Array, acceleration: Array, jerk: Array) -> Arm:
    """A chain of joints with these limits."""
    model, parent = pin.Model(), 0
    for i in range(lower.size):
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Identity(), f"joint_{i}")
    model.addFrame(pin.Frame("flange", parent, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = lower, upper
    model.velocityLimit[:] = velocity
    home = np.zeros(lower.size)
    return Arm(model, "flange", name="bench", acceleration=acceleration, jerk=jerk, home=home)


def bench(rng: np.random.Generator, n: int = 60) -> Arm:
    """Limits of all sorts: some joints without limits of position, acceleration or jerk."""
    middle, half = rng.uniform(-2, 2, n), 10.0 ** rng.uniform(-2.0, 0.5, n)
    half[::6] = np.inf
    velocity, acceleration = 10.0 ** rng.uniform(-1.0, 1.0, n), 10.0 ** rng.uniform(-0.5, 2.0, n)
    jerk = acceleration * 10.0 ** rng.uniform(0.0, 3.0, n)
    acceleration[1::6], jerk[1::12], jerk[2::6] = np.inf, np.inf, np.inf
    return arm_of(middle - half, middle + half, velocity, acceleration, jerk)


def every_joint() -> Arm:
    """The joints of all eight arms; where nothing is published, limits of a careful size."""
    rows = []
    for name in arm_names():
        arm = load_arm(name)
        acceleration = np.where(
            np.isfinite(arm.acceleration), arm.acceleration, arm.velocity / 0.5
        )
        jerk = np.where(np.isfinite(arm.jerk), arm.jerk, acceleration / 0.05)
        rows.append([arm.lower, arm.upper, arm.velocity, acceleration, jerk])
    return arm_of(*np.concatenate(rows, axis=1))


def joint_state(angles: Array, v: Array, a: Array | None = None) -> ArmState:
    still = np.zeros_like(v)
    nowhere, J = pin.SE3.Identity(), np.zeros((6, v.size))
    return ArmState(angles, angles, nowhere, dq.IDENTITY, J, v, still if a is None else a, (0.0,))


def inside(arm: Arm) -> tuple[Array, Array, Array]:
    """Angles in the middle of the limits, at rest."""
    return np.where(np.isfinite(arm.upper), arm.middle, 0.0), np.zeros(arm.nv), np.zeros(arm.nv)


def push(rng: np.random.Generator, k: int, box: Constraint) -> Array:
    """A velocity in the box: always up, always down, to and fro, at random, or at its ends."""
    n = box.lower.size
    share = np.empty(n)
    share[0::5], share[1::5] = 1.0, 0.0
    share[2::5] = float((k // 400) % 2)
    share[3::5] = rng.uniform(size=share[3::5].size)
    share[4::5] = rng.integers(0, 2, share[4::5].size)
    v = (1.0 - share) * box.lower + share * box.upper
    return np.clip(v, box.lower, box.upper)


# Stops, cycle by cycle ---------------------------------------------------------------------


def braking_distance(v: float, a: float, period: float) -> float:
    """Cycle by cycle: how far a joint goes that moves at v once more and then brakes."""
    distance = 0.0
    while v > 0.0:
        distance += v * period
        v -= a * period
    return distance


def eased(end: float, v: float, a: float, most: float, jerk: float, T: float) -> tuple[float, ...]:
    """Speed left and way of a stop that lasts ``end`` cycles, each of them counted."""
    way, k = T * v, 0
    while k < end or a > 0.0:
        k += 1
        hold = -most if a >= -most else min(-most, a + k * jerk * T)
        change = max(a - k * jerk * T, hold, min(0.0, (k - end) * jerk * T))
        if change == 0.0:
            break
        v += T * change
        way += T * v
    return v, way


def stopping_distance(v: float, a: float, most: float, jerk: float, T: float) -> float:
    """Way of a joint that goes on at v, its last change a, until it is at rest."""
    low, high = abs(a) / (jerk * T), 2.0 * (abs(a) / (jerk * T) + 1.0)
    while eased(high, v, a, most, jerk, T)[0] > 0.0:
        high *= 2.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        if eased(middle, v, a, most, jerk, T)[0] > 0.0:
            low = middle
        else:
            high = middle
    return eased(high, v, a, most, jerk, T)[1]


@pytest.mark.parametrize("period", [1e-4, 1e-3, 8e-3, 0.1, 1.0])
def test_braking_speed_uses_up_the_distance_to_the_last_bit(period: float) -> None:
    rng = np.random.default_rng(7)
    a = rng.uniform(0.5, 20.0, 40)
    d = 10.0 ** rng.uniform(-12, 0.5, 40)
    d[:8] = a[:8] * period**2 * np.arange(8) * np.arange(1, 9) / 2  # the knees
    v = braking_speed(d, a, period)
    used = [braking_distance(*pair, period) for pair in zip(v, a, strict=True)]
    assert_allclose(used, d, rtol=1e-11, atol=1e-15)
    assert_allclose(braking_speed(-d, a, period), -v, rtol=0, atol=0)


def test_braking_speed_without_limits_and_with_short_cycles() -> None:
    assert_allclose(braking_speed([0.3, -0.3, 0.0], np.inf, 0.1), [3.0, -3.0, 0.0], rtol=1e-15)
    assert np.isposinf(braking_speed([np.inf] * 2, [2.0, np.inf], 0.1)).all()
    assert braking_speed(0.5, 3.0, 1e-7) == pytest.approx(math.sqrt(3.0), rel=1e-6)


@pytest.mark.parametrize("period", [2e-3, 8e-3, 0.05])
@pytest.mark.parametrize("shares", [(0.25, 0.25), (1.0, 1.0)])
def test_the_largest_velocity_stops_on_the_position_limit_to_the_last_bit(
    period: float, shares: tuple[float, float]
) -> None:
    """On either side, from any acceleration; against a stop of which each cycle is counted."""
    rng, n = np.random.default_rng(7), 24
    velocity, acceleration = 10.0 ** rng.uniform(-1.0, 1.0, n), 10.0 ** rng.uniform(-0.5, 2.0, n)
    jerk = acceleration * 10.0 ** rng.uniform(0.3, 2.0, n)
    jerk = np.minimum(jerk, acceleration / (shares[1] * period))
    arm = arm_of(-100.0 * np.ones(n), np.ones(n), velocity, acceleration, jerk)
    turned = arm_of(-np.ones(n), 100.0 * np.ones(n), velocity, acceleration, jerk)
    a = rng.uniform(-0.8, 0.8, n) * acceleration
    change = a + rng.uniform(-0.9, 0.9, n) * period * jerk
    change = np.clip(change, -0.99 * acceleration, 0.99 * acceleration)
    most, e = shares[0] * acceleration, shares[1] * jerk
    least = np.array(
        [
            -eased(abs(c) / (y * period), 0.0, min(c, 0.0), m, y, period)[0]
            for c, m, y in zip(change, most, e, strict=True)
        ]
    )  # it does not turn back
    room = np.where(change > 0.0, change**2 / (2 * e) + period * change, 0.0)
    v = least + rng.uniform(0.0, 1.0, n) * np.maximum(0.0, 0.99 * velocity - room - least)
    way = [stopping_distance(*numbers, period) for numbers in zip(v, change, most, e, strict=True)]
    before = v - period * change
    held = (v + room < velocity) & (np.abs(before) < velocity)
    box = JointLimits(arm, period, braking=shares[0], easing=shares[1]).evaluate(
        joint_state(1.0 - np.array(way), before, a), NOW
    )
    other = JointLimits(turned, period, braking=shares[0], easing=shares[1]).evaluate(
        joint_state(np.array(way) - 1.0, -before, -a), NOW
    )
    assert held.sum() >= 10
    assert_allclose(box.upper[held], v[held], rtol=0, atol=1e-9)
    assert np.array_equal(other.lower, -box.upper)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_that_turns_back_before_its_acceleration_is_zero_turns_before_the_limit(
    side: float,
) -> None:
    """Braking so hard that it will go backwards: where it turns is inside, to the last bit."""
    rng, n, T = np.random.default_rng(7), 60, 1e-3
    ones = np.ones(n)
    acceleration, jerk = rng.uniform(5.0, 20.0, n), rng.uniform(500.0, 3000.0, n)
    arm = arm_of(-10.0 * ones, 10.0 * ones, 2.0 * ones, acceleration, jerk)
    limit = JointLimits(arm, T)
    e = limit.easing * jerk
    change = -rng.uniform(0.2, 0.9, n) * acceleration
    v = rng.uniform(0.02, 0.6, n) * change**2 / (2.0 * e)  # the rest of it goes backwards
    turning = np.zeros(n)
    for i in range(n):
        speed, a = v[i], change[i]
        while speed > 0.0:
            turning[i] += T * speed
            a = min(0.0, a + e[i] * T)
            speed += T * a
    before = v - T * change
    a = change - rng.uniform(-0.4, 0.4, n) * T * jerk
    box = limit.evaluate(joint_state(side * (10.0 - turning), side * before, side * a), NOW)
    fastest = box.upper if side > 0.0 else -box.lower
    free = (np.abs(change - a) < 0.9 * T * jerk) & (a > -acceleration)
    assert free.sum() > 30
    assert_allclose(fastest[free], v[free], rtol=0, atol=1e-12)


# In every cycle to come --------------------------------------------------------------------


class Worst:
    """How far limits are exceeded, and how many joints met theirs."""

    def __init__(self, arm: Arm) -> None:
        self.arm, self.over = (
            arm,
            dict.fromkeys(("position", "speed", "acceleration", "jerk"), 0.0),
        )
        self.room, self.speed, self.change = (
            np.full(arm.nv, np.inf),
            np.zeros(arm.nv),
            np.zeros(arm.nv),
        )

    def add(self, q: Array, v: Array, a: Array, a_before: Array, period: float) -> None:
        arm = self.arm
        room = np.minimum(q - arm.lower, arm.upper - q)
        excess = {
            "position": -room,
            "speed": np.abs(v) - arm.velocity,
            "acceleration": period * (np.abs(a) - arm.acceleration),
            "jerk": period * (np.abs(a - a_before) - period * arm.jerk),
        }
        for name, values in excess.items():
            self.over[name] = max(self.over[name], float(values.max()))
        self.room = np.minimum(self.room, room)
        self.speed = np.maximum(self.speed, np.abs(v) / arm.velocity)
        self.change = np.maximum(self.change, np.abs(a) / arm.acceleration)


def driven(limit: JointLimits, rng: np.random.Generator, cycles: int) -> Worst:
    arm, T = limit.arm, limit.period
    (q, v, a), worst = inside(arm), Worst(arm)
    for k in range(cycles):
        box = limit.evaluate(joint_state(q, v, a), NOW)
        assert (box.lower <= box.upper).all()
        v_next = push(rng, k, box)
        a_before, a = a, (v_next - v) / T
        v, q = v_next, q + T * v_next
        worst.add(q, v, a, a_before, T)
    return worst


@pytest.mark.parametrize("shares", [(0.25, 0.25), (1.0, 1.0), (1.0, 0.1)])
@pytest.mark.parametrize("period", [1e-4, 1e-3, 8e-3, 0.1, 1.0])
def test_whatever_is_commanded_in_the_box_no_joint_limit_is_ever_broken(
    period: float, shares: tuple[float, float]
) -> None:
    rng = np.random.default_rng(7)
    arm = bench(rng)
    worst = driven(JointLimits(arm, period, braking=shares[0], easing=shares[1]), rng, 1500)
    assert max(worst.over.values()) < 1e-11
    if period == 0.1:  # the limits were met, not kept at a distance
        assert np.count_nonzero(worst.room < 1e-9) >= 25
        assert np.count_nonzero(worst.speed > 0.999) >= 20
        assert np.count_nonzero(worst.change > 0.999) >= 15


@pytest.mark.parametrize("period", [1e-3, 2e-3, 8e-3])
def test_no_joint_of_any_arm_is_ever_led_over_a_limit(period: float) -> None:
    arm = every_joint()
    worst = driven(JointLimits(arm, period), np.random.default_rng(7), 4000)
    assert max(worst.over.values()) < 1e-11
    assert np.count_nonzero(worst.speed > 0.999) >= 20
    if period == 8e-3:
        assert np.count_nonzero(worst.room < 1e-9) >= 20


def test_a_margin_is_kept_from_the_position_limits() -> None:
    rng = np.random.default_rng(7)
    arm = every_joint()
    worst = driven(JointLimits(arm, 8e-3, margin=0.05), rng, 2000)
    assert worst.room.min() == pytest.approx(0.05, abs=1e-9)


# Continuity --------------------------------------------------------------------------------


@pytest.mark.parametrize("period", [1e-3, 8e-3, 0.1])
def test_the_box_changes_no_faster_than_the_state(period: float) -> None:
    """Along straight lines: by |dq| / T + |dv| + T |da| at most, inside and beyond the limits."""
    rng = np.random.default_rng(7)
    arm = bench(rng)
    limit = JointLimits(arm, period)
    middle, reach = inside(arm)[0], np.where(np.isfinite(arm.upper), arm.upper - arm.lower, 2.0)
    A = np.where(np.isfinite(arm.acceleration), arm.acceleration, 10.0)
    A, ends = np.minimum(A, arm.velocity / period), []
    for _ in range(2):
        near = middle + rng.choice([-0.5, 0.5], arm.nv) * reach * rng.uniform(0.8, 1.1, arm.nv)
        v, a = (rng.uniform(-1.3, 1.3, arm.nv) * most for most in (arm.velocity, A))
        ends.append(np.array([near, v, a]))
    steps, before, sizes = 3000, None, np.zeros(arm.nv)
    step = np.abs(ends[1] - ends[0]) / steps
    allowed = step[0] / period + step[1] + period * step[2]
    for share in np.linspace(0.0, 1.0, steps + 1):
        box = limit.evaluate(joint_state(*((1.0 - share) * ends[0] + share * ends[1])), NOW)
        bounds = np.array([box.lower, box.upper])
        if before is not None:
            sizes = np.maximum(sizes, np.abs(bounds - before).max(axis=0) / allowed)
        before = bounds
    assert sizes.max() < 1.0 + 1e-6
    assert np.quantile(sizes, 0.8) > 0.05


# Beyond the limits -------------------------------------------------------------------------


@pytest.mark.parametrize("period", [1e-3, 1e-2, 0.1])
def test_a_joint_beyond_its_limits_or_too_fast_comes_back(period: float) -> None:
    rng = np.random.default_rng(7)
    arm = bench(rng)
    limit = JointLimits(arm, period)
    finite = np.isfinite(arm.upper)
    half = np.where(finite, arm.upper - arm.lower, 2.0) / 2
    beyond = rng.choice([-1.0, 1.0], arm.nv) * (half + rng.uniform(0.0, 0.5, arm.nv))
    q = inside(arm)[0] + beyond
    v, a = rng.uniform(-2.0, 2.0, arm.nv) * arm.velocity, np.zeros(arm.nv)
    outside_for, fast_for = np.zeros(arm.nv), np.zeros(arm.nv)
    for k in range(min(4000, int(60.0 / period))):
        box = limit.evaluate(joint_state(q, v, a), NOW)
        assert np.isfinite(box.lower).all()
        assert (box.lower <= box.upper).all()
        v_next = push(rng, k, box)
        a_before, a = a, (v_next - v) / period
        assert (np.abs(a) <= arm.acceleration * (1 + 1e-9)).all()
        assert (period * np.abs(a - a_before) <= period**2 * arm.jerk + 1e-11).all()
        v, q = v_next, q + period * v_next
        outside_for += period * (np.minimum(q - arm.lower, arm.upper - q) < -1e-12)
        fast_for += period * (np.abs(v) > arm.velocity)
    # braking from twice the top speed, going back, cruising, stopping, all with some cycles more
    easing = limit.easing * arm.jerk
    easing = np.where(np.isfinite(easing), easing, 1e9)
    ramp = np.minimum(arm.acceleration, np.sqrt(2 * arm.velocity * easing)) / easing
    to_stop = 2 * arm.velocity / arm.acceleration + ramp + 2 * period
    overshot = 0.5 + 2 * arm.velocity * to_stop
    back = np.sqrt(overshot / (limit.braking * arm.acceleration)) + ramp
    allowed = 3 * to_stop + 2 * back + overshot / arm.velocity
    in_time = period * (k + 1) > allowed
    assert in_time.sum() >= 15
    assert (fast_for <= to_stop)[in_time].all()
    assert (outside_for <= allowed)[in_time].all()
    assert (np.minimum(q - arm.lower, arm.upper - q)[in_time] >= -1e-12).all()


def test_the_precedence_is_acceleration_then_jerk_then_speed_then_position() -> None:
    arm, T = load_arm("panda").with_effector(pin.SE3.Identity()), 1e-3
    arm.jerk = np.full(arm.nv, 5000.0)
    q, V, A, j = arm.home, arm.velocity, arm.acceleration, arm.jerk
    limit = JointLimits(arm, T)
    harder = limit.evaluate(joint_state(q, 0.5 * V, -1.5 * A), NOW)  # than it may
    assert_allclose(harder.lower, 0.5 * V - T * A, rtol=0, atol=1e-15)
    assert_allclose(harder.upper, 0.5 * V - T * A + T**2 * j, rtol=0, atol=1e-15)
    fast = limit.evaluate(joint_state(q, 1.5 * V), NOW)
    assert_allclose(fast.upper, 1.5 * V - T**2 * j, rtol=0, atol=1e-15)
    late = limit.evaluate(joint_state(arm.upper - 1e-4, V, -T * j), NOW)
    assert_allclose(late.upper, V - T * np.minimum(2 * T * j, A), rtol=0, atol=1e-15)
    assert_allclose(late.lower, late.upper, rtol=0, atol=0)
    arm.jerk = np.full(arm.nv, np.inf)
    without = JointLimits(arm, T).evaluate(joint_state(arm.upper - 1e-4, V), NOW)
    assert_allclose(without.upper, V - T * A, rtol=0, atol=1e-15)
    free = JointLimits(arm, T, acceleration=False)
    assert_allclose(free.evaluate(joint_state(arm.upper - 1e-4, q), NOW).upper, 0.1, rtol=1e-10)


def test_a_jerk_limit_that_never_binds_is_none() -> None:
    rng = np.random.default_rng(7)
    arm, T = bench(rng), 8e-3
    arm.jerk = np.full(arm.nv, np.inf)
    other = bench(np.random.default_rng(7))
    limit = JointLimits(arm, T)
    A = np.where(np.isfinite(arm.acceleration), arm.acceleration, 1e3)
    other.jerk = 2.0 * A / (T * limit.easing)
    reach = np.where(np.isfinite(arm.upper), arm.upper - arm.lower, 1.0)
    for _ in range(50):
        q = inside(arm)[0] + rng.uniform(-0.55, 0.55, arm.nv) * reach
        v, a = (rng.uniform(-1.0, 1.0, arm.nv) * most for most in (arm.velocity, A))
        state = joint_state(q, v, a)
        box, same = limit.evaluate(state, NOW), JointLimits(other, T).evaluate(state, NOW)
        known = np.isfinite(arm.acceleration)
        assert np.array_equal(box.lower[known], same.lower[known])
        assert np.array_equal(box.upper[known], same.upper[known])
        low, up = np.maximum(-arm.velocity, v - T * A), np.minimum(arm.velocity, v + T * A)
        ahead = braking_speed(arm.upper - q, limit.braking * A, T)
        assert_allclose(box.upper[known], np.clip(ahead, low, up)[known], rtol=1e-15)


ABSURD = (0.0, 1e6, -1e6, 1e200, -1e308, 1.7e308)


@pytest.mark.parametrize("period", [1e-3, 1.0])
def test_absurd_but_finite_numbers_leave_a_finite_box_inside_the_speed_limits(
    period: float,
) -> None:
    arm = bench(np.random.default_rng(7))
    limit, q = JointLimits(arm, period), inside(arm)[0]
    for angle in ABSURD:
        for v in ABSURD:
            for a in ABSURD:
                state = joint_state(q + angle, np.full(arm.nv, v), np.full(arm.nv, a))
                box = limit.evaluate(state, NOW)
                assert (box.lower <= box.upper).all()
                assert (np.abs([box.lower, box.upper]) <= arm.velocity * (1 + 1e-12)).all()
    known = np.minimum(arm.acceleration, 1.0)
    fast = limit.evaluate(joint_state(q, np.full(arm.nv, 1e300), known), NOW)
    assert (fast.upper <= arm.velocity).all()
    unknown = limit.evaluate(joint_state(np.full(arm.nv, np.nan), 0.1 * arm.velocity), NOW)
    far = limit.evaluate(joint_state(q, 0.1 * arm.velocity), NOW)
    free = np.isinf(arm.upper)
    assert np.array_equal(unknown.upper[free], far.upper[free])
    assert np.isfinite(unknown.lower).all()


# Speed limits near the position limits -----------------------------------------------------


@dataclasses.dataclass(frozen=True)
class NearLimits:
    """As published for Franka's FR3: below sqrt(2 k d) - o at the distance d."""

    offset: tuple[float, ...]
    deceleration: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def bounds(self, q: Array) -> tuple[Array, Array]:
        o, k = np.array(self.offset), np.array(self.deceleration)
        up, down = (
            np.maximum(0.0, np.sqrt(2 * k * np.maximum(0.0, room)) - o)
            for room in (np.array(self.upper) - q, q - np.array(self.lower))
        )
        return -down, up


@pytest.mark.parametrize("shares", [(0.25, 0.25), (1.0, 1.0)])
@pytest.mark.parametrize("period", [1e-3, 8e-3])
def test_speed_limits_near_the_position_limits_hold_in_every_cycle(
    period: float, shares: tuple[float, float]
) -> None:
    n = 50
    rng, ones = np.random.default_rng(7), np.ones(n)
    lower, upper = -rng.uniform(0.5, 3.0, n), rng.uniform(0.5, 3.0, n)
    velocity, acceleration = rng.uniform(1.0, 5.3, n), rng.uniform(5.0, 20.0, n)
    arm = arm_of(lower, upper, velocity, acceleration, 5000.0 * ones)
    offset, k = rng.uniform(0.0, 0.35, n), rng.uniform(2.0, 17.0, n)
    near = NearLimits(tuple(offset), tuple(k), tuple(lower - 0.006), tuple(upper + 0.006))
    object.__setattr__(arm, "speed_near_limits", near)
    limit = JointLimits(arm, period, braking=shares[0], easing=shares[1])
    (q, v, a), closest = inside(arm), np.full(n, np.inf)
    for i in range(6000):
        box = limit.evaluate(joint_state(q, v, a), NOW)
        assert (box.lower <= box.upper).all()
        v_next = push(rng, i, box)
        v, a, q = v_next, (v_next - v) / period, q + period * v_next
        slowest, fastest = near.bounds(q)
        assert (v <= fastest + 1e-9).all()
        assert (v >= slowest - 1e-9).all()
        closest = np.minimum(closest, np.where(v >= 0, fastest - v, v - slowest))
    assert np.quantile(closest, 0.2) < 0.05  # not kept far off either


# What is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ({}, {"period": 0.0}, r"period = 0.0 s, it must be positive"),
        ({}, {"braking": 0.0}, r"braking = 0.0, it must be above 0 and at most 1"),
        ({}, {"easing": 1.5}, r"easing = 1.5, it must be above 0 and at most 1"),
        ({}, {"margin": -0.1}, r"margin = -0.1, it must be finite and 0 or more"),
        ({}, {"margin": 5.0}, r"panda_joint1 has position limits .*margin of 5 rad leaves empty"),
        ({"lower": 3.0, "upper": -3.0}, {}, r"panda_joint1 .* \[3, -3\] rad, which a margin of 0"),
        ({"velocity": 0.0}, {}, r"panda_joint1 has velocity limit 0; it must be positive"),
        ({"acceleration": np.nan}, {}, r"panda_joint1 has acceleration limit nan; it must be"),
        ({"jerk": -1.0}, {}, r"panda_joint1 has jerk limit -1; it must be positive, inf for none"),
    ],
)
def test_joint_limits_that_cannot_be_are_refused(
    change: dict[str, float], options: dict[str, Any], message: str
) -> None:
    arm = load_arm("panda").with_effector(pin.SE3.Identity())
    for name, value in change.items():
        setattr(arm, name, np.full(arm.nv, value))
    with pytest.raises(OptionError, match=message):
        JointLimits(arm, **({"period": 1e-3} | options))
