"""Options: each is checked as it is declared, in one wording; and no frozen object is changed."""

from __future__ import annotations

import copy
import dataclasses
import importlib
import json
import math
import pickle
import pkgutil
import sys
from dataclasses import dataclass, field
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rcmqp.errors import OptionError, UnknownName
from rcmqp.maths.options import (
    Metadata,
    allowed,
    at_least,
    between,
    check,
    declared,
    finite,
    from_to,
    one_of,
    options,
    or_none,
    part,
    positive,
    rule,
    whole,
)

PACKAGE = Path(__file__).parents[1] / "rcmqp"


@options
@dataclass(frozen=True, slots=True)
class Ball:
    """Something with options."""

    centre: tuple[float, ...] = field(metadata=rule(lambda name, value: tuple(map(float, value))))
    radius: float = field(default=0.01, metadata=positive("m"))
    colour: str = "red"


@dataclass(frozen=True, slots=True)
class Unchecked:
    """Options that nothing checks on the way in."""

    mass: float = field(default=1.0, metadata=at_least(0.5, "kg"))


def test_values_are_kept_as_the_rules_return_them() -> None:
    ball = Ball([1, 2, 3], radius=2)  # type: ignore[arg-type]
    assert ball == Ball((1.0, 2.0, 3.0), 2)
    assert type(ball.centre) is tuple
    moved = dataclasses.replace(ball, centre=[0, 0, 0])  # type: ignore[arg-type]
    assert moved.centre == (0.0, 0.0, 0.0)
    assert pickle.loads(pickle.dumps(moved)) == copy.deepcopy(moved) == moved
    with pytest.raises(dataclasses.FrozenInstanceError):
        ball.radius = 1.0  # type: ignore[misc]


@pytest.mark.parametrize(
    "make",
    [
        lambda: Ball((0, 0, 0), -0.5),
        lambda: Ball((0, 0, 0), radius=-0.5),
        lambda: dataclasses.replace(Ball((0, 0, 0)), radius=-0.5),
    ],
    ids=["in order", "by name", "replaced"],
)
def test_every_way_in_is_checked_with_one_wording(make: Any) -> None:
    with pytest.raises(OptionError, match=r"^radius = -0\.5 m, it must be positive and finite$"):
        make()


def test_python_says_which_arguments_are_wrong() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'size'"):
        Ball((0, 0, 0), size=1)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="positional arguments"):
        Ball((0, 0, 0), 1.0, "red", 2)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'centre'"):
        Ball()  # type: ignore[call-arg]


def test_what_is_made_can_be_checked_too() -> None:
    check(Unchecked())
    with pytest.raises(OptionError, match=r"^mass = 0\.1 kg, it must be finite and 0\.5 or more$"):
        check(Unchecked(0.1))


@pytest.mark.parametrize(
    ("metadata", "good", "bad"),
    [
        (positive(), [1, 1e-300, np.float64(2.0)], [0, -1, math.inf]),
        (at_least(0.0), [0, 5.0], [-1e-300, math.inf]),
        (between(0.0, 1.0), [0.5, 1e-9], [0, 1, 2]),
        (from_to(0.0, 1.0), [0, 0.5, 1], [-1e-9, 2]),
        (finite(), [0, -1e300], [math.inf, -math.inf]),
        (whole(1), [1, 3.0, np.int64(7)], [0, 1.5, math.inf]),
        (part(Unchecked), [Unchecked()], [Ball((0, 0, 0)), None]),
    ],
    ids=["positive", "at_least", "between", "from_to", "finite", "whole", "part"],
)
def test_rules_refuse_what_they_must(metadata: Metadata, good: list[Any], bad: list[Any]) -> None:
    take = metadata["rule"]
    for value in good:
        assert take("x", value) == value
        assert or_none(metadata)["rule"]("x", value) == value
    assert or_none(metadata)["rule"]("x", None) is None
    for value in [*bad, math.nan, "1", True, [1.0], np.ones(2), 10**400]:
        with pytest.raises(OptionError, match=r"^x = .*, it must be "):
            take("x", value)


def test_rules_make_plain_values() -> None:
    assert type(whole(0)["rule"]("n", 3.0)) is int
    for value in (2, np.int64(2), 2.0, np.float32(2.0), np.float64(2.0)):  # as JSON takes them
        kept = positive()["rule"]("x", value)
        assert json.dumps(kept) == ("2" if isinstance(value, Integral) else "2.0")
    assert part(Unchecked)["rule"]("load", {"mass": 2.0}) == Unchecked(2.0)
    with pytest.raises(UnknownName, match="unknown colour 'gren'; did you mean green"):
        one_of("colour", ("red", "green"))["rule"]("paint", "gren")


@dataclass(frozen=True)
class Heavier(Unchecked):
    """Another default."""

    mass: float = 2.0


def test_a_derived_class_with_another_default_keeps_the_bounds() -> None:
    check(Heavier())
    with pytest.raises(OptionError, match=r"mass = 0\.1 kg"):
        check(Heavier(0.1))


def test_arguments_are_taken_by_the_same_rules() -> None:
    assert allowed("points", 3.0, whole(1)) == 3
    with pytest.raises(
        OptionError, match=r"^points = 0, it must be a whole number of at least 1$"
    ):
        allowed("points", 0, whole(1))


def with_rules() -> list[type]:
    """Every dataclass of the package that declares a rule."""
    for module in pkgutil.walk_packages([str(PACKAGE)], "rcmqp."):
        if module.name != "rcmqp.__main__" and "browser" not in module.name:
            importlib.import_module(module.name)
    objects = (
        x
        for name, module in [*sys.modules.items()]
        if name.startswith("rcmqp.")
        for x in vars(module).values()
    )
    kinds = {x for x in objects if isinstance(x, type) and dataclasses.is_dataclass(x)}
    return sorted((x for x in kinds if declared(x, "rule")), key=lambda x: x.__qualname__)


def test_defaults_are_what_the_rules_keep() -> None:
    kinds = with_rules()
    assert len(kinds) > 30
    for kind in kinds:
        rules = declared(kind, "rule")
        for item in dataclasses.fields(kind):
            if item.name in rules and item.default is not dataclasses.MISSING:
                kept = rules[item.name](item.name, item.default)
                assert (kept, type(kept)) == (item.default, type(item.default)), (kind, item.name)


def test_no_frozen_object_is_changed() -> None:
    found = {
        str(file.relative_to(PACKAGE))
        for file in PACKAGE.rglob("*.py")
        if "object.__setattr__" in file.read_text(encoding="utf-8")
    }
    assert not found
