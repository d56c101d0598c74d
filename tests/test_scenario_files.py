"""Scenarios by name and from files, and what is refused."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers import every_scenario

from rcmqp import RcmqpError, Scenario, load_arm, load_scenario
from rcmqp.errors import OptionError, UnknownName
from rcmqp.world.arm_limits import ArmLimits
from rcmqp.world.instrument import Vector3
from rcmqp.world.obstacles import Sphere


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
