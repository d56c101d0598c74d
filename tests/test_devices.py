"""From the hand to the view."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers import assert_allclose, derivative

from rcmqp import Insertion, load_arm
from rcmqp.errors import InvalidCommand, OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.hand import Clutch, DeviceState, HandMapping, HandView
from rcmqp.references.operators import Encoder, Omega7
from rcmqp.references.paths import HandTrace
from rcmqp.references.view import ViewCommand, view_pose
from rcmqp.world.instrument import Instrument, Vector3

DEPTH = 0.08
STILL = (0.0, 0.0, 0.0)


def tip(view: ViewCommand) -> Array:
    """Tip (3,) of a view in the axes of x_d(0), by Pinocchio."""
    placement = dq.to_se3(view_pose(dq.IDENTITY, view).x_d)
    return np.asarray(placement.act(np.array([0.0, 0.0, DEPTH])))


@pytest.mark.parametrize("scale", [0.5, 1.0, 3.0])
def test_the_tip_goes_where_the_hand_goes_at_every_depth(scale: float) -> None:
    """Right, down, in: each by scale times as much, to first order, wherever it starts."""
    mapping, h = HandMapping(scale), 1e-7
    for deep in (-0.02, 0.0, 0.05):
        at = tip(mapping.view((0.0, 0.0, deep / scale), STILL, DEPTH))
        for axis in range(3):
            way = [0.0, 0.0, deep / scale]
            way[axis] += h
            moved = tip(mapping.view((way[0], way[1], way[2]), STILL, DEPTH)) - at
            assert_allclose(moved / h, scale * np.eye(3)[axis], rtol=0, atol=1e-5)


def test_a_way_leads_to_its_tip() -> None:
    rng = np.random.default_rng(7)
    mapping = HandMapping(1.3)
    for _ in range(20):
        p = tuple(rng.uniform([-0.05, -0.05, 0.05], [0.05, 0.05, 0.15]))
        view = mapping.view(mapping.way((p[0], p[1], p[2]), DEPTH), STILL, DEPTH)
        assert view.gamma == 0.0
        assert_allclose(tip(view), p, rtol=0, atol=1e-15)


@pytest.mark.parametrize("deep", [0.03, -0.08])
def test_rates_are_derivatives_even_where_the_hand_pulls_the_tip_out(deep: float) -> None:
    mapping, velocity = HandMapping(1.2), (0.03, -0.02, 0.05)

    def view(t: float) -> ViewCommand:
        x, y, z = (p + t * v for p, v in zip((0.01, 0.02, deep), velocity, strict=True))
        return mapping.view((x, y, z), velocity, DEPTH)

    found = view(0.0)
    for name in ("alpha", "beta", "t_z"):

        def value(t: float, name: str = name) -> float:
            return float(getattr(view(t), name))

        slope = derivative(value, 1e-4)
        assert getattr(found, f"{name}_dot") == pytest.approx(float(slope), abs=1e-8)
    if deep < -0.07:
        assert found.t_z == pytest.approx(0.01 - DEPTH)  # and no further


def test_a_clutch_never_makes_the_view_jump() -> None:
    clutch = Clutch()
    assert clutch.step((5.0, 5.0, 5.0)) == STILL  # wherever it is taken up
    assert clutch.step((5.0, 6.0, 5.0)) == (0.0, 1.0, 0.0)
    assert clutch.step((7.0, 6.0, 5.0), engaged=False) == (0.0, 1.0, 0.0)
    assert clutch.step((9.0, 9.0, 9.0), engaged=True) == (0.0, 1.0, 0.0)
    assert clutch.step((9.0, 9.0, 8.5)) == (0.0, 1.0, -0.5)


def test_a_live_device_and_its_recorded_trace_ask_for_the_same_views() -> None:
    """The driver is any function that gives a DeviceState."""
    rng = np.random.default_rng(7)
    times = tuple(0.1 * k for k in range(12))
    positions: list[Vector3] = [tuple(p) for p in np.cumsum(rng.normal(0, 2e-3, (12, 3)), axis=0)]
    engaged = tuple(k not in (4, 5, 8) for k in range(12))
    trace = HandTrace(times, tuple(positions), engaged, HandMapping(1.5))
    inserted = Insertion.on_shaft(load_arm("panda"), Instrument(), depth=DEPTH)
    live = HandView(HandMapping(1.5), inserted)
    for t, position, on in zip(times, positions, engaged, strict=True):
        asked = live.ask(DeviceState(position, engaged=on))
        again = trace.command(t, inserted.tip_depth)
        for name in ("alpha", "beta", "gamma", "t_z"):
            assert getattr(again, name) == pytest.approx(getattr(asked, name), abs=1e-15)
    assert trace.duration == times[-1]
    still = live.ask(DeviceState(positions[-1], (1.0, 1.0, 1.0), engaged=False))
    assert (still.alpha_dot, still.beta_dot, still.t_z_dot) == STILL


def test_readings_are_as_coarse_as_the_device_and_velocity_is_their_difference() -> None:
    device, T = Omega7(resolution=1e-5), 1e-3
    encoder = Encoder(device, T)
    read = [encoder.read((0.02 * T * k, 0.0, -0.01 * T * k)) for k in range(200)]
    assert read[0].velocity == STILL
    for k, state in enumerate(read):
        assert abs(state.position[0] - 0.02 * T * k) <= 0.5e-5 + 1e-12
        assert math.remainder(state.position[0], 1e-5) == pytest.approx(0.0, abs=1e-12)
    velocity = np.array([state.velocity for state in read[20:]])
    assert_allclose(velocity - [0.02, 0.0, -0.01], 0.0, atol=1e-5 / 0.02)


def test_the_handle_stops_at_the_edge_of_its_workspace() -> None:
    device = Omega7(radius=0.075)
    assert device.reach((0.03, 0.04, 0.0)) == (0.03, 0.04, 0.0)
    assert_allclose(device.reach((0.06, 0.08, 0.0)), [0.045, 0.06, 0.0], atol=1e-15)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Omega7(radius=0.0), "radius = 0.0 m, it must be positive"),
        (lambda: Omega7(resolution=math.inf), "resolution = inf"),
        (lambda: Omega7(viscosity=41.0), "viscosity = 41.0 N s/m, it must be from 0 to 40"),
        (lambda: HandMapping(scale=0.0), "scale = 0.0, it must be positive"),
        (lambda: HandTrace((0.0, 1.0), (STILL, STILL), (True,)), "engaged: 1 for 2 samples"),
        (
            lambda: HandTrace((0.0, 1.0), (STILL, STILL), ("false", "true")),  # type: ignore[arg-type]
            "engaged: 'false', each must be true or false",
        ),
        (
            lambda: HandTrace((0.0, 1.0), (STILL, STILL), (), 1.5),  # type: ignore[arg-type]
            "mapping = 1.5, it must be of type HandMapping",
        ),
    ],
)
def test_a_device_that_makes_no_sense_is_refused(make: object, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        make()  # type: ignore[operator]


def test_a_handle_that_is_nowhere_is_refused() -> None:
    with pytest.raises(InvalidCommand, match="seven finite numbers"):
        DeviceState((math.nan, 0.0, 0.0))
