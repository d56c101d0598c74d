"""A scenario as JSON, and read from JSON, which may come from anybody."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from rcmqp.errors import OptionError, RcmqpError, UnknownName
from rcmqp.plants import PLANTS
from rcmqp.references.governor import Governor
from rcmqp.references.operators import STEERED
from rcmqp.references.operators.camera_task import AHEAD
from rcmqp.references.paths import PATHS, Foreign
from rcmqp.runs.untrusted import shortened
from rcmqp.world.arm_limits import ArmLimits
from rcmqp.world.carried import CarriedArm
from rcmqp.world.instrument import Instrument, Mount, Trocar
from rcmqp.world.loading import arm_names
from rcmqp.world.motions import MOTIONS
from rcmqp.world.obstacles import Sphere
from rcmqp.world.plugins import Registry

if TYPE_CHECKING:
    from rcmqp.runs.scenario import Scenario

MOST_DIGITS = 300
"""Digits of a whole number: a float can hold it."""

KINDS: dict[str, tuple[Registry[Any], ...]] = {
    "path": (PATHS, STEERED),
    "motion": (MOTIONS,),
    "plant": (PLANTS,),
}
"""Fields of a scenario that are one of several kinds, and those kinds."""


PARTS: dict[str, Callable[[Any], Any]] = {
    "instrument": lambda data: Instrument(**data),
    "trocar": lambda data: Trocar(**data),
    "governor": lambda data: Governor(**data),
    "obstacles": lambda data: tuple(Sphere(**sphere) for sphere in data),
    "limits": ArmLimits.from_data,
    "carried_arm": CarriedArm.from_json,
}
"""Other fields that are made of several numbers, and how; the first two must be there."""


def written(scenario: Scenario, carry: bool) -> str:
    """The JSON of Scenario.to_json()."""
    data = dataclasses.asdict(dataclasses.replace(scenario, carried_arm=None))
    del data["limits"], data["carried_arm"]
    if scenario.governor is None:  # files of before there were governors say the same
        del data["governor"]
    _leave_out_straight(data["instrument"])
    if scenario.planner_from == "reference":  # likewise
        del data["planner_from"]
    if scenario.limits is not None:  # else as in files of earlier versions, whose digest stays
        data["limits"] = scenario.limits.to_data()
    if carry and scenario.carried_arm is not None and scenario.arm not in arm_names():
        data["carried_arm"] = scenario.carried_arm.to_json()
    for name in KINDS:
        if isinstance(scenario.path, Foreign) and name == "path":
            data[name] = {"kind": scenario.path.kind, **scenario.path.numbers}
            continue
        data[name] = {"kind": kind_of(name, getattr(scenario, name)), **data[name]}
    match data["path"]:
        case {"task": {"towards": towards}} if towards == AHEAD:  # likewise
            del data["path"]["task"]["towards"]
    return json.dumps(data, allow_nan=False)


def read(text: str, make: Callable[..., Scenario]) -> Scenario:
    """The scenario of Scenario.from_json(), made by ``make`` of its fields."""
    part = "its JSON"
    try:
        data = json.loads(text, parse_constant=_refuse, parse_int=_whole, parse_float=_finite)
        part = "path"
        path = data["path"]
        if not isinstance(path["kind"], str):
            raise TypeError(f"kind = {path['kind']!r:.50}, it must be text")
        known = any(path["kind"] in registry for registry in KINDS["path"])
        numbers = {name: value for name, value in path.items() if name != "kind"}
        data["path"] = _of_kind("path", path) if known else Foreign(path["kind"], numbers)
        for part in KINDS.keys() & data.keys() - {"path"}:
            data[part] = _of_kind(part, data[part])
        for part, take in PARTS.items():
            if part in ("instrument", "trocar") or data.get(part) is not None:
                data[part] = take(data[part])
        part = "its fields"
        return make(**data)
    except RcmqpError:
        raise
    except Exception as error:  # a damaged text can make Python raise almost any
        reason = f"{type(error).__name__}: {error}"
        raise OptionError(
            f"this is not a scenario: {shortened(reason, 300)} (in {part})"
        ) from error


def _leave_out_straight(instrument: dict[str, Any]) -> None:
    """Delete, in place, values that files of earlier versions do not have."""
    if instrument["mount"] == dataclasses.asdict(Mount()):
        del instrument["mount"]
    if instrument["wrist"] is None:
        del instrument["wrist"]
    for name in ("angle", "roll"):
        if instrument["camera"][name] == 0.0:
            del instrument["camera"][name]


def _of_kind(name: str, data: Mapping[str, Any]) -> Any:
    """Make a path, motion or plant from its numbers and its ``kind``."""
    options = dict(data)
    kind = options.pop("kind")
    for registry in KINDS[name]:
        if kind in registry:
            return registry[kind](**options)
    raise UnknownName(name, kind, itertools.chain(*KINDS[name]))


def kind_of(name: str, value: object) -> str | None:
    """The ``kind`` of a path, motion or plant; None if its class is in no registry."""
    kinds = (registry.name_of(type(value)) for registry in KINDS[name])
    return next(filter(None, kinds), None)


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant:.50} is not a number that a scenario can use")


def _whole(digits: str) -> int:
    if len(digits) > MOST_DIGITS:
        raise ValueError(f"{digits[:20]}... has {len(digits)} digits")
    return int(digits)


def _finite(digits: str) -> float:
    return number if math.isfinite(number := float(digits)) else _refuse(digits)
