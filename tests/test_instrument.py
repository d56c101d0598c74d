from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from helpers import assert_allclose

from rcmqp import Camera, Instrument, Trocar
from rcmqp.errors import OptionError
from rcmqp.world.instrument import vector3

PIVOT, DOWN = (0.4, -0.1, 0.2), (0.0, 0.0, -1.0)


def test_tip_is_a_shaft_and_its_mount_from_the_flange() -> None:
    assert Instrument(length=0.3, mount_offset=0.05).tip == 0.3 + 0.05
    assert Instrument().tip == Instrument().length


def test_axis_of_a_trocar_is_made_a_unit_vector() -> None:
    axis = Trocar(PIVOT, (0.0, 3.0, -4.0)).axis
    assert_allclose(axis, [0.0, 0.6, -0.8], rtol=0, atol=1e-15)


def test_a_trocar_rebuilt_from_its_own_numbers_is_the_same_to_the_bit() -> None:
    rng = np.random.default_rng(7)
    for _ in range(100):
        trocar = Trocar(vector3("pivot", rng.normal(size=3)), vector3("axis", rng.normal(size=3)))
        assert Trocar(**dataclasses.asdict(trocar)) == trocar


def test_a_trocar_holds_plain_numbers() -> None:
    trocar = Trocar(
        np.array(PIVOT),  # type: ignore[arg-type]
        [0, 0, -1],  # type: ignore[arg-type]
        depth_range=[0, 1],  # type: ignore[arg-type]
    )
    assert trocar == Trocar(PIVOT, DOWN, depth_range=(0.0, 1.0))
    assert {type(value) for value in (*trocar.pivot, *trocar.axis, *trocar.depth_range)} == {float}


@pytest.mark.parametrize("data", [Camera(), Instrument(), Trocar(PIVOT, DOWN)], ids=repr)
def test_values_are_frozen_and_hashable(data: Camera | Instrument | Trocar) -> None:
    assert hash(data) == hash(dataclasses.replace(data))
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(data, dataclasses.fields(data)[0].name, 1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Camera(0.0), "field_of_view = 0.0 rad, it must be between 0 and 3.14"),
        (lambda: Camera(np.pi), "field_of_view"),
        (lambda: Camera(np.nan), "field_of_view = nan"),
        (lambda: Instrument(length=0.0), "length = 0.0 m, it must be positive"),
        (lambda: Instrument(length=np.inf), "length = inf"),
        (lambda: Instrument(radius=-0.005), "radius = -0.005"),
        (
            lambda: Instrument(mount_offset=-0.01),
            "mount_offset = -0.01 m, it must be finite and 0",
        ),
        (lambda: Instrument(mount_offset=np.nan), "mount_offset = nan"),
        (lambda: Trocar((0.0, 0.0), DOWN), "pivot = .* must be three finite numbers"),  # type: ignore[arg-type]
        (lambda: Trocar((0.0, 0.0, np.nan), DOWN), "pivot = .* must be three finite numbers"),
        (lambda: Trocar(PIVOT, (0.0, np.inf, 0.0)), "axis = .* must be three finite numbers"),
        (lambda: Trocar(PIVOT, (0.0, 0.0, 0.0)), "axis = .* not all zero"),
        (lambda: Trocar(PIVOT, DOWN, cone_half_angle=0.0), "cone_half_angle = 0.0"),
        (lambda: Trocar(PIVOT, DOWN, depth_range=(0.2, 0.2)), "the least and the largest"),
        (lambda: Trocar(PIVOT, DOWN, depth_range=(0.0, np.nan)), "the least and the largest"),
        (lambda: Trocar(PIVOT, DOWN, depth_range=(0.0, np.inf)), "both finite"),
    ],
)
def test_sizes_that_make_no_sense_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        make()
