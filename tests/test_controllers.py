"""What every registered controller promises, whatever its law."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import pickle
from collections.abc import Callable, Iterable

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, inserted

from rcmqp import (
    Command,
    Controller,
    Insertion,
    Reference,
    arm_names,
    load_scenario,
    make_controller,
    simulate,
    view_pose,
)
from rcmqp.controllers import CONTROLLERS, DualQuaternion, controller_options
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array, from_se3
from rcmqp.references.paths import ConicalHelix
from rcmqp.show.report import groups_of, remake_text

PERIOD = 8e-3

every_controller = pytest.mark.parametrize("name", list(CONTROLLERS))
on_every_arm = pytest.mark.parametrize("arm_name", arm_names())


def made(name: str, arm: str = "lwa3") -> Controller:
    return make_controller(name, inserted(arm), PERIOD)


def views(insertion: Insertion, count: int = 50) -> list[Reference]:
    """References one period apart in the middle of a quick helix."""
    helix = ConicalHelix(duration=10.0)
    times = 3.0 + PERIOD * np.arange(count)
    return [view_pose(insertion.x_rcm, helix.command(t, insertion.tip_depth)) for t in times]


def flipped(reference: Reference) -> Reference:
    """The same pose and rate by the other dual quaternion."""
    return dataclasses.replace(reference, x_d=-reference.x_d, x_d_dot=-reference.x_d_dot)


def follow(controller: Controller, references: Iterable[Reference]) -> tuple[Array, list[Command]]:
    """Configurations (n, nq) and answers of a loop from the start, written out by hand."""
    arm, q = controller.insertion.arm, controller.insertion.q_start
    path, answers = [q], list[Command]()
    for reference in references:
        v = answers[-1].v if answers else None
        answers.append(controller.step(arm.state(q, v), reference))
        q = pin.integrate(arm.model, q, controller.period * answers[-1].v)
        path.append(q)
    return np.array(path), answers


# Answers -----------------------------------------------------------------------------------


@every_controller
@on_every_arm
def test_answers_are_finite_and_of_one_shape(name: str, arm_name: str) -> None:
    controller = made(name, arm_name)
    _, answers = follow(controller, views(controller.insertion))
    names = answers[0].diagnostics.keys()
    for answer in answers:
        assert answer.v.shape == (controller.insertion.arm.nv,)
        assert answer.v.dtype == np.float64
        assert np.isfinite(answer.v).all()
        assert answer.diagnostics.keys() == names
        assert all(math.isfinite(value) for value in answer.diagnostics.values())


@every_controller
@on_every_arm
def test_x_d_and_minus_x_d_are_one_command(name: str, arm_name: str) -> None:
    controller = made(name, arm_name)
    references = views(controller.insertion)
    negative = [flipped(item) for item in references]
    path, _ = follow(controller, references)
    controller.reset()
    assert_allclose(follow(controller, negative)[0], path, rtol=0, atol=1e-12)


@every_controller
@on_every_arm
def test_after_reset_a_rerun_gives_the_same_bits(name: str, arm_name: str) -> None:
    controller = made(name, arm_name)
    references = views(controller.insertion)
    path, answers = follow(controller, references)
    controller.reset()
    again, answers_again = follow(controller, references)
    fresh, _ = follow(made(name, arm_name), references)
    assert np.array_equal(path, again)
    assert np.array_equal(path, fresh)
    assert [a.diagnostics for a in answers] == [a.diagnostics for a in answers_again]


@every_controller
def test_steps_share_no_memory(name: str) -> None:
    controller = made(name)
    arm, references = controller.insertion.arm, views(controller.insertion, 2)
    states = [arm.state(controller.insertion.q_start) for _ in references]
    expected = [controller.step(*pair).v.copy() for pair in zip(states, references, strict=True)]
    controller.reset()

    first = controller.step(states[0], references[0])
    given = [states[0].q, states[0].angles, states[0].x, states[0].J_local]
    given += [references[0].x_d, references[0].x_d_dot, arm.velocity]
    assert not any(np.shares_memory(first.v, array) for array in given)
    for array in (first.v.base, first.v):
        if array is not None:
            array.setflags(write=True)
    first.v[:] = np.nan
    for array in given[:-1]:
        array.setflags(write=True)
        array[:] = np.nan
    assert np.array_equal(controller.step(states[1], references[1]).v, expected[1])


@every_controller
def test_a_step_leaves_what_it_is_given_as_it_is(name: str) -> None:
    controller = made(name)
    state = controller.insertion.state(controller.insertion.q_start)
    (reference,) = views(controller.insertion, 1)
    reference = flipped(reference)
    kept = reference.x_d.copy(), reference.x_d_dot.copy(), state.oMe.copy(), state.x.copy()
    controller.step(state, reference)
    assert np.array_equal(reference.x_d, kept[0])
    assert np.array_equal(reference.x_d_dot, kept[1])
    assert state.oMe == kept[2]
    assert np.array_equal(state.x, kept[3])


# Refusals ----------------------------------------------------------------------------------


@every_controller
@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(lambda x: x * np.nan, id="nan"),
        pytest.param(lambda x: np.where(np.arange(8) == 6, np.inf, x), id="inf"),
        pytest.param(lambda x: 1.001 * x, id="long"),
        pytest.param(lambda x: 0.0 * x, id="zero"),
        pytest.param(lambda x: x + np.array([0, 0, 0, 0, *(1e-3 * x[:4])]), id="P.D"),
        pytest.param(lambda x: x[:4], id="short"),
    ],
)
def test_a_reference_that_is_no_pose_ends_in_the_safe_stop(
    name: str, spoil: Callable[[Array], Array]
) -> None:
    controller = made(name)
    state = controller.insertion.state(controller.insertion.q_start)
    (reference,) = views(controller.insertion, 1)
    spoilt = dataclasses.replace(reference, x_d=spoil(from_se3(state.oMe)))
    assert controller.step(state, reference).stop == ""
    answer = controller.step(state, spoilt)
    assert answer.stop.startswith("x_d of the reference ")
    assert answer.diagnostics["safe_stop"] == 1.0
    assert np.array_equal(answer.v, np.zeros(controller.insertion.arm.nv))  # it stood still


@every_controller
@pytest.mark.parametrize("period", [0.0, -1e-3, math.nan, math.inf])
def test_a_period_that_is_not_positive_is_refused(name: str, period: float) -> None:
    with pytest.raises(OptionError, match=f"period = {period}"):
        make_controller(name, inserted("lwa3"), period)


# The registry ------------------------------------------------------------------------------


def test_there_are_controllers_and_each_knows_its_name() -> None:
    assert "dual_quaternion" in CONTROLLERS
    assert {name: cls.name for name, cls in CONTROLLERS.items()} == {n: n for n in CONTROLLERS}


@every_controller
def test_hyphens_are_as_good_as_underscores(name: str) -> None:
    hyphened = make_controller(name.replace("_", "-"), inserted("lwa3"), PERIOD)
    assert hyphened.name == name


@every_controller
def test_options_make_an_equal_controller_again_and_fit_into_json(name: str) -> None:
    controller = made(name)
    options = json.loads(json.dumps(controller.options))
    again = make_controller(name, controller.insertion, PERIOD, **options)
    assert again.options == controller.options == options
    assert controller_options(name).keys() == options.keys()


@every_controller
def test_a_controller_is_frozen(name: str) -> None:
    controller = made(name)
    with pytest.raises(dataclasses.FrozenInstanceError):
        controller.period = 1.0  # type: ignore[misc]


@every_controller
def test_an_unknown_option_is_answered_with_the_nearest(name: str) -> None:
    option = next(iter(controller_options(name)))
    with pytest.raises(UnknownName, match=f"option of {name} '{option}s'; did you mean {option}"):
        make_controller(name, inserted("lwa3"), PERIOD, **{option + "s": 1.0})


def test_an_unknown_controller_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownName, match="'dual_quaternions'; did you mean dual_quaternion"):
        make_controller("dual-quaternions", inserted("lwa3"), PERIOD)


def test_a_class_that_gives_no_name_goes_by_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its runs must not pass for those of the controller that it derives from."""

    @dataclasses.dataclass(frozen=True, eq=False)
    class HalfGain(DualQuaternion):
        gain: float = 30.0

    assert HalfGain.name == "half_gain"
    assert {kind.name for kind in CONTROLLERS.values()} == set(CONTROLLERS)
    monkeypatch.setitem(CONTROLLERS, "half_gain", HalfGain)
    scenario = load_scenario("circle", "panda", duration=0.01)
    insertion = scenario.insertion()
    run = simulate(scenario, make_controller("half-gain", insertion, scenario.period))
    assert run.controller == "half_gain"
    (group,) = groups_of([run], ["run.h5"])
    assert "is not one of rcmqp's" in remake_text([group], "")
    monkeypatch.setitem(CONTROLLERS, "half", HalfGain)
    with pytest.raises(OptionError, match=r"in CONTROLLERS as 'half', .* would say 'half_gain'"):
        make_controller("half", insertion, scenario.period)


@every_controller
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda law: pickle.loads(pickle.dumps(law))])
def test_a_copy_answers_as_a_law_that_was_reset_before_and_after_a_step(
    name: str, copied: Callable[[Controller], Controller]
) -> None:
    law = made(name)
    (reference,) = views(law.insertion, 1)
    state = law.insertion.state(law.insertion.q_start)
    first = copied(law).step(state, reference).v
    assert_allclose(law.step(state, reference).v, first)
    assert_allclose(copied(law).step(state, reference).v, first)  # as if reset


@every_controller
def test_states_of_other_kinds_of_arrays_are_answered(name: str) -> None:
    """Single precision, and views of every other number."""
    law = made(name)
    (reference,) = views(law.insertion, 1)
    state = law.insertion.state(law.insertion.q_start)
    single = dataclasses.replace(state, J_local=state.J_local.astype(np.float32))
    spread = dataclasses.replace(
        state, angles=np.repeat(state.angles, 2)[::2], x=np.repeat(state.x, 2)[::2]
    )
    for other in (single, spread):
        law.reset()
        expected = law.step(state, reference).v
        law.reset()
        answer = law.step(other, reference)
        assert not answer.stop
        assert_allclose(answer.v, expected, atol=1e-4)
