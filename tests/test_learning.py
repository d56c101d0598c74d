"""Practice before a trial, and learning in it: an option that is off by default."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from rcmqp import Scenario, load_scenario
from rcmqp.errors import OptionError, UnknownName
from rcmqp.experiments.study.perform import perform
from rcmqp.experiments.study.plan import Law, Study
from rcmqp.references.operators import (
    PARAMETERS,
    CameraTrial,
    Learning,
    Operator,
    draw_operator,
    operator_of_study,
    recognition_times,
)
from rcmqp.references.operators.learning import REFERENCE, SHAPES
from rcmqp.references.view import view_pose

each_shape = pytest.mark.parametrize("shape", SHAPES)
T = 0.02


@each_shape
def test_after_the_papers_two_minutes_a_novice_is_the_novice_of_the_study(shape: str) -> None:
    novice, learning = draw_operator("novice", 3), Learning(shape=shape)
    assert learning.practice == REFERENCE == 120.0
    assert learning.share(0.0) == 1.0
    assert learning.person(novice, 0.0) is novice


@each_shape
def test_practice_and_time_in_the_trial_count_alike(shape: str) -> None:
    long, short = Learning(150.0, shape), Learning(120.0, shape)
    assert long.share(10.0) == pytest.approx(short.share(40.0))


def test_the_shares_are_those_of_the_two_laws() -> None:
    """By hand: e^(-150/300); ((60 + 120 + 540) / 180)^-0.5 = 1/2."""
    assert Learning().share(150.0) == pytest.approx(0.60653, rel=1e-5)
    assert Learning(shape="power").share(540.0) == pytest.approx(0.5)
    assert Learning(0.0, shape="power").share(0.0) == pytest.approx(math.sqrt(3.0))


@each_shape
def test_a_novice_becomes_what_the_experienced_are_and_no_better(shape: str) -> None:
    """A novice and an experienced person of one seed have the same luck."""
    novice, plateau = (draw_operator(group, 11) for group in ("novice", "experienced"))
    learning = Learning(shape=shape, rate=5.0)
    people = [learning.person(novice, t) for t in (-60.0, 0.0, 60.0, 600.0, 1e5)]
    for name, parameter in PARAMETERS.items():
        if parameter.novice.first == parameter.experienced.first:
            assert len({getattr(p, name) for p in people}) == 1, name
            continue
        values = [getattr(p, name) for p in people]
        assert np.all(np.diff(values) * (values[-1] - values[0]) >= 0.0), name
        if parameter.novice.kind == "lognormal":  # elsewhere the luck is added, not multiplied
            assert values[-1] == pytest.approx(getattr(plateau, name), rel=1e-3), name
    assert learning.person(plateau, 500.0) is plateau


def test_without_practice_no_number_leaves_its_range() -> None:
    wild = Learning(0.0, time=30.0)  # e^4 times the difference
    for seed in range(50):
        person = wild.person(draw_operator("novice", seed), 0.0)
        for name, parameter in PARAMETERS.items():
            assert parameter.low <= getattr(person, name) <= parameter.high, name


def looks_and_times(learning: Learning | None, person: Operator, seed: int) -> list[float]:
    """When each objective is reached by an arm that is where it is asked to be [s]."""
    insertion = load_scenario("camera_task", "panda").insertion()
    asking = CameraTrial(person, learning=learning).start(insertion, T, seed)
    x, times = insertion.x_rcm, []
    for k in range(20000):
        before = asking.objective
        view = asking.command(k * T, x)
        if asking.objective > before:
            times.append(k * T)
        if view is None:
            return times
        x = view_pose(insertion.x_rcm, view).x_d
    raise AssertionError("the task is never done")


def test_who_practises_is_quicker_and_who_does_not_learn_is_as_ever() -> None:
    totals = {
        practice: np.mean(
            [
                looks_and_times(
                    None if practice is None else Learning(practice, time=120.0),
                    *operator_of_study(2 * i, 0),
                )[-1]
                for i in range(5)
            ]
        )
        for practice in (0.0, 120.0, 600.0, None)
    }
    assert totals[0.0] > totals[None] > totals[120.0] > totals[600.0]


def test_who_has_learned_all_there_is_steers_like_such_a_person() -> None:
    """Eyes, looks, submovements and detours all know it, from the first cycle on."""
    novice, seed = operator_of_study(0, 46)
    done = Learning(1e6)
    person = done.person(novice, 0.0)
    assert done.share(0.0) == 0.0
    assert looks_and_times(done, novice, seed) == looks_and_times(None, person, seed)


def test_a_study_passes_it_on_and_counts_the_looking_that_was_done(tmp_path: Path) -> None:
    learning = Learning(30.0)
    study = Study(operators=2, seed=46, laws=(Law(period=0.02),), learning=learning)
    novice, experienced = perform(study, tmp_path / "with").outcomes
    person, seed = operator_of_study(0, 46)
    starts = (0.0, *novice.reached_s[:-1])
    looks = recognition_times(person, 4, seed, learning, starts)
    assert novice.looking_s == pytest.approx(sum(looks))
    assert novice.looking_s > sum(recognition_times(person, 4, seed))
    plain = perform(dataclasses.replace(study, learning=None), tmp_path / "without").outcomes
    assert plain[0].digest != novice.digest
    assert plain[1].reached_s == experienced.reached_s  # they had no practice in the paper
    made = study.trials()[0].made()
    assert isinstance(made.path, CameraTrial)
    assert made.path.learning == learning
    assert Scenario.from_json(made.to_json()) == made


def test_the_hand_on_the_handle_is_open_to_look_at() -> None:
    insertion = load_scenario("camera_task", "panda").insertion()
    asking = CameraTrial(Operator(recognition=0.0)).start(insertion, T, 0)
    x = insertion.x_rcm
    for k in range(100):
        hand = asking.hand
        view = asking.command(k * T, x)
        assert view is not None
        x = view_pose(insertion.x_rcm, view).x_d
    assert view is not None
    assert view.t_z == pytest.approx(hand[2], abs=1e-5)


@pytest.mark.parametrize(
    "changes", [{"practice": -1.0}, {"time": 0.0}, {"prior": math.nan}, {"rate": math.inf}]
)
def test_learning_that_makes_no_sense_is_refused(changes: dict[str, float]) -> None:
    with pytest.raises(OptionError, match=f"{next(iter(changes))} = "):
        Learning(**changes)  # type: ignore[arg-type]


def test_an_unknown_shape_is_refused() -> None:
    with pytest.raises(UnknownName, match="exponential, power"):
        Learning(shape="linear")
