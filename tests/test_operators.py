"""The model of an operator by itself, on an arm that is where it is asked to be."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import Insertion, RcmqpError, load_scenario
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.hand import HandMapping
from rcmqp.references.operators import (
    GROUPS,
    PARAMETERS,
    CameraTrial,
    Omega7,
    Operator,
    Spread,
    Steering,
    draw_operator,
    operator_of_study,
    recognition_times,
)
from rcmqp.references.operators.camera_task import CameraTask
from rcmqp.references.operators.detour import is_clear, passing, via_point
from rcmqp.references.operators.hand import Hand
from rcmqp.references.operators.perception import Eyes
from rcmqp.references.operators.submovement import Submovement, duration
from rcmqp.references.operators.tremor import Tremor
from rcmqp.references.view import view_pose
from rcmqp.world.instrument import Vector3
from rcmqp.world.obstacles import Sphere

T = 0.02
QUICK = Operator(recognition=0.0, margin=0.0)
"""An experienced operator who need not look, nor keep away from anything."""


@functools.cache
def insertion() -> Insertion:
    return load_scenario("camera_task", "panda").insertion()


def steering(trial: CameraTrial, seed: int = 0, period: float = T) -> Steering:
    return trial.start(insertion(), period, seed)


def done_at(trial: CameraTrial, seed: int, most: float = 200.0) -> list[float]:
    """When each objective is reached on a perfect arm [s]."""
    asking, x, times = steering(trial, seed), insertion().x_rcm, []
    for k in range(round(most / T)):
        before = asking.objective
        view = asking.command(k * T, x)
        if asking.objective > before:
            times.append(k * T)
        if view is None:
            break
        x = view_pose(insertion().x_rcm, view).x_d
    return times


# Who they are ------------------------------------------------------------------------------


def test_every_number_has_a_source_and_lies_in_its_range() -> None:
    names = [item.name for item in dataclasses.fields(Operator)][1:]
    assert list(PARAMETERS) == names
    default = Operator()
    for name, parameter in PARAMETERS.items():
        assert parameter.source.startswith(("[V] ", "[M] ", "[C]", "[A]")), name
        assert parameter.low <= getattr(default, name) <= parameter.high, name
        for group in GROUPS:
            for seed in range(100):
                drawn = getattr(draw_operator(group, seed), name)
                assert parameter.low <= drawn <= parameter.high, name


def test_the_groups_are_as_far_apart_as_their_sources_say() -> None:
    drawn = {group: [draw_operator(group, seed) for seed in range(400)] for group in GROUPS}
    for name, parameter in PARAMETERS.items():
        for group in GROUPS:
            values = [getattr(person, name) for person in drawn[group]]
            spread: Spread = getattr(parameter, group)
            middle = spread.first
            if spread.kind == "uniform":
                middle = (spread.first + spread.second) / 2.0
            assert np.median(values) == pytest.approx(middle, rel=0.1), (name, group)


def test_an_operator_does_not_depend_on_how_many_there_are() -> None:
    people = [operator_of_study(i, 5) for i in range(6)]
    assert people == [operator_of_study(i, 5) for i in range(6)]
    assert [person.group for person, _ in people] == list(GROUPS) * 3
    assert len({seed for _, seed in people}) == 6
    assert people[0] != operator_of_study(0, 6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"delay": -0.1}, "delay = -0.1 s, it must be finite and 0 or more"),
        ({"tremor": math.nan}, "tremor = nan"),
        ({"speed": 0.0}, "speed = 0.0 m/s, it must be positive"),
        ({"tremor_damping": 1.0}, "tremor_damping = 1.0, it must be between 0 and 1"),
        ({"recognition_shape": 0.0}, "recognition_shape = 0.0, it must be positive"),
    ],
)
def test_a_person_that_cannot_be_is_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        dataclasses.replace(Operator(), **changes)  # type: ignore[arg-type]


def test_unknown_groups_and_numbers_below_zero_are_refused() -> None:
    with pytest.raises(UnknownName, match="did you mean novice"):
        draw_operator("novices", 0)
    with pytest.raises(OptionError, match="index = -1"):
        operator_of_study(-1, 0)


# How they move -----------------------------------------------------------------------------


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


# What they see -----------------------------------------------------------------------------


def test_the_tip_is_where_pinocchio_has_it() -> None:
    rng = np.random.default_rng(7)
    ins = insertion()
    eyes = Eyes(Operator(), CameraTask(), ins, rng)
    start = dq.to_se3(ins.x_rcm)
    for _ in range(5):
        x = dq.mul(
            ins.x_rcm, dq.exp(np.array([0.0, *rng.normal(0, 0.3, 3), 0, *rng.normal(0, 0.1, 3)]))
        )
        tip = dq.to_se3(x).act(np.array([0.0, 0.0, ins.tip_depth]))
        assert_allclose(eyes.tip(x), start.actInv(tip), rtol=0, atol=1e-14)


def pose(p: Vector3) -> Array:
    """Effector pose (8,) with its tip at p (3,), from the trocar in the start's axes."""
    view = HandMapping().view(HandMapping().way(p, 0.10), (0.0, 0.0, 0.0), 0.10)
    return np.asarray(view_pose(insertion().x_rcm, view).x_d)


def test_distances_are_seen_late_in_the_image_and_worst_in_depth() -> None:
    operator, task = Operator(depth_bias=0.01), CameraTask()
    eyes = Eyes(operator, task, insertion(), np.random.default_rng(7))
    early, late = (0.01, 0.005, 0.10), (0.02, -0.01, 0.09)
    eyes.look(0.0, pose(early))
    eyes.look(0.1, pose(late))
    goal, seen_by = task.targets[2], task.spheres[2].centre
    placement = dq.to_se3(dq.mul(dq.conj(insertion().x_rcm), pose(early)))
    now = 0.1 + operator.delay
    away = placement.rotation.T @ (np.array(goal) - early)
    seen = np.array(
        [eyes.perceive(0.1 + operator.delay - 1e-3, goal, seen_by) for _ in range(4000)]
    )
    assert_allclose(seen.mean(axis=0), away, rtol=0, atol=3e-4)
    lateral = operator.floor_lateral + operator.weber_lateral * np.abs(away[:2])
    deep = operator.floor_depth + operator.weber_depth * abs(away[2])
    deep = math.hypot(deep + operator.weber_cross * np.linalg.norm(away), operator.depth_bias)
    assert_allclose(seen.std(axis=0), [*lateral, deep], rtol=0.05)
    assert deep > 3.0 * lateral.max()
    later = eyes.perceive(now + 1e-3, goal, seen_by)
    assert later is not None
    placement = dq.to_se3(dq.mul(dq.conj(insertion().x_rcm), pose(late)))
    assert np.linalg.norm(placement.rotation.T @ (np.array(goal) - late) - later) < 0.03
    assert_allclose(
        eyes.place(goal, later), np.array(goal) - placement.rotation @ later, atol=1e-12
    )


def test_what_is_not_in_the_image_is_remembered_inexactly_and_the_same_all_the_way() -> None:
    """Beside the nearest sphere that is; the first image shows all, and nothing is off in it."""
    task = CameraTask()
    exact = dataclasses.replace(
        Operator(), floor_lateral=0.0, floor_depth=0.0, depth_bias=0.0, weber_lateral=0.0
    )
    exact = dataclasses.replace(exact, weber_depth=0.0, weber_cross=0.0, memory=0.2)
    eyes = Eyes(exact, task, insertion(), np.random.default_rng(7))
    goal, mark = task.targets[2], task.spheres[2].centre
    close = pose(task.targets[0])
    eyes.look(0.0, insertion().x_rcm)
    shown = eyes.perceive(0.3, goal, mark)
    assert shown is not None
    assert_allclose(eyes.place(goal, shown), (0.0, 0.0, insertion().tip_depth), atol=1e-12)
    eyes.look(1.0, close)  # a close-up of the first sphere: the others are out of sight
    off = []
    for _ in range(400):
        eyes.remember()
        first, second = (eyes.perceive(2.0, goal, mark) for _ in range(2))
        assert first is not None
        assert first == second
        off.append(np.subtract(eyes.place(goal, first), task.targets[0]))
    beside = math.dist(mark, task.spheres[0].centre)
    assert_allclose(np.std(off, axis=0), 0.2 * beside, rtol=0.12)


@pytest.mark.parametrize("period", [1e-3, 4e-3, 8e-3])
def test_the_camera_has_thirty_images_a_second_whatever_the_period(period: float) -> None:
    eyes = Eyes(Operator(), CameraTask(), insertion(), np.random.default_rng(7))
    for k in range(round(2.0 / period)):
        eyes.look(k * period, insertion().x_rcm)
    assert len(eyes._frames) == 60


def test_a_movement_ends_short_and_scattered_as_its_muscles_have_it() -> None:
    operator = dataclasses.replace(QUICK, gain=0.8, motor_noise=0.1)
    away, ends = np.array([0.02, -0.01, 0.03]), []
    asking = steering(CameraTrial(operator))
    asking._eyes.perceive = lambda *_: tuple(away)  # type: ignore[method-assign]
    for _ in range(3000):
        asking._move = Submovement((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0, 1.0)
        asking._decide(2.0)
        ends.append(asking._move.way)
    assert_allclose(np.mean(ends, axis=0), 0.8 * away, rtol=0, atol=2e-4)
    assert_allclose(np.std(ends, axis=0), 0.1 * 0.8 * np.linalg.norm(away), rtol=0.06)


def test_the_point_beside_the_obstacle_is_passed_when_it_seems_near_and_the_way_clear() -> None:
    """Where the camera really is makes no difference: it has not moved at all here."""
    for seems, clear in ((0.0075, True), (0.0085, False)):
        trial = CameraTrial(QUICK)
        asking = steering(trial)
        asking.objective = 2
        asking._start_objective(0.0, trial.task.targets[1])
        assert asking._via is not None
        asking._eyes.look(0.0, pose(trial.task.targets[1]))
        asking._eyes.perceive = lambda *_, z=-seems: (0.0, 0.0, z)  # type: ignore[method-assign]
        asking._decide(1.0)
        assert (asking._via is None) is clear


def test_an_image_without_spheres_tells_nothing_and_the_hand_goes_back() -> None:
    task = CameraTask()
    eyes = Eyes(Operator(), task, insertion(), np.random.default_rng(7))
    eyes.look(0.0, pose((0.0, 0.0, 0.16)))  # past where it sees any
    assert eyes.perceive(1.0, task.targets[0], task.spheres[0].centre) is None
    asking, blind = steering(CameraTrial(QUICK)), pose((0.0, 0.0, 0.16))
    ways, moves = [], set()
    for k in range(200):
        asking.command(k * T, insertion().x_rcm if k < 8 else blind)
        if asking._move not in moves:
            moves.add(asking._move)
            ways.append(np.array(asking._move.way))
    assert np.linalg.norm(ways[1]) > 0.02
    assert ways[2] @ ways[1] < -0.4 * ways[1] @ ways[1]  # half-way back to the start
    assert np.linalg.norm(ways[1] + ways[2] + ways[3]) < 0.35 * np.linalg.norm(ways[1])


def test_the_hand_is_never_meant_further_out_of_the_patient_than_where_it_started() -> None:
    unsure = dataclasses.replace(QUICK, floor_depth=6e-3, weber_depth=1.0, interval=0.05)
    asking, x, outmost = steering(CameraTrial(unsure)), pose((-0.02, -0.02, 0.142)), 0.0
    moves = set()
    for k in range(2000):
        asking.command(k * T, x)
        moves.add(asking._move)
        outmost = min(outmost, asking._move.start[2] + asking._move.way[2])
    assert outmost > -1e-12
    assert sum(move.way[2] < 0.0 for move in moves) > 10  # who sees it too far in pulls back


def test_what_the_arm_does_is_answered_after_the_delay_and_not_before() -> None:
    """Two arms that part ways at t = 0.5 s: the hand knows from 0.5 s + delay on."""
    operator = dataclasses.replace(QUICK, delay=0.3, interval=0.01, shortest=0.02, speed=10.0)
    views = []
    for off in (0.0, 0.004):
        asking, x, asked = steering(CameraTrial(operator)), insertion().x_rcm, []
        for k in range(150):
            view = asking.command(k * T, x)
            assert view is not None
            asked.append((view.alpha, view.beta, view.t_z))
            x = view_pose(insertion().x_rcm, view).x_d
            if k * T >= 0.5 - 1e-9:
                x = dq.mul(x, dq.from_translation([0.0, 0.0, off]))
        views.append(np.array(asked))
    same = (views[0] == views[1]).all(axis=1)
    first = int(np.argmin(same)) * T
    assert same[: round(0.78 / T)].all()
    assert 0.8 <= first < 1.5


# What they do ------------------------------------------------------------------------------


def test_a_trial_is_the_same_again_and_another_with_another_seed() -> None:
    trial = CameraTrial(QUICK)
    first = done_at(trial, 3)
    assert len(first) == 4
    assert first == done_at(trial, 3)
    assert first != done_at(trial, 4)


def test_looking_comes_before_moving_and_shifts_nothing_else() -> None:
    """The same hand, later: chance has a stream of its own for each use."""
    slow = dataclasses.replace(QUICK, recognition=5.0)
    looking = recognition_times(slow, 4, 3)
    assert looking == recognition_times(dataclasses.replace(slow, group="novice"), 4, 3)
    times, quick = done_at(CameraTrial(slow), 3), done_at(CameraTrial(QUICK), 3)
    assert times[-1] > sum(looking)
    assert times[0] - looking[0] == pytest.approx(quick[0], abs=1.5)
    many = [t for seed in range(2000) for t in recognition_times(slow, 4, seed)]
    assert np.mean(many) == pytest.approx(5.0, rel=0.03)
    assert np.std(many) == pytest.approx(5.0 / math.sqrt(3.0), rel=0.05)


def test_the_way_round_keeps_its_distance() -> None:
    obstacle, start, goal = (
        Sphere((0.025, 0.0, 0.12), 0.008),
        (0.025, -0.025, 0.12),
        (0.025, 0.025, 0.12),
    )
    via = via_point(start, goal, obstacle, 0.02)
    assert via is not None
    assert 0.0 < via[0] < 0.025  # towards the middle
    assert via[2] < 0.12  # and withdrawn
    for a, b in ((start, via), (via, goal)):
        part = np.linspace(0.0, 1.0, 2001)[:, None]
        points = np.array(a) + part * (np.array(b) - np.array(a))
        away = np.linalg.norm(points - np.array(obstacle.centre), axis=1)
        assert away.min() == pytest.approx(0.02, abs=1e-5)
        assert is_clear(a, b, obstacle, 0.02 - 1e-9)
    assert not is_clear(start, goal, obstacle, 0.02)
    assert via_point(start, (-0.025, -0.025, 0.12), obstacle, 0.02) is None


def test_a_way_is_clear_only_if_the_whole_shaft_keeps_its_distance() -> None:
    """Beyond the obstacle the tip is far from it, and the shaft goes through it."""
    obstacle = Sphere((0.025, 0.0, 0.12), 0.008)
    beyond = (0.04, -0.03, 0.16), (0.04, 0.03, 0.16)
    assert passing(*beyond, obstacle).min() < 5e-3
    assert math.dist((0.04, 0.0, 0.16), obstacle.centre) > 0.04
    assert not is_clear(*beyond, obstacle, 0.02)
    assert is_clear((0.025, -0.025, 0.12), (0.025, -0.04, 0.16), obstacle, 0.02)  # away from it


def test_who_is_less_sure_keeps_wider_of_the_obstacle() -> None:
    """The point beside it lies further from it, by what a movement from there is off."""
    asked = []
    for operator in (
        QUICK,
        dataclasses.replace(QUICK, floor_depth=3e-3),
        dataclasses.replace(QUICK, motor_noise=0.2),
        dataclasses.replace(QUICK, caution=0.0),
    ):
        trial = CameraTrial(operator)
        asking = steering(trial)
        asking.objective = 2
        asking._start_objective(0.0, trial.task.targets[1])
        assert asking._via is not None
        asked.append(math.dist(asking._via, trial.task.obstacle.centre))
    sure, deep, shaky, careless = asked
    assert careless < sure < min(deep, shaky)


def test_a_movement_once_begun_is_ended_whatever_it_leads_to() -> None:
    """The camera looks ahead: nobody sees the shaft come to the obstacle."""
    asking, x = steering(CameraTrial(QUICK)), pose((0.025, -0.025, 0.14))
    asking.objective = 2
    asking._move = aimed = Submovement((0.0, 0.0, 0.0), (0.0, 0.05, 0.0), 0.0, 2.0)
    asking._next = 2.0
    for k in range(round(2.0 / T)):
        asking.command(k * T, x)
        assert asking._move is aimed
    asking.command(2.0, x)
    assert asking._move is not aimed


def test_an_operator_at_the_obstacle_goes_on_even_if_no_way_ever_seems_clear(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """However wide a way is wished, or however badly it is seen."""
    wide = dataclasses.replace(QUICK, margin=0.1)
    assert len(done_at(CameraTrial(wide), 0)) == 4
    monkeypatch.setattr("rcmqp.references.operators.steering.is_clear", lambda *_: False)
    assert len(done_at(CameraTrial(QUICK), 0)) == 4


def test_a_hand_whose_way_is_scaled_up_moves_by_less() -> None:
    ways = []
    for scale in (1.0, 2.0):
        asking = steering(CameraTrial(QUICK, mapping=HandMapping(scale)))
        for k in range(20):
            asking.command(k * T, insertion().x_rcm)
        ways.append(np.array(asking._move.way))
    assert np.linalg.norm(ways[0]) > 0.02
    assert_allclose(ways[1], ways[0] / 2.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"operator": 3}, "operator = 3, it must be of type Operator"),
        ({"duration": 0.0}, "duration = 0.0 s"),
        ({"task": {"side": -1.0}}, "side = -1.0 m"),
        ({"task": {"obstacle_radius": 0.03}}, "reaches the objectives beside it"),
    ],
)
def test_a_trial_that_makes_no_sense_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(RcmqpError, match=message):
        CameraTrial(**changes)  # type: ignore[arg-type]
