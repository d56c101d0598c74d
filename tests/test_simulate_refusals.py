"""What simulate() refuses, and when."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from helpers import ran

from rcmqp import (
    ArmState,
    Command,
    Insertion,
    Instrument,
    Reference,
    compute_metrics,
    load_arm,
    load_scenario,
    make_controller,
    simulate,
)
from rcmqp.controllers import DualQuaternion, HierarchicalQP
from rcmqp.errors import InsertionError, InvalidCommand, OptionError
from rcmqp.qp import InvalidProblem
from rcmqp.references.paths import ConicalHelix
from rcmqp.runs.simulate import record
from rcmqp.tasks import RcmTask, Residual, Task
from rcmqp.world.obstacles import Sphere


def test_a_controller_for_another_period_is_refused() -> None:
    scenario = load_scenario("conical_helix", duration=0.1)
    controller = make_controller("dual_quaternion", scenario.insertion(), 2e-3)
    with pytest.raises(OptionError, match=r"period of 0\.002 s, the scenario has 0\.001 s"):
        simulate(scenario, controller)


def test_exchanged_arguments_are_named(tmp_path: Path) -> None:
    scenario = load_scenario("conical_helix", duration=0.1)
    controller: Any = make_controller("damped", scenario.insertion(), scenario.period)
    swapped: Any = scenario
    with pytest.raises(OptionError, match=r"the arguments are exchanged; call simulate\(\)"):
        simulate(controller, swapped)
    with pytest.raises(OptionError, match=r"the arguments are exchanged; call record\(\)"):
        record(controller, swapped, tmp_path / "run.h5")


def test_metrics_of_a_path_say_how_to_load_it() -> None:
    path: Any = "a.h5"
    with pytest.raises(OptionError, match=r"a\.h5 is a path; give a Run: Run\.load\(path\)"):
        compute_metrics(path)


def test_a_controller_made_for_a_scenario_asks_for_its_insertion() -> None:
    scenario: Any = load_scenario("conical_helix", duration=0.1)
    said = r"make_controller\(\) needs an Insertion, got a Scenario; give scenario\.insertion\(\)"
    with pytest.raises(OptionError, match=said):
        make_controller("damped", scenario, 1e-3)


@pytest.mark.parametrize("change", ["trocar", "instrument", "obstacles", "angles_start", "arm"])
def test_a_controller_for_another_insertion_is_refused(change: str) -> None:
    scenario = load_scenario("conical_helix", "ur5", duration=0.1)
    controller = make_controller("dual_quaternion", scenario.insertion(), scenario.period)
    others: dict[str, Any] = {
        "trocar": dataclasses.replace(scenario.trocar, depth_range=(0.0, 0.3)),
        "instrument": dataclasses.replace(scenario.instrument, radius=0.004),
        "obstacles": (Sphere((0.0, 0.0, 0.0), 0.01),),
        "angles_start": (*scenario.angles_start[:-1], scenario.angles_start[-1] + 0.1),
        "arm": "ur10",
    }
    other = dataclasses.replace(scenario, **{change: others[change]})
    with pytest.raises(OptionError, match="another insertion"):
        simulate(other, controller)


def test_a_controller_for_other_joint_limits_is_refused() -> None:
    scenario = load_scenario("conical_helix", "ur5", duration=0.01, acceleration=5.0)
    own = dataclasses.replace(scenario, limits=None)
    made = {
        each: make_controller("hierarchical_qp", each.insertion(), each.period)
        for each in (scenario, own)
    }
    assert simulate(scenario, made[scenario]).acceleration_limit.tolist() == [5.0] * 6
    for mine, other in ((scenario, own), (own, scenario)):
        with pytest.raises(OptionError, match="arm has other joint limits than that of"):
            simulate(mine, made[other])


def test_a_controller_for_the_same_insertion_is_taken_wherever_continuous_joints_start() -> None:
    """Their angles go through cosine and sine, which may cost the last bit, or a whole turn."""
    rng, arm = np.random.default_rng(7), load_arm("kinova")
    continuous = np.isinf(arm.upper)
    assert continuous.any()
    for _ in range(20):
        start = arm.home + continuous * rng.uniform(-4.0, 4.0, arm.nv)
        scenario = dataclasses.replace(
            load_scenario("conical_helix", "kinova", duration=0.002),
            angles_start=tuple(start),
            trocar=Insertion.on_shaft(arm, Instrument(), start).trocar,
        )
        assert ran(scenario).scenario == scenario


@pytest.mark.parametrize(
    "answer",
    [None, Command(np.full(7, np.nan)), Command(np.zeros(3)), Command(np.zeros(7, dtype=int))],
    ids=["none", "nan", "short", "whole numbers"],
)
def test_a_wrong_answer_of_a_controller_is_refused_when_it_comes(answer: Any) -> None:
    scenario = load_scenario("conical_helix", duration=0.01)

    class Wrong(DualQuaternion):
        name = "wrong"

        def step(self, state: ArmState, reference: Reference) -> Command:
            return cast(Command, answer)

    with pytest.raises(InvalidCommand, match=r"controller 'wrong' answered .* at t = 0 s"):
        simulate(scenario, Wrong(scenario.insertion(), scenario.period))


def test_a_task_of_a_wrong_shape_is_refused_by_its_name_before_anything_moves() -> None:
    class Lopsided(Task):
        rows = 3

        def evaluate(self, state: ArmState, reference: Reference) -> Residual:
            return Residual(np.zeros(2), np.zeros((self.rows, 7)), np.zeros(2))

    class Narrow(Task):
        def evaluate(self, state: ArmState, reference: Reference) -> Residual:
            return Residual(np.zeros(2), np.zeros((2, 5)), np.zeros(2))

    class Empty(Task):
        def evaluate(self, state: ArmState, reference: Reference) -> Residual:
            return cast(Residual, None)

    scenario = load_scenario("conical_helix", duration=0.1)
    insertion = scenario.insertion()
    for task, message in (
        (Lopsided(), r"Lopsided: error \(2,\)"),
        (Narrow(), "'task'.* 5 "),
        (Empty(), r"step: Empty\.evaluate\(\) returned None, it must be a Residual"),
    ):
        made = HierarchicalQP(insertion, scenario.period, levels=[RcmTask(), task])
        with pytest.raises(InvalidProblem, match=message):
            simulate(scenario, made)


@pytest.mark.parametrize("error", [ZeroDivisionError, np.linalg.LinAlgError])
def test_an_error_in_the_first_step_is_refused_and_a_later_one_stops_the_arm(
    error: type[Exception],
) -> None:
    @dataclass(frozen=True, eq=False)
    class Failing(DualQuaternion):
        after: int = 0

        def _step(self, state: ArmState, reference: Reference) -> Command:
            steps.append(None)
            if len(steps) > self.after:
                raise error("no way")
            return super()._step(state, reference)

    scenario = load_scenario("conical_helix", duration=0.01)
    steps: list[None] = []
    with pytest.raises(InvalidProblem, match=rf"a single step: {error.__name__}: no way"):
        simulate(scenario, Failing(scenario.insertion(), scenario.period))
    steps.clear()
    run = simulate(scenario, Failing(scenario.insertion(), scenario.period, after=4))
    assert run.stops == {f"{error.__name__}: no way": list(range(4, 11))}


def test_a_stop_that_is_no_error_may_be_the_first() -> None:
    class Waiting(DualQuaternion):
        def _step(self, state: ArmState, reference: Reference) -> Command:
            return self.safe_stop(state, "the QP has no solution: not yet")

    scenario = load_scenario("conical_helix", duration=0.01)
    run = simulate(scenario, Waiting(scenario.insertion(), scenario.period))
    assert len(run.stops["the QP has no solution: not yet"]) == scenario.cycles


def test_a_view_deeper_than_the_shaft_is_long_is_refused_with_its_time() -> None:
    scenario = load_scenario("conical_helix", period=0.01)
    deep = dataclasses.replace(scenario, path=ConicalHelix(pitch=0.1))
    made = make_controller("dual_quaternion", deep.insertion(), 0.01, velocity_limit="scale")
    with pytest.raises(InsertionError, match=r"at t = \d+\.\d+ s .* only 330\.0 mm long"):
        simulate(deep, made)


def test_recorded_poses_have_continuous_signs() -> None:
    scenario = load_scenario("view_steps", period=0.01)
    run = simulate(scenario, make_controller("dual_quaternion", scenario.insertion(), 0.01))
    assert (np.sum(run.x[1:, :4] * run.x[:-1, :4], axis=1) > 0).all()
    assert (np.sum(run.x[:, :4] * run.x_d[:, :4], axis=1) > 0).all()
    with pytest.raises(ValueError, match="read-only"):
        run.v[0] = 0.0
