"""What a controller says it was given is true, and stands in a run's file."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest

from rcmqp import Insertion, Instrument, Run, load_arm, load_scenario, make_controller, simulate
from rcmqp.controllers import CONTROLLERS, Command, Controller, HierarchicalQP
from rcmqp.controllers.given import JOINT_LIMITS, UNKNOWN, Given
from rcmqp.controllers.settings import controller_of, every_setting
from rcmqp.controllers.stack import LevelOfTasks
from rcmqp.limits import JointLimits
from rcmqp.references.view import Reference, ViewCommand, view_pose
from rcmqp.runs.metrics import ROUNDING
from rcmqp.runs.setup import given_cells
from rcmqp.tasks import RcmTask
from rcmqp.world.arm import ArmState

T = 1e-3
SETTINGS = every_setting()


@pytest.fixture(scope="module")
def insertion() -> Insertion:
    return Insertion.on_shaft(load_arm("lwa3"), Instrument(), depth=0.10)


def made(setting: str, insertion: Insertion) -> Controller:
    name, options = controller_of(setting)
    return make_controller(name, insertion, T, **options)


def test_every_controller_of_ours_says_what_it_was_given(insertion: Insertion) -> None:
    assert {controller_of(setting)[0] for setting in SETTINGS} == set(CONTROLLERS)
    for setting in SETTINGS:
        given = made(setting, insertion).given
        assert given.feed_forward is not None
        assert given.limits is not None
        assert set(given.limits) <= set(JOINT_LIMITS)
        assert given.gain == 60.0


@pytest.mark.parametrize("setting", SETTINGS)
def test_a_law_with_feed_forward_knows_how_the_reference_moves_and_no_other_does(
    setting: str, insertion: Insertion
) -> None:
    controller = made(setting, insertion)
    state = insertion.state(insertion.q_start)
    commands = []
    for speed in (0.0, 0.01):  # [rad/s]
        controller.reset()
        reference = view_pose(insertion.x_rcm, ViewCommand(alpha_dot=speed))
        commands.append(controller.step(state, reference).v)
    knows = np.abs(commands[1] - commands[0]).max() > 1e-6
    assert knows == controller.given.feed_forward


@pytest.mark.parametrize("setting", SETTINGS)
def test_a_law_keeps_the_limits_of_the_first_step_that_it_says_it_enforces_and_no_others(
    setting: str, insertion: Insertion
) -> None:
    """The view jumps by 17 degrees, which no joint can follow."""
    controller, arm = made(setting, insertion), insertion.arm
    far = view_pose(insertion.x_rcm, ViewCommand(alpha=0.3))
    command = controller.step(insertion.state(insertion.q_start), far)
    assert not command.stop
    v = np.abs(command.v)
    ratios = {
        "speed": v / arm.velocity,
        "acceleration": v / T / arm.acceleration,
        "jerk": v / T**2 / arm.jerk,
    }
    kept = {name for name, ratio in ratios.items() if ratio.max() <= 1.0 + ROUNDING}
    assert kept == set(controller.given.limits or ()) - {"position"}


def test_a_hierarchy_of_ones_own_says_what_its_limits_and_levels_are(insertion: Insertion) -> None:
    arm = insertion.arm
    for limits, text in (
        ([], "none"),
        ([JointLimits(arm, T)], "all"),
        ([JointLimits(arm, T, acceleration=False)], "position and speed"),
    ):
        given = HierarchicalQP(insertion, T, limits=limits).given
        assert (given.limits_text, given.gain_text) == (text, "60")

    class OnlyRcm(HierarchicalQP):
        def default_levels(self) -> list[LevelOfTasks]:
            return [RcmTask(gain=5.0)]

    for law in (HierarchicalQP(insertion, T, levels=[RcmTask(gain=5.0)]), OnlyRcm(insertion, T)):
        assert (law.given.limits_text, law.given.gain_text) == ("all", "not said")
        assert "rcm_residual" in law.diagnostics
        assert "tip_residual" not in law.diagnostics


def test_a_law_of_ones_own_that_says_nothing_is_said_to_say_nothing(insertion: Insertion) -> None:
    @dataclass(frozen=True, eq=False)
    class Hold(Controller):
        def _step(self, state: ArmState, reference: Reference) -> Command:
            return Command(np.zeros(7))

    assert Hold(insertion, T).given == UNKNOWN
    assert UNKNOWN.feed_forward_text == UNKNOWN.limits_text == UNKNOWN.gain_text == "not said"


def test_a_file_keeps_what_was_given_and_an_earlier_one_does_not_say(tmp_path: Path) -> None:
    short = load_scenario("conical_helix", duration=0.02, period=0.008)
    law = "dual_quaternion:feed_forward=true,velocity_limit=scale,gain=30"
    name, options = controller_of(law)
    run = simulate(short, make_controller(name, short.insertion(), short.period, **options))
    run.save(tmp_path / "run.h5")
    assert Run.load(tmp_path / "run.h5").given == Given(True, ("speed",), "by scaling", 30.0, True)
    assert given_cells(Run.load(tmp_path / "run.h5").head) == {
        "feed_forward": "yes",
        "roll": "yes",
        "limits_enforced": "speed by scaling",
        "period_ms": "8",
        "gain": "30",
        "assumed": "jerk",
        "setup": "default",
    }
    with h5py.File(tmp_path / "run.h5", "r+") as file:
        del file.attrs["given"]
        file.attrs["digest"] = dataclasses.replace(run, given=UNKNOWN).digest
    assert Run.load(tmp_path / "run.h5").given == UNKNOWN


@pytest.mark.parametrize(
    "text",
    ["[1]", "null", "{", "{}", '{"limits": 5}', '{"limits": [[1]]}', '{"limits": ["x", 1]}'],
)
def test_what_to_json_does_not_write_is_a_value_error(text: str) -> None:
    with pytest.raises(ValueError, match=r"not what to_json|limits|Expecting"):
        Given.from_json(text)
