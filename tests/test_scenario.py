"""Scenarios: frozen data, by name, from files, and what is refused."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rcmqp import RcmqpError, Scenario, arm_names, load_arm, load_scenario, scenario_names
from rcmqp.errors import OptionError, UnknownName
from rcmqp.paths import PATHS, ConicalHelix, ViewSteps
from rcmqp.paths import Path as ViewPath

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
    assert insertion.trocar_offset < 1e-12
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


@pytest.mark.parametrize("path", [ConicalHelix(turns=2.0), ViewSteps(((0.1, 0.2, 0.3, 0.04),))])
def test_every_kind_of_path_survives_json(helix: Scenario, path: ViewPath) -> None:
    scenario = dataclasses.replace(helix, path=path)
    assert Scenario.from_json(scenario.to_json()).path == path
    assert type(path) in PATHS.values()


def test_every_kind_of_path_is_in_the_test_above() -> None:
    assert set(PATHS) == {"conical_helix", "view_steps"}


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


# By name and from files --------------------------------------------------------------------


def test_hyphens_are_as_good_as_underscores() -> None:
    assert load_scenario("conical-helix") == load_scenario("conical_helix")


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
    ],
)
def test_a_value_out_of_range_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        load_scenario("conical_helix", **change)


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
    data = json.loads(helix.to_json())
    del data[field.name]
    text = json.dumps(data)
    if field.default is dataclasses.MISSING:
        with pytest.raises(OptionError, match=field.name):
            Scenario.from_json(text)
    else:
        assert getattr(Scenario.from_json(text), field.name) == field.default


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
    ],
)
def test_a_field_of_another_kind_is_refused(helix: Scenario, field: str, value: Any) -> None:
    text = json.dumps(with_value(json.loads(helix.to_json()), (field,), value))
    with pytest.raises(OptionError):
        Scenario.from_json(text)


def test_a_field_that_does_not_exist_is_refused(helix: Scenario) -> None:
    data = json.loads(helix.to_json())
    for place in ((), ("path",), ("trocar",), ("instrument",), ("instrument", "camera")):
        with pytest.raises(OptionError, match="colour"):
            Scenario.from_json(json.dumps(with_value(data, (*place, "colour"), "blue")))


def test_an_unknown_kind_of_path_is_answered_with_the_nearest(helix: Scenario) -> None:
    text = helix.to_json().replace('"kind": "conical_helix"', '"kind": "conical_helx"')
    with pytest.raises(UnknownName, match="path 'conical_helx'; did you mean conical_helix"):
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
