"""The live hand: right is right in the picture, nothing jumps, and who lets go stops the arm."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
from helpers import assert_allclose

import rcmqp
from rcmqp.errors import OptionError
from rcmqp.live.messages import Hand
from rcmqp.live.page_hand import PageHand
from rcmqp.live.steering import LEASH, Held, Steering
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.latency import RECENT, Pace
from rcmqp.references.hand import ACCELERATIONS, SPEEDS, DeviceState, ImageHand, Viscous
from rcmqp.references.view import ViewCommand, view_of_pose, view_pose
from rcmqp.world.insertion import rcm_error, tilt

T = 0.001
ORIGIN = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def insertion() -> rcmqp.Insertion:
    return rcmqp.Insertion.on_shaft(rcmqp.load_arm("panda"), rcmqp.Instrument(), depth=0.1)


def held(hand: ImageHand, *places: tuple[float, float, float], roll: float = 0.0) -> None:
    """Take hold at the origin, and go from place to place; the handle turns on the way."""
    hand.ask(DeviceState(ORIGIN))
    for place in places:
        hand.ask(DeviceState(place, roll=roll))


def seen(insertion: rcmqp.Insertion, view: ViewCommand, point: Array) -> Array:
    """Where (2,) a point of the world stands in the picture, right and down, by Pinocchio."""
    oMe = dq.to_se3(view_pose(insertion.x_rcm, view).x_d)
    x, y, z = oMe.actInv(point) - np.array([0.0, 0.0, insertion.tip_depth])
    return np.array([x / z, y / z])


# The pace ----------------------------------------------------------------------------------


def test_the_pace_is_that_of_the_last_seconds() -> None:
    pace, cycles, found = Pace(T), 0, list[float]()
    for k in range(600):  # 60 times a second: in time, then half of all cycles, then in time
        cycles += (16, 8, 16)[k // 200]
        found.append(pace.skipped(0.016 * (k + 1), cycles))
    assert found[:200] == pytest.approx([0.0] * 200, abs=1e-12)
    assert found[399] == pytest.approx(0.5, abs=0.01)
    assert found[200 + round(RECENT / 0.016)] == pytest.approx(0.5, abs=0.01)
    assert found[-1] == pytest.approx(0.0, abs=1e-12)
    assert max(found) < 0.51


def test_a_loop_that_has_just_begun_has_no_pace() -> None:
    pace = Pace(T)
    assert pace.skipped(0.0, 0) == pace.skipped(0.4 * RECENT, 1) == 0.0


# The picture -------------------------------------------------------------------------------


@pytest.mark.parametrize("roll", range(-180, 181, 30))
@pytest.mark.parametrize("tilted", [(0.0, 0.0), (0.05, 0.03), (-0.06, 0.05)])
def test_a_drag_moves_the_pictures_content_against_it(
    insertion: rcmqp.Insertion, roll: float, tilted: tuple[float, float]
) -> None:
    for drag in ((1.0, 0.0), (0.0, 1.0), (-0.6, 0.8)):
        hand = ImageHand(insertion)
        held(hand, (*tilted, 0.0), roll=math.radians(roll))
        before = hand.view
        assert math.isclose(before.gamma, math.radians(roll))
        middle = dq.to_se3(view_pose(insertion.x_rcm, before).x_d).act(np.array([0, 0, 0.2]))
        place = (tilted[0] + 1e-4 * drag[0], tilted[1] + 1e-4 * drag[1], 0.0)
        hand.ask(DeviceState(place, roll=math.radians(roll)))
        moved = seen(insertion, hand.view, middle) - seen(insertion, before, middle)
        off = math.atan2(*np.flip(moved)) - math.atan2(-drag[1], -drag[0])
        assert abs(math.degrees(math.remainder(off, 2.0 * math.pi))) < 1.0
        assert np.linalg.norm(moved) > 1e-4


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_the_tip_moves_scale_times_as_far_as_the_hand(
    insertion: rcmqp.Insertion, scale: float
) -> None:
    for axis in range(3):
        hand = ImageHand(insertion, scale)
        held(hand, (0.04, -0.03, 0.02))
        tip = insertion.tip(view_pose(insertion.x_rcm, hand.view).x_d)
        place = np.array([0.04, -0.03, 0.02]) + 1e-5 * np.eye(3)[axis]
        hand.ask(DeviceState((place[0], place[1], place[2])))
        moved = insertion.tip(view_pose(insertion.x_rcm, hand.view).x_d) - tip
        assert_allclose(np.linalg.norm(moved), scale * 1e-5, rtol=1e-3, atol=0)


def test_a_hand_that_is_not_held_moves_nothing(insertion: rcmqp.Insertion) -> None:
    hand = ImageHand(insertion)
    held(hand, (0.01, 0.0, 0.0), roll=0.2)
    before = hand.view
    hand.ask(DeviceState((0.03, 0.0, 0.01), engaged=False, roll=0.5))
    hand.ask(DeviceState((0.05, 0.02, 0.02), roll=1.0))  # held anew: from here
    assert hand.view == before
    hand.ask(DeviceState((0.05, 0.02, 0.02), roll=1.1))
    assert math.isclose(hand.view.gamma, before.gamma + 0.1)


def test_no_hand_leads_out_of_cone_or_depths(insertion: rcmqp.Insertion) -> None:
    rng, hand = np.random.default_rng(7), ImageHand(insertion, 3.0)
    place = np.zeros(3)
    deepest = 0.0
    for _ in range(4000):
        place += rng.normal((0.002, 0.001, 0.001), 0.01)
        view = hand.ask(DeviceState((place[0], place[1], place[2])))
        x_d = view_pose(insertion.x_rcm, view).x_d
        assert tilt(x_d, insertion.trocar.axis) <= insertion.trocar.cone_half_angle + 1e-9
        deepest = max(deepest, insertion.tip_depth + view.t_z)
        assert (
            0.01 - 1e-12
            <= insertion.tip_depth + view.t_z
            <= insertion.trocar.depth_range[1] + 1e-12
        )
    assert deepest > 0.24  # it was led there


def test_a_view_is_found_again_in_its_pose(insertion: rcmqp.Insertion) -> None:
    for view in (ViewCommand(), ViewCommand(0.4, -0.7, 2.5, 0.03), ViewCommand(-0.9, 0.2, -3.0)):
        found = view_of_pose(insertion.x_rcm, view_pose(insertion.x_rcm, view).x_d)
        one, other = ((v.alpha, v.beta, v.gamma, v.t_z) for v in (found, view))
        assert_allclose(one, other, rtol=0, atol=1e-12)


# The viscosity ------------------------------------------------------------------------------


@pytest.mark.parametrize("viscosity", [0.0, 15.0, 40.0])
def test_a_jump_is_followed_within_the_limits_and_without_overshoot(viscosity: float) -> None:
    viscous, asked = Viscous(T, viscosity), ViewCommand(0.5, -0.3, 1.0, 0.04)
    places, rates = [], []
    for _ in range(6000):
        view = viscous.step(asked)
        places.append((view.alpha, view.beta, view.gamma, view.t_z))
        rates.append((view.alpha_dot, view.beta_dot, view.gamma_dot, view.t_z_dot))
    end = np.array([0.5, -0.3, 1.0, 0.04])
    assert_allclose(places[-1], end, rtol=0, atol=1e-6)
    assert (np.array(places) / end).max() < 1.0 + 1e-3
    assert (np.abs(rates).max(axis=0) <= np.array(SPEEDS) + 1e-9).all()
    assert (np.abs(np.diff(rates, axis=0)).max(axis=0) / T <= np.array(ACCELERATIONS) + 1e-9).all()


def test_small_motions_lag_by_the_time_constant() -> None:
    """B / K = 35 / 350 = 0.1 s."""
    viscous, slope = Viscous(T, 35.0), 0.02
    for k in range(3000):
        view = viscous.step(ViewCommand(alpha=slope * T * k))
    assert_allclose(slope * T * 2999 - view.alpha, 0.1 * slope, rtol=0.02, atol=0)


@dataclass
class Haptic:
    """A device that takes forces; the hand pulls it at 5 mm/s."""

    forces: list[tuple[float, float, float]] = field(default_factory=list)
    x: float = 0.0

    def __call__(self) -> DeviceState:
        self.x += 5e-6
        return DeviceState((self.x, 0.0, 0.0), (0.005, 0.0, 0.0))

    def send_force(self, force: tuple[float, float, float]) -> None:
        self.forces.append(force)


def test_a_device_that_takes_forces_renders_the_viscosity_and_is_not_filtered_too(
    insertion: rcmqp.Insertion,
) -> None:
    lags, haptic = [], Haptic()
    for device in (haptic, Haptic().__call__):
        steering = Steering(insertion, device, T, viscosity=35.0)
        for k in range(300):
            tip = insertion.tip(steering(T * k).reference.x_d)
        moved = float(np.linalg.norm(tip - insertion.tip(insertion.x_rcm)))
        lags.append(300 * 5e-6 - moved)
    assert_allclose(haptic.forces, np.tile([-0.175, 0.0, 0.0], (300, 1)), rtol=1e-12, atol=0)
    assert lags[0] < 0.6 * lags[1]


@pytest.mark.parametrize("viscosity", [-1.0, math.nan, math.inf])
def test_a_viscosity_that_is_none_is_refused(viscosity: float) -> None:
    with pytest.raises(OptionError, match="viscosity"):
        Viscous(T, viscosity)


# The dead-man -------------------------------------------------------------------------------


@dataclass
class Pages:
    """A page's end of the channel, and the clock of both."""

    channel: socket.socket
    hand: PageHand
    now: list[float] = field(default_factory=lambda: [5.0])
    number: int = 0

    def say(
        self, grip: int, *, held: bool = True, x: float = 0.0, operator: int = 1, age: float = 0.0
    ) -> None:
        self.number += 1
        at = self.now[0] - age
        way = (x, 0.0, 0.0, 0.0)
        self.channel.send(Hand(self.number, grip, held, at, at, way, operator).pack())

    def engaged(self) -> bool:
        """Whether the device says so, in the second cycle from now."""
        self.hand()
        return self.hand().engaged


@pytest.fixture
def pages() -> Iterator[Pages]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    theirs.setblocking(False)
    now = [5.0]
    with ours, theirs:
        yield Pages(ours, PageHand(theirs, lambda: now[0]), now)


def test_nothing_is_held_before_somebody_comes(pages: Pages) -> None:
    assert not pages.engaged()


def test_a_silent_hand_lets_go_and_has_to_take_hold_anew(pages: Pages) -> None:
    pages.say(1)
    assert pages.engaged()
    pages.now[0] += 0.099
    assert pages.hand().engaged
    pages.now[0] += 0.002
    assert not pages.hand().engaged
    assert pages.hand.stopped == 1
    pages.say(1)  # it is heard again, and still holds
    assert not pages.engaged()
    pages.say(2)
    assert pages.engaged()


@pytest.mark.parametrize("how", ["let go", "another operator", "an old grip"])
def test_a_grip_that_has_ended_never_comes_back(pages: Pages, how: str) -> None:
    pages.say(4)
    assert pages.engaged()
    if how == "let go":
        pages.say(4, held=False)
        pages.say(4)
    elif how == "another operator":
        pages.say(1, held=False, operator=2)
        pages.hand()
        pages.say(9, operator=1)
    else:
        pages.say(3)
    assert not pages.engaged()


def test_a_message_that_is_old_when_it_comes_holds_nothing(pages: Pages) -> None:
    pages.say(1, age=0.2)
    assert not pages.engaged()


def test_a_new_grip_begins_where_the_hand_is(pages: Pages, insertion: rcmqp.Insertion) -> None:
    image = ImageHand(insertion)
    pages.say(1, x=0.0)
    for _ in range(3):
        image.ask(pages.hand())
    pages.say(2, x=0.05)  # let go and taken up elsewhere, between two cycles
    for _ in range(3):
        image.ask(pages.hand())
    assert image.view == ViewCommand()
    pages.say(2, x=0.06)
    assert image.ask(pages.hand()).alpha > 0.05


def test_noise_on_the_channel_is_no_hand(pages: Pages) -> None:
    pages.channel.send(b"x" * 33)
    assert not pages.engaged()


# References for the loop --------------------------------------------------------------------


@dataclass
class Driven:
    """A hand that steers an arm, one cycle at a time."""

    insertion: rcmqp.Insertion
    law: str = "hierarchical_qp"
    hand: DeviceState = field(default_factory=lambda: DeviceState(ORIGIN, engaged=False))

    def __post_init__(self) -> None:
        arm = self.insertion.arm
        self.steering = Steering(self.insertion, lambda: self.hand, T)
        law = rcmqp.make_controller(self.law, self.insertion, T)
        self.held = Held.by(self.steering, law)
        self.q, self.t = np.array(self.insertion.q_start), 0.0
        self.v, self.a = np.zeros(arm.nv), np.zeros(arm.nv)
        self.jerk = self.rcm = 0.0

    def cycle(self) -> None:
        arm, before = self.insertion.arm, self.a
        reference = self.steering(self.t).reference
        state = self.insertion.state(self.q, self.v, self.a)
        v = self.held.step(state, reference).v
        self.steering.see(state)
        self.v, self.a = v, (v - self.v) / T
        self.jerk = max(self.jerk, float((np.abs(self.a - before) / T / arm.jerk).max()))
        self.rcm = max(self.rcm, float(rcm_error(state.x, self.insertion.trocar.pivot)))
        self.q, self.t = arm.integrate(self.q, v, T), self.t + T

    def tip(self) -> Array:
        return self.insertion.tip(self.insertion.state(self.q).x)


@pytest.mark.parametrize("law", ["hierarchical_qp", "dual_quaternion"])
def test_whatever_the_hand_does_the_arm_keeps_its_limits_and_rests_when_it_is_released(
    insertion: rcmqp.Insertion, law: str
) -> None:
    rng, driven, fastest = np.random.default_rng(7), Driven(insertion, law), 0.0
    for k in range(4000):
        if k % 16 == 0:
            place = rng.normal(scale=0.05, size=3)
            driven.hand = DeviceState((place[0], place[1], place[2]), engaged=k % 1000 < 600)
        driven.cycle()
        fastest = max(fastest, float(np.abs(driven.v).max()))
        if k % 1000 == 999:  # 0.4 s after it was let go
            assert not driven.v.any()
    assert fastest > 0.1
    assert driven.jerk <= 1.001
    assert driven.rcm < 1e-5


def test_joints_that_the_view_does_not_need_rest_too(insertion: rcmqp.Insertion) -> None:
    """The law's objective moves the elbow while the view stands still."""
    driven = Driven(insertion)
    driven.hand = DeviceState(ORIGIN)
    for k in range(500):
        driven.hand = DeviceState((1e-4 * min(k, 300), 0.0, 0.0))
        driven.cycle()
    assert np.abs(driven.v).max() > 1e-4
    driven.hand = DeviceState((0.03, 0.0, 0.0), engaged=False)
    for _ in range(300):
        driven.cycle()
    q = driven.q
    driven.cycle()
    assert np.array_equal(driven.q, q)


def test_a_grip_begins_where_the_arm_is_and_not_before_it_rests(
    insertion: rcmqp.Insertion,
) -> None:
    driven = Driven(insertion)
    for k in range(300):
        driven.hand = DeviceState((2e-4 * k, 0.0, 0.0))
        driven.cycle()
    driven.hand = DeviceState((0.06, 0.0, 0.0), engaged=False)
    driven.cycle()
    driven.hand = DeviceState((0.0, 0.0, 0.0))  # held again, elsewhere, while the arm brakes
    driven.cycle()
    assert driven.v.any()
    assert driven.steering.resting
    for _ in range(300):
        driven.cycle()
    assert not driven.steering.resting
    rested = driven.tip()
    for _ in range(300):
        driven.cycle()
    assert_allclose(driven.tip(), rested, rtol=0, atol=1e-6)  # it does not go back for the view


def test_a_far_view_goes_through_the_planner(
    insertion: rcmqp.Insertion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hand jumps by 8 cm; what the planner makes of it is approached in equal parts."""
    state = [DeviceState(ORIGIN)]
    steering = Steering(insertion, lambda: state[0], T, viscosity=0.0)
    asked: list[float] = []
    follow = steering._viscous.step

    def step(asked_for: ViewCommand, *, felt: bool) -> ViewCommand:
        asked.append(asked_for.alpha)
        return follow(asked_for, felt=felt)

    monkeypatch.setattr(steering._viscous, "step", step)
    steering(0.0)
    state[0] = DeviceState((0.08, 0.0, 0.0))
    for k in range(1, 60):
        steering(T * k)
    steps = np.diff(asked)
    assert_allclose(steps[:50], steps[0], rtol=1e-6, atol=0)  # from where the view is
    assert_allclose(asked[-1], 0.8, rtol=1e-6, atol=0)


def test_what_the_arm_cannot_reach_is_not_asked_for_further(insertion: rcmqp.Insertion) -> None:
    state = [DeviceState(ORIGIN)]
    steering = Steering(insertion, lambda: state[0], T)
    stuck = insertion.state(insertion.q_start, np.zeros(insertion.arm.nv))
    farthest = 0.0
    for k in range(3000):
        state[0] = DeviceState((min(1e-4 * k, 0.08), 0.0, 0.0))
        x_d = steering(T * k).reference.x_d
        steering.see(stuck)
        farthest = max(
            farthest, float(np.linalg.norm(insertion.tip(x_d) - insertion.tip(stuck.x)))
        )
    assert LEASH < farthest < 2.0 * LEASH
