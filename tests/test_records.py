"""What compiled code makes for a cycle is what Python would have made."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from rcmqp import ArmState, Reference, load_arm
from rcmqp._kernel import all_finite, frozen, record
from rcmqp.controllers import Command
from rcmqp.errors import InvalidCommand


@pytest.mark.parametrize("kind", [ArmState, Reference, Command])
def test_a_record_is_what_its_constructor_makes(kind: type) -> None:
    names = [item.name for item in dataclasses.fields(kind)]
    values = [object() for _ in names]
    made: object = record(kind, *values)
    constructed = kind(*values)
    assert type(made) is kind
    for name, value in zip(names, values, strict=True):
        assert getattr(made, name) is getattr(constructed, name) is value
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(made, names[0], None)


def test_a_record_needs_every_field() -> None:
    with pytest.raises(TypeError, match=r"every field of .*Reference"):
        record(Reference, 1, 2, 3)
    with pytest.raises(AttributeError, match="__match_args__"):
        record(int, 1)


def test_a_record_keeps_what_it_is_made_of_and_lets_it_go() -> None:
    values = [object() for _ in dataclasses.fields(Reference)]
    before = [sys.getrefcount(value) for value in values]
    made = [record(Reference, *values) for _ in range(3)]
    assert [sys.getrefcount(value) for value in values] == [count + 3 for count in before]
    del made
    assert [sys.getrefcount(value) for value in values] == before


def test_a_record_is_of_a_dataclass_with_slots() -> None:
    @dataclasses.dataclass(frozen=True)
    class Loose:
        name: str = ""

    with pytest.raises(TypeError, match=r"Loose is no dataclass with slots"):
        record(Loose, "a")


def test_a_record_has_no_places_of_another_class_and_is_made_of_nothing_else() -> None:
    big: Any = type("Big", (), {"__slots__": tuple(f"s{i}" for i in range(40))})
    for place in (big.s39, type(lambda: 0).__closure__):  # type: ignore[attr-defined]
        fields = {"__slots__": ("x",), "__match_args__": ("a",), "a": place}
        with pytest.raises(TypeError, match="Stolen is no dataclass with slots"):
            record(type("Stolen", (), fields), 1)
    for base in (np.ndarray, Exception, tuple):  # zeros are none of these
        with pytest.raises(TypeError, match="Sub is no dataclass with slots"):
            record(type("Sub", (base,), {"__match_args__": ()}))


MANY_CLASSES = """
import dataclasses
from rcmqp._kernel import record

for k in range(40):
    names = [f"f{(7 * k + i) % 5}" for i in range(k % 4 + 1)]
    kind = dataclasses.make_dataclass(f"Kind{k}", names, frozen=True, slots=True)
    made = record(kind, *range(len(names)))
    assert [getattr(made, name) for name in names] == list(range(len(names)))
"""


def test_more_classes_than_are_remembered_have_their_own_fields() -> None:
    """In a process of its own: they would fill the places of all other tests."""
    subprocess.run([sys.executable, "-c", MANY_CLASSES], check=True)


def test_frozen_numbers_are_a_copy_that_cannot_be_written() -> None:
    mine = np.arange(12.0).reshape(3, 4)
    for values in (mine, np.asfortranarray(mine), mine.tolist(), mine.astype(np.float32)):
        copy = frozen(values, 3, 4)
        assert copy is not None
        assert np.array_equal(copy, mine)
        assert copy.dtype == np.float64
        assert copy.flags.c_contiguous
        assert not np.shares_memory(copy, mine)
        with pytest.raises(ValueError, match="read-only"):
            copy[0] = 0.0
    assert frozen(mine, 4, 3) is None
    assert frozen(mine, 12) is None
    with pytest.raises(ValueError, match="could not convert"):
        frozen(["north"], 1)


def test_numbers_are_all_finite_or_not() -> None:
    assert all_finite(np.array([1.0, -1e308]))
    for wrong in (np.nan, np.inf, -np.inf):
        assert not all_finite(np.array([0.0, wrong, 0.0]))
    assert all_finite([1.0, -2.0], 2.5)
    assert not all_finite([1.0, -2.0], 2.0)


@pytest.mark.parametrize("name", ["panda", "kinova"])
def test_a_step_of_the_joints_is_pinocchios_to_the_bit(name: str) -> None:
    arm, rng = load_arm(name), np.random.default_rng(3)
    for _ in range(20):
        q, v = arm.configuration(arm.random_angles(rng)), rng.normal(size=arm.nv)
        assert np.array_equal(arm.integrate(q, v, 1e-3), pin.integrate(arm.model, q, 1e-3 * v))


def test_a_step_of_joints_that_are_not_the_arms_is_refused() -> None:
    arm, six, seven = load_arm("panda"), np.zeros(6), np.zeros((7, 1))
    for q, v in ((arm.home, six), (six, six), (arm.home, seven)):
        with pytest.raises(InvalidCommand, match=r"must be \(7,\) and \(7,\)"):
            arm.integrate(q, v, 1e-3)
