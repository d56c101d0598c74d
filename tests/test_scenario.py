"""Scenarios: frozen data, by name, from files, and what is refused."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import assert_allclose, shaft_distance

from rcmqp import (
    Arm,
    Insertion,
    Instrument,
    RcmqpError,
    Scenario,
    ViewCommand,
    arm_names,
    load_arm,
    load_scenario,
    scenario_names,
    view_pose,
)
from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.dualquaternion import Array, P, quaternion_mul, to_se3
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
    ViewMoves,
    ViewSteps,
)
from rcmqp.references.paths import Path as ViewPath
from rcmqp.references.planner import plan
from rcmqp.runs.scenario import PIVOT_VELOCITIES
from rcmqp.world.arm_limits import ArmLimits
from rcmqp.world.instrument import Vector3
from rcmqp.world.motions import MOTIONS, Breathing, Motion, Sampled, Sinusoid, Still
from rcmqp.world.obstacles import Sphere

every_scenario = pytest.mark.parametrize("name", scenario_names())
on_every_arm = pytest.mark.parametrize("arm", arm_names())


@pytest.fixture(scope="module")
def helix() -> Scenario:
    return load_scenario("conical_helix", "lwa3")


def places(data: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where the numbers are in nested dictionaries and lists."""
    if isinstance(data, dict | list):
        items = data.items() if isinstance(data, dict) else enumerate(data)
        for key, value in items:
            yield from places(value, (*at, key))
    elif isinstance(data, float):
        yield at


def with_value(data: Any, at: tuple[Any, ...], value: Any) -> Any:
    """A deep copy with one place changed."""
    copy = json.loads(json.dumps(data))
    inner = copy
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return copy


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
    CameraTrial(Operator("novice"), CameraTask(side=0.04), Omega7(0.06), HandMapping(2.0), 9.0),
    Lissajous(size=(0.01, 0.02, 0.0)),
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


# What the controller is told ---------------------------------------------------------------


def moving(how: str, **changes: Any) -> Scenario:
    motion = Sinusoid(amplitude=0.02, frequency=1.0, direction=(1.0, -2.0, 2.0), ramp=0.3)
    given = {"duration": 0.5, "motion": motion, "pivot_velocity": how, **changes}
    return load_scenario("conical_helix", **given)


def test_the_trocar_is_where_its_motion_takes_it() -> None:
    scenario = moving("measured")
    insertion = scenario.insertion()
    pivots = scenario.pivots()
    assert pivots.shape == (501, 3)
    assert np.array_equal(pivots[0], scenario.trocar.pivot)
    for k, reference in enumerate(scenario.references(insertion)):
        expected = np.array(scenario.trocar.pivot) + scenario.motion.position(k * 1e-3)
        assert_allclose(pivots[k], expected, rtol=0, atol=1e-15)
        assert_allclose(reference.pivot, expected, rtol=0, atol=1e-14)
        assert shaft_distance(to_se3(reference.x_d), pivots[k]) < 1e-14
    assert np.ptp(pivots, axis=0).max() > 0.01


def test_a_view_goes_along_with_the_trocar() -> None:
    still = moving("measured", motion=Still())
    scenario = moving("measured")
    pairs = zip(
        still.references(still.insertion()),
        scenario.references(scenario.insertion()),
        scenario.pivots() - still.pivots(),
        strict=True,
    )
    for plain, carried, offset in pairs:
        a, b = to_se3(plain.x_d), to_se3(carried.x_d)
        assert_allclose(a.rotation, b.rotation, rtol=0, atol=1e-15)
        assert_allclose(b.translation - a.translation, offset, rtol=0, atol=1e-14)


@pytest.mark.parametrize("planner_time", [None, 0.2])
def test_x_d_dot_is_the_derivative_of_x_d_on_a_moving_trocar(planner_time: float | None) -> None:
    """Central differences between cycles, which err by some T^2 / 6 of the third derivative."""
    scenario = moving("measured", planner_time=planner_time, period=5e-4)
    if planner_time:
        views = ((0.3, 0.2, 0.1, 0.02), (0.3, 0.2, 0.1, 0.02))
        scenario = dataclasses.replace(scenario, path=ViewSteps(views, dwell=1.0))
    T, references = scenario.period, list(scenario.references(scenario.insertion()))
    for k in range(1, len(references) - 1):
        if planner_time and abs(k * T - planner_time) < 3 * T:
            continue  # the plan stops at once
        rate = (references[k + 1].x_d - references[k - 1].x_d) / (2 * T)
        assert_allclose(references[k].x_d_dot, rate, rtol=0, atol=2e-6)


def test_a_measured_velocity_is_the_motions() -> None:
    scenario = moving("measured")
    for k, reference in enumerate(scenario.references(scenario.insertion())):
        assert np.array_equal(reference.pivot_dot, scenario.motion.velocity(k * 1e-3))


def test_an_estimated_velocity_is_the_way_since_the_last_cycle_over_the_period() -> None:
    scenario = moving("estimated")
    references = list(scenario.references(scenario.insertion()))
    assert not references[0].pivot_dot.any()
    for before, now in itertools.pairwise(references):
        assert_allclose(now.pivot_dot, (now.pivot - before.pivot) / 1e-3, rtol=0, atol=1e-11)


def test_an_unknown_velocity_is_told_as_zero() -> None:
    """In x_d_dot, too: it is that of the same view in a trocar that stands still."""
    scenario, measured = moving("unknown"), moving("measured")
    pairs = zip(
        scenario.references(scenario.insertion()),
        measured.references(measured.insertion()),
        strict=True,
    )
    for told, full in pairs:
        assert not told.pivot_dot.any()
        assert np.array_equal(told.x_d, full.x_d)
        drift = 0.5 * quaternion_mul([0.0, *full.pivot_dot], P(full.x_d))
        assert_allclose(told.x_d_dot[4:] + drift, full.x_d_dot[4:], rtol=0, atol=1e-15)


def test_a_trocar_that_jumps_takes_the_reference_along_at_once() -> None:
    """Ten centimetres in a cycle, as a tracker may report: no planner, no error; see Reference."""
    there: Vector3 = (0.0, 0.1, 0.0)
    jump = Sampled((0.0, 0.1, 0.101, 1.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), there, there))
    scenario = load_scenario("view_steps", motion=jump, duration=0.2)
    references = list(scenario.references(scenario.insertion()))
    gap = to_se3(references[101].x_d).translation - to_se3(references[100].x_d).translation
    assert_allclose(gap, there, rtol=0, atol=1e-3)


@pytest.mark.parametrize("how", PIVOT_VELOCITIES)
@pytest.mark.parametrize("planner_time", [None, 0.02])
def test_references_do_not_depend_on_how_many_are_made_at_once(
    how: str, planner_time: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = moving(how, duration=0.06, planner_time=planner_time)
    insertion, found = scenario.insertion(), []
    for block in (512, 7, 1):
        monkeypatch.setattr("rcmqp.runs.scenario.BLOCK", block)
        references = list(scenario.references(insertion))
        assert len(references) == scenario.cycles
        found.append([np.concatenate(dataclasses.astuple(reference)) for reference in references])
    assert np.array_equal(found[0], found[1])
    assert np.array_equal(found[0], found[2])


# By name and from files --------------------------------------------------------------------


def test_hyphens_are_as_good_as_underscores() -> None:
    assert load_scenario("conical-helix") == load_scenario("conical_helix")


def test_a_scenario_knows_the_arm_that_it_is_for(tmp_path: Path) -> None:
    assert load_scenario("six_joints").arm == "ur5"
    assert load_scenario("six_joints", "panda").arm == "panda"
    assert load_scenario("conical_helix").arm == "lwa3"
    file = tmp_path / "mine.py"
    file.write_text(
        "from rcmqp import load_scenario\n"
        "def scenario(arm, *, flange=None):\n"
        "    return load_scenario('conical_helix', arm, flange=flange)\n",
        encoding="utf-8",
    )
    assert load_scenario(str(file)).arm == "lwa3"


def test_changes_replace_fields(helix: Scenario) -> None:
    changed = load_scenario("conical_helix", "lwa3", period=8e-3, duration=1.0)
    assert changed == dataclasses.replace(helix, period=8e-3, duration=1.0)


def test_a_scenario_is_read_from_a_json_file(helix: Scenario, tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_text(helix.to_json(), encoding="utf-8")
    assert load_scenario(str(file)) == helix
    assert load_scenario(str(file), seed=3) == dataclasses.replace(helix, seed=3)


def test_a_scenario_is_made_by_a_python_file(helix: Scenario, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "from rcmqp import load_scenario\n"
        "def scenario(arm, *, flange=None):\n"
        "    return load_scenario('conical_helix', arm, flange=flange, seed=3)\n",
        encoding="utf-8",
    )
    assert load_scenario(str(file), "lwa3") == dataclasses.replace(helix, seed=3)


def test_a_scenario_works_on_any_urdf(helix: Scenario) -> None:
    urdf = str(load_arm("lwa3").urdf)
    scenario = load_scenario("conical_helix", urdf, flange="flange")
    assert scenario.insertion().arm.nv == 7
    assert Scenario.from_json(scenario.to_json()) == scenario


# Refusals ----------------------------------------------------------------------------------


def test_an_unknown_scenario_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownName, match="'conical_helx'; did you mean conical_helix"):
        load_scenario("conical-helx")


def test_an_unknown_field_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownName, match="'periods'; did you mean period"):
        load_scenario("conical_helix", periods=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": 0.0}, "period = 0.0"),
        ({"period": math.nan}, "period = nan"),
        ({"duration": -1.0}, "duration = -1.0"),
        ({"duration": math.inf}, "duration = inf"),
        ({"duration": 1e-4}, "shorter than one period"),
        ({"planner_time": 1e-3}, "two periods"),
        ({"planner_time": math.nan}, "planner_time = nan"),
        ({"planner_time": math.inf}, "planner_time = inf"),
        ({"angles_start": (math.nan,) * 7}, "angles_start"),
        ({"shaft_tolerance": math.nan}, "shaft_tolerance = nan"),
        ({"seed": -1}, "seed = -1"),
        ({"pivot_velocity": "guessed"}, "unknown pivot_velocity 'guessed'"),
        ({"obstacles": ((0.0, 0.0, 0.0),)}, "is no Sphere"),
    ],
)
def test_a_value_out_of_range_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises((OptionError, UnknownName), match=message):
        load_scenario("conical_helix", **change)


@pytest.mark.parametrize(
    ("centre", "radius", "message"),
    [
        ((0.0, 0.0, math.nan), 1.0, "centre = .* three finite numbers"),
        ((0.0, 0.0, 0.0), 0.0, "radius = 0.0 m, it must be positive"),
        ((0.0, 0.0, 0.0), math.inf, "radius = inf m"),
    ],
)
def test_a_sphere_that_makes_no_sense_is_refused(
    centre: Vector3, radius: float, message: str
) -> None:
    with pytest.raises(OptionError, match=message):
        Sphere(centre, radius)


@every_scenario
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_number_in_a_file_must_be_finite_wherever_it_stands(name: str, value: float) -> None:
    data = json.loads(load_scenario(name).to_json())
    taken = []
    for place in places(data):
        try:
            Scenario.from_json(json.dumps(with_value(data, place, value)))
            taken.append(place)
        except RcmqpError:
            pass
    assert not taken


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "JSONDecodeError"),
        ("{", "JSONDecodeError"),
        ("[]", "TypeError"),
        ("null", "TypeError"),
        ("{}", "KeyError: 'path'"),
        ('{"path": {}}', "KeyError: 'kind'"),
    ],
)
def test_a_text_that_is_no_scenario_is_refused_with_the_reason(text: str, reason: str) -> None:
    with pytest.raises(OptionError, match=f"this is not a scenario: {reason}"):
        Scenario.from_json(text)


@pytest.mark.parametrize("field", dataclasses.fields(Scenario), ids=lambda field: field.name)
def test_only_fields_with_a_default_may_be_missing(
    helix: Scenario, field: dataclasses.Field[Any]
) -> None:
    data = json.loads(dataclasses.replace(helix, limits=ArmLimits(jerk=9.0)).to_json())
    data.pop(field.name, None)  # a governor that is None is not written
    text = json.dumps(data)
    if field.default is field.default_factory is dataclasses.MISSING:
        with pytest.raises(OptionError, match=field.name):
            Scenario.from_json(text)
    else:
        assert getattr(Scenario.from_json(text), field.name) == getattr(helix, field.name)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("angles_start", 0.5),
        ("angles_start", "straight"),
        ("instrument", []),
        ("trocar", "navel"),
        ("path", "conical_helix"),
        ("duration", "long"),
        ("period", None),
        ("planner_time", "long"),
        ("shaft_tolerance", "tight"),
        ("seed", "lucky"),
        ("motion", "still"),
        ("motion", {"kind": ["still"]}),
        ("plant", 3.0),
        ("plant", {}),
        ("pivot_velocity", ["measured"]),
        ("obstacles", 3.0),
        ("obstacles", [[0.0, 0.0, 0.0]]),
    ],
)
def test_a_field_of_another_kind_is_refused(helix: Scenario, field: str, value: Any) -> None:
    text = json.dumps(with_value(json.loads(helix.to_json()), (field,), value))
    with pytest.raises((OptionError, UnknownName)):
        Scenario.from_json(text)


def test_a_field_that_does_not_exist_is_refused(helix: Scenario) -> None:
    data = json.loads(helix.to_json())
    places = [(), ("path",), ("trocar",), ("instrument",), ("instrument", "camera")]
    for place in [*places, ("motion",), ("plant",)]:
        with pytest.raises(OptionError, match="colour"):
            Scenario.from_json(json.dumps(with_value(data, (*place, "colour"), "blue")))


def test_an_unknown_kind_of_path_is_answered_with_the_nearest(
    helix: Scenario, tmp_path: Path
) -> None:
    text = helix.to_json().replace('"kind": "conical_helix"', '"kind": "conical_helx"')
    file = tmp_path / "scenario.json"
    file.write_text(text)
    with pytest.raises(UnknownName, match="path 'conical_helx'; did you mean conical_helix"):
        load_scenario(str(file))


@pytest.mark.parametrize(
    ("field", "kind", "given"),
    [("motion", "still", "stil"), ("plant", "kinematic", "kinetic")],
)
def test_an_unknown_kind_of_motion_or_plant_is_answered_with_the_nearest(
    helix: Scenario, field: str, kind: str, given: str
) -> None:
    text = helix.to_json().replace(f'"kind": "{kind}"', f'"kind": "{given}"')
    with pytest.raises(UnknownName, match=f"{field} '{given}'; did you mean {kind}"):
        Scenario.from_json(text)


@pytest.mark.parametrize("name", ["none.json", "none.py"])
def test_a_file_that_is_not_there_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=name):
        load_scenario(str(tmp_path / name))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("binary.json", b"\xff\xfe\x00"),
        ("cut.json", b'{"name": '),
        ("empty.py", b""),
    ],
)
def test_a_file_that_holds_no_scenario_is_refused(
    name: str, content: bytes, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(OptionError):
        load_scenario(str(tmp_path / name))


def test_a_folder_is_no_scenario(tmp_path: Path) -> None:
    (tmp_path / "folder.json").mkdir()
    with pytest.raises(OptionError, match="cannot read"):
        load_scenario(str(tmp_path / "folder.json"))


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
