"""Scenarios as data: equal, frozen, and the same from JSON."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose, every_scenario
from oracles.planner import plan

from rcmqp import (
    Arm,
    Insertion,
    Instrument,
    Scenario,
    ViewCommand,
    arm_names,
    load_arm,
    load_scenario,
    view_pose,
)
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array
from rcmqp.plants import PLANTS, Kinematic, Plant, Servo
from rcmqp.references.hand import HandMapping
from rcmqp.references.operators import STEERED, CameraTrial, Omega7, Operator, Steered
from rcmqp.references.operators.camera_task import CameraTask
from rcmqp.references.paths import (
    PATHS,
    Circle,
    ConicalHelix,
    HandTrace,
    Lissajous,
    Search,
    TipTrace,
    ViewMoves,
    ViewSteps,
)
from rcmqp.references.paths import Path as ViewPath
from rcmqp.world.arm_limits import ArmLimits
from rcmqp.world.motions import MOTIONS, Breathing, Motion, Sampled, Sinusoid, Still
from rcmqp.world.obstacles import Sphere

on_every_arm = pytest.mark.parametrize("arm", arm_names())


# Data --------------------------------------------------------------------------------------


@every_scenario
@on_every_arm
def test_json_makes_an_equal_scenario_again(name: str, arm: str) -> None:
    scenario = load_scenario(name, arm)
    again = Scenario.from_json(scenario.to_json())
    assert again == scenario
    assert hash(again) == hash(scenario)
    assert again.to_json() == scenario.to_json()


@every_scenario
@on_every_arm
def test_a_scenario_starts_with_the_shaft_in_the_trocar(name: str, arm: str) -> None:
    scenario = load_scenario(name, arm)
    assert scenario.name == name
    assert scenario.arm == arm
    insertion = scenario.insertion()
    offset = 5e-3 if name == "trocar_off_shaft" else 0.0
    assert abs(insertion.trocar_offset - offset) < 1e-12
    assert abs(insertion.tip_depth - 0.1) < 1e-12
    load_arm(arm).check_limits(scenario.angles_start)


@every_scenario
def test_scenarios_made_twice_are_equal_and_one_key(name: str) -> None:
    assert len({load_scenario(name), load_scenario(name), load_scenario(name, seed=1)}) == 2


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(Scenario)])
def test_a_scenario_is_frozen(helix: Scenario, field: str) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(helix, field, None)


def test_ints_and_lists_become_plain_floats_and_tuples(helix: Scenario) -> None:
    changed = dataclasses.replace(helix, angles_start=[0, 1, 0, 1, 0, 1, 0])  # type: ignore[arg-type]
    assert changed.angles_start == (0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0)
    assert all(type(angle) is float for angle in changed.angles_start)


VIEWS = ((0.1, 0.2, 0.3, 0.04),)
KINDS: list[ViewPath | Steered | Motion | Plant] = [  # one of each, no number as it is by default
    Circle(radius=0.02),
    ConicalHelix(turns=2.0),
    HandTrace((0.0, 1.0), ((0.0, 0.0, 0.0), (0.01, 0.0, 0.0)), (True, False), HandMapping(0.5)),
    TipTrace((0.0, 1.0), ((0.0, 0.0, 0.0), (0.01, 0.0, 0.0))),
    CameraTrial(Operator("novice"), CameraTask(side=0.04), Omega7(0.06), HandMapping(2.0), 9.0),
    Lissajous(size=(0.01, 0.02, 0.0)),
    Search(
        ((0.01, 0.0, 0.12),),
        (Sphere((0.01, 0.0, 0.16), 0.003),),
        Sphere((0.0, 0.02, 0.15), 0.006),
        tolerance=0.002,
        instructions="Look at it.",
        duration=90.0,
    ),
    ViewMoves(VIEWS, dwell=0.0),
    ViewSteps(VIEWS),
    Breathing(n=2, direction=(1.0, 2.0, 2.0)),
    Sampled((0.0, 0.5, 2.0), ((0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 0.0, 0.02))),
    Sinusoid(frequency=1.0),
    Still(),
    Kinematic(),
    Servo(delay=3, counts_per_turn=4096, noise=1e-4, velocity_saturation=True),
]


@pytest.mark.parametrize("thing", KINDS, ids=lambda thing: type(thing).__name__)
def test_every_kind_of_path_motion_and_plant_survives_json(
    helix: Scenario, thing: ViewPath | Steered | Motion | Plant
) -> None:
    field = "path" if type(thing) in {*PATHS.values(), *STEERED.values()} else "motion"
    field = "plant" if type(thing) in PLANTS.values() else field
    scenario = dataclasses.replace(helix, **{field: thing})  # type: ignore[arg-type]
    again = Scenario.from_json(scenario.to_json())
    assert getattr(again, field) == thing
    assert again == scenario
    assert hash(again) == hash(scenario)


def test_every_kind_is_in_the_test_above() -> None:
    registered = {
        *PATHS.values(),
        *STEERED.values(),
        *MOTIONS.values(),
        *PLANTS.values(),
    }
    assert {type(thing) for thing in KINDS} == registered


def test_obstacles_survive_json(helix: Scenario) -> None:
    spheres = (Sphere((0.1, 0.2, 0.3), 0.02), Sphere((1, 2, 3), 1))
    scenario = dataclasses.replace(helix, obstacles=list(spheres))  # type: ignore[arg-type]
    assert scenario.obstacles == spheres
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert scenario.insertion().obstacles == spheres


def test_a_scenario_of_an_earlier_version_is_still_read(helix: Scenario) -> None:
    """Word for word what version 0.1 wrote, but for the trocar's digits."""
    trocar = json.dumps(dataclasses.asdict(helix.trocar))
    text = (
        '{"name": "conical_helix", "arm": "lwa3", "angles_start": [0.0, 0.35, 0.0, 1.32, 0.0, '
        '1.55, 1.5708], "instrument": {"length": 0.33, "radius": 0.005, "mount_offset": 0.0, '
        '"camera": {"field_of_view": 1.2217304763960306}}, "trocar": ' + trocar + ", "
        '"path": {"kind": "conical_helix", "radius_start": 0.01, "radius_end": 0.03, "pitch": '
        '0.013333333333333334, "turns": 3.0, "duration": 20.0, "ramp": 1.0}, "duration": 20.0, '
        '"period": 0.001, "flange": null, "planner_time": null, "shaft_tolerance": 1e-06, '
        '"seed": 0}'
    )
    assert Scenario.from_json(text) == helix


@pytest.mark.parametrize(
    ("duration", "period", "cycles"),
    [(20.0, 1e-3, 20001), (20.0, 8e-3, 2501), (0.3, 0.1, 4), (0.1, 0.1, 2)],
)
def test_cycles_count_both_ends(
    helix: Scenario, duration: float, period: float, cycles: int
) -> None:
    assert dataclasses.replace(helix, duration=duration, period=period).cycles == cycles


def test_the_planner_divides_its_time_into_parts_of_one_period(helix: Scenario) -> None:
    x_rcm = helix.insertion().x_rcm
    planner = dataclasses.replace(helix, planner_time=1.5, period=8e-3).planner(x_rcm)
    assert planner is not None
    assert planner.points + 1 == 188  # 1.5 s / 8 ms = 187.5
    assert planner.period == 8e-3
    assert helix.planner(x_rcm) is None


def test_a_plan_starts_at_the_measured_pose_where_the_scenario_says_so() -> None:
    path = ViewSteps(views=((0.0, 0.0, 0.0, 0.0), (0.3, 0.0, 0.0, 0.0)), dwell=0.1)
    usual = Scenario.on_shaft("s", "panda", path, period=0.01, planner_time=0.5, duration=1.0)
    insertion = usual.insertion()
    behind = insertion.state(insertion.arm.configuration(insertion.angles_start + 0.01))

    def asked(planner_from: str) -> Array:
        scenario = dataclasses.replace(usual, planner_from=planner_from)
        references = scenario.references(insertion)
        made = [next(references), *(references.send(behind) for _ in range(20))]
        return np.array([reference.x_d for reference in made])

    usual_way, from_measured = asked("reference"), asked("measured")
    start = int(np.argmax((usual_way != from_measured).any(axis=1)))
    assert 5 < start < 15
    view = view_pose(insertion.x_rcm, ViewCommand(alpha=0.3)).x_d
    for begin, fed in ((insertion.x_rcm, usual_way), (behind.x, from_measured)):
        expected = plan(insertion.x_rcm, begin, view, 49)[1:]
        assert_allclose(fed[start:], expected[: len(fed) - start], rtol=0, atol=1e-12)


def test_where_a_plan_starts_is_kept_in_files_and_a_wrong_word_refused(helix: Scenario) -> None:
    assert "planner_from" not in helix.to_json()  # digests of earlier runs stay
    measured = dataclasses.replace(helix, planner_from="measured")
    assert Scenario.from_json(measured.to_json()) == measured
    with pytest.raises(UnknownName, match="did you mean measured"):
        dataclasses.replace(helix, planner_from="mesured")


def test_a_scenario_on_the_shaft_is_what_its_parts_make_by_hand(helix: Scenario) -> None:
    assert Scenario.on_shaft("conical_helix", "lwa3", ConicalHelix()) == helix
    angles = load_arm("lwa3").home + 0.1
    found = Scenario.on_shaft(
        "mine", "lwa3", Circle(), angles_start=angles, depth=0.08, duration=2.0, seed=5
    )
    assert found.angles_start == pytest.approx(tuple(angles), abs=1e-15)
    assert found.insertion().tip_depth == pytest.approx(0.08, abs=1e-14)
    assert (found.duration, found.seed, found.name) == (2.0, 5, "mine")


# Limits given by hand ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "limits",
    [
        {"acceleration": 8.0},
        {"acceleration": math.inf, "jerk": {"elbow_joint": 90.0}},
        {"velocity": 1.0, "position": (-3.0, 3.0)},
    ],
)
def test_limits_set_by_hand_come_along_into_the_scenario_and_its_file(
    limits: dict[str, Any],
) -> None:
    arm = load_arm("ur5", **limits)
    scenario = Scenario.of("mine", Insertion.on_shaft(arm, Instrument()), Circle())
    again = Scenario.from_json(scenario.to_json())
    assert again == scenario
    for made in (scenario.insertion().arm, again.insertion().arm):
        for name in ("lower", "upper", "velocity", "acceleration", "jerk"):
            assert np.array_equal(getattr(made, name), getattr(arm, name)), name
        assert made.assumed == arm.assumed
    assert scenario.has_limits_of(arm)
    assert not scenario.has_limits_of(load_arm("ur5"))
    assert not dataclasses.replace(scenario, limits=None).has_limits_of(arm)


def test_limits_that_were_confirmed_stay_so() -> None:
    arm = load_arm("ur5").confirmed()
    scenario = Scenario.of("mine", Insertion.on_shaft(arm, Instrument()), Circle())
    assert scenario.insertion().arm.assumed == frozenset()
    assert not scenario.has_limits_of(load_arm("ur5"))  # the same numbers, only assumed


def test_an_arm_as_it_came_leaves_no_limits_in_the_scenario(arm: Arm) -> None:
    scenario = Scenario.of("mine", Insertion.on_shaft(arm, Instrument()), Circle())
    assert scenario.limits is None
    assert "limits" not in json.loads(scenario.to_json())  # as in files of earlier versions
    assert scenario.has_limits_of(arm)


def test_scenarios_are_loaded_with_limits_of_ones_own(tmp_path: Path) -> None:
    limits = ArmLimits(velocity=0.4, jerk=50.0)
    scenario = Scenario.on_shaft("mine", "ur5", Circle(), limits=limits)
    assert scenario.limits == limits
    (tmp_path / "mine.json").write_text(scenario.to_json(), encoding="utf-8")
    read = load_scenario(str(tmp_path / "mine.json"), acceleration=[5.0] * 6)
    assert read.limits == ArmLimits(velocity=0.4, acceleration=(5.0,) * 6, jerk=50.0)
    made = load_scenario("conical_helix", "ur5", acceleration=8, jerk=400).insertion().arm
    assert made.acceleration.tolist() == [8.0] * 6
    assert made.jerk.tolist() == [400.0] * 6
    assert made.assumed == frozenset()


def test_limits_that_do_not_fit_are_refused(helix: Scenario) -> None:
    with pytest.raises(OptionError, match=r"limits = 8, it must be of type ArmLimits, or None"):
        dataclasses.replace(helix, limits=8)  # type: ignore[arg-type]
    with pytest.raises(OptionError, match=r"has shape \(6,\), the arm has 7 joints"):
        load_scenario("conical_helix", "lwa3", jerk=[1.0] * 6).insertion()
    text = helix.to_json()[:-1] + ', "limits": {"jerk": -3}}'
    with pytest.raises(OptionError, match=r"jerk = -3 rad/s\^3, it must be positive"):
        Scenario.from_json(text)
    with pytest.raises(OptionError, match=r"this is not a scenario: .*'snap'"):
        Scenario.from_json(text.replace("jerk", "snap"))
