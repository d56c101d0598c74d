"""People at the haptic device: who they are, and what they do."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from at_the_device import QUICK, T, done_at, insertion, pose, steering
from helpers import assert_allclose

from rcmqp import RcmqpError
from rcmqp.errors import OptionError, UnknownName
from rcmqp.references.hand import HandMapping
from rcmqp.references.operators import (
    GROUPS,
    PARAMETERS,
    CameraTrial,
    Operator,
    Spread,
    draw_operator,
    operator_of_study,
    recognition_times,
)
from rcmqp.references.operators.hand import Submovement
from rcmqp.references.operators.steering import is_clear, passing, via_point
from rcmqp.world.obstacles import Sphere

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
