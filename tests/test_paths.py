from __future__ import annotations

import dataclasses
import inspect
import math
from typing import Any

import numpy as np
import oracles.paths
import pytest
from helpers import assert_allclose, derivative
from pinocchio.utils import rotate
from scipy.integrate import quad

from rcmqp import ViewCommand, view_pose
from rcmqp.errors import InvalidCommand, OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.hand import HandMapping
from rcmqp.references.paths import (
    PATHS,
    Circle,
    ConicalHelix,
    HandTrace,
    Lissajous,
    Path,
    Search,
    Shows,
    TipTrace,
    ViewMoves,
    ViewSteps,
    views_of,
)
from rcmqp.world.obstacles import Sphere

TIP_DEPTH = 0.1
STEPS = ViewSteps(views=((0.0, 0.0, 0.0, 0.0), (0.1, -0.2, 0.3, 0.04)), dwell=0.5)
MOVES = ViewMoves(views=((0.1, -0.2, 0.3, 0.04), (-0.1, 0.0, 0.0, 0.0)), move=0.8, dwell=0.4)
SAMPLES: dict[str, Path] = {  # one of each path that is registered
    "circle": Circle(duration=3.0, ramp=0.9, turns=1.3),
    "conical_helix": ConicalHelix(duration=4.0, ramp=0.7),
    "hand_trace": HandTrace(
        (0.0, 1.0, 1.5, 2.5, 4.0),
        ((0, 0, 0), (0.02, -0.01, 0.01), (0.01, 0.01, 0.02), (0.0, 0.02, 0.04), (0.02, 0.0, 0.03)),
        (True, True, False, True, True),
        HandMapping(scale=1.5),
    ),
    "lissajous": Lissajous(size=(0.03, -0.02, 0.01), duration=4.0, ramp=1.1),
    "search": Search(((0.01, 0.0, 0.12),), (Sphere((0.01, 0.0, 0.16), 0.003),), duration=4.0),
    "tip_trace": TipTrace(
        (0.0, 1.0, 1.5, 2.5, 4.0),
        ((0, 0, 0), (0.02, -0.01, 0.01), (0.01, 0.01, 0.02), (0.0, 0.02, 0.04), (0.02, 0.0, 0.03)),
    ),
    "view_moves": MOVES,
    "view_steps": STEPS,
}
EVERY_PATH = pytest.mark.parametrize("name", sorted(PATHS))


def values(command: ViewCommand) -> Array:
    """(8,): angles and depth, then their rates."""
    return np.array(dataclasses.astuple(command))


# Every path --------------------------------------------------------------------------------


@EVERY_PATH
def test_every_path_is_tested_here_and_keeps_to_the_protocol(name: str) -> None:
    path = SAMPLES[name]
    assert type(path) is PATHS[name]
    assert isinstance(path, Path)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(path, next(iter(inspect.signature(PATHS[name]).parameters)), 1.0)


@pytest.mark.parametrize("path", [STEPS, MOVES], ids=["steps", "moves"])
def test_views_have_their_tips_as_targets_each_once(path: ViewSteps | ViewMoves) -> None:
    """A tip by rotation matrices: y turned by alpha, x by beta, then along z."""
    twice = dataclasses.replace(path, views=path.views + path.views)
    expected = []
    for alpha, beta, _, t_z in path.views:
        turned = rotate("y", alpha) @ rotate("x", beta)
        expected.append(turned @ np.array([0.0, 0.0, TIP_DEPTH + t_z]))
    assert isinstance(twice, Shows)
    assert twice.spheres == ()
    assert_allclose(twice.targets(TIP_DEPTH), expected, rtol=0, atol=1e-9)


def test_a_helix_shows_nothing() -> None:
    assert not isinstance(ConicalHelix(), Shows)


@EVERY_PATH
def test_rates_are_the_derivatives_of_the_views(name: str) -> None:
    rng = np.random.default_rng(7)
    path = SAMPLES[name]
    for t in rng.uniform(0.02, path.duration + 1.0, 60):

        def view(s: float, t: float = t) -> Array:
            return values(path.command(t + s, TIP_DEPTH))[:4]

        found = values(path.command(t, TIP_DEPTH))[4:]
        assert_allclose(found, derivative(view), rtol=0, atol=1e-9)


@EVERY_PATH
def test_a_block_of_views_is_that_of_its_commands_to_the_bit(name: str) -> None:
    path = SAMPLES[name]
    times = np.random.default_rng(7).uniform(0.0, path.duration + 1.0, 100)
    expected = [values(path.command(t, TIP_DEPTH)) for t in times.tolist()]
    assert np.array_equal(views_of(path, times, TIP_DEPTH), expected)


def test_a_drawn_path_that_leaves_the_trocar_is_refused() -> None:
    out = ConicalHelix(pitch=-0.05)
    with pytest.raises(InvalidCommand, match=r"tip at z = -.* must be inside"):
        out.views_at(np.array([0.0, out.duration]), TIP_DEPTH)
    with pytest.raises(InvalidCommand, match=r"tip at z = -.* must be inside"):
        out.command(out.duration, TIP_DEPTH)


@EVERY_PATH
def test_a_path_stays_at_rest_where_it_ended(name: str) -> None:
    path = SAMPLES[name]
    end = values(path.command(path.duration, TIP_DEPTH))
    assert not end[4:].any()
    for late in (1e-3, 1.0, 1e4):
        assert np.array_equal(values(path.command(path.duration + late, TIP_DEPTH)), end)


@EVERY_PATH
def test_a_path_starts_from_rest_at_the_view_of_the_start(name: str) -> None:
    """At zero exactly, or the start of a run would turn the endoscope."""
    start = values(SAMPLES[name].command(0.0, TIP_DEPTH))
    assert_allclose(start[:4], 0.0, rtol=0, atol=1e-15)
    assert not start[4:].any()


# The helix ---------------------------------------------------------------------------------


def progress(helix: ConicalHelix, t: float) -> float:
    """S at t by quadrature of s' as it is described: a smooth rise, constant, the same fall."""

    def speed(tau: float) -> float:
        u = min(tau / helix.ramp, (helix.duration - tau) / helix.ramp, 1.0)
        return 10 * u**3 - 15 * u**4 + 6 * u**5

    corners = [helix.ramp, helix.duration - helix.ramp]
    part, whole = (
        quad(speed, 0.0, end, points=[c for c in corners if c < end], epsabs=1e-14)[0]
        for end in (t, helix.duration)
    )
    return float(part / whole)


@pytest.mark.parametrize(
    "helix",
    [
        ConicalHelix(),
        ConicalHelix(radius_start=0.03, radius_end=0.0, pitch=-0.01, turns=1.5, duration=3.0),
        ConicalHelix(radius_start=0.0, turns=-2.0, duration=2.0, ramp=1.0),
    ],
    ids=["the paper's", "inwards and out", "from the axis"],
)
def test_the_tip_draws_the_helix_in_its_closed_form(helix: ConicalHelix) -> None:
    r_0, r_1, n, h = helix.radius_start, helix.radius_end, helix.turns, helix.pitch
    L = math.sqrt(TIP_DEPTH**2 - r_0**2)
    tilt = np.array([[L, 0, -r_0], [0, TIP_DEPTH, 0], [r_0, 0, L]]) / TIP_DEPTH
    for t in np.linspace(0.0, helix.duration, 37):
        s = progress(helix, t)
        r, turn = r_0 + (r_1 - r_0) * s, 2 * math.pi * n * s
        expected = tilt @ [r * math.cos(turn), r * math.sin(turn), L + n * h * s]
        view = dq.to_se3(view_pose(dq.IDENTITY, helix.command(t, TIP_DEPTH)).x_d)
        tip = view.act(np.array([0.0, 0.0, TIP_DEPTH]))
        assert_allclose(tip, expected, rtol=0, atol=1e-13)


def test_the_helix_starts_and_stops_without_a_jolt() -> None:
    straight = ConicalHelix(0.0, 0.0, pitch=0.04, turns=1.0, duration=2.0, ramp=0.5)
    for corner in (0.0, 0.5, 1.5, 2.0):  # of the speed profile

        def speed(t: float, corner: float = corner) -> float:
            return straight.command(corner + t, TIP_DEPTH).t_z_dot / straight.pitch

        assert_allclose(derivative(speed), 0.0, rtol=0, atol=1e-5)
    assert straight.command(-1.0, TIP_DEPTH) == ViewCommand()
    assert straight.command(9.0, TIP_DEPTH).t_z == pytest.approx(0.04, rel=1e-12)
    assert straight.command(9.0, TIP_DEPTH).t_z_dot == 0.0


def test_the_default_helix_is_20_s_at_20_mm_per_s_and_10_to_14_cm_deep() -> None:
    helix = ConicalHelix()
    tips, speeds = zip(
        *(oracles.paths.tip(helix, t, 0.1) for t in np.linspace(0, 20, 2001)), strict=True
    )
    assert np.sqrt(np.mean(np.sum(np.square(speeds), axis=1))) == pytest.approx(0.02, rel=0.05)
    depths = np.linalg.norm(tips, axis=1)
    assert depths.min() == pytest.approx(0.10, abs=0.001)
    assert depths.max() == pytest.approx(0.14, abs=0.005)


def test_a_helix_wider_than_deep_is_refused() -> None:
    with pytest.raises(OptionError, match=r"starts 10\.0 mm inside; a helix of radius 10\.0 mm"):
        ConicalHelix().command(0.0, 0.01)


@pytest.mark.parametrize("bad", [-0.01, math.nan, math.inf])
@pytest.mark.parametrize("field", ["radius_start", "radius_end"])
def test_a_helix_has_finite_radii_not_below_zero(field: str, bad: float) -> None:
    with pytest.raises(OptionError, match=rf"{field} = {bad} m, it must be finite and 0 or more"):
        ConicalHelix(**{field: bad})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pitch": math.nan}, "pitch = nan"),
        ({"turns": math.inf}, "turns = inf"),
        ({"ramp": 0.0}, "ramp = 0.0 s"),
        ({"ramp": math.nan}, "ramp = nan s"),
        ({"ramp": 1.1, "duration": 2.0}, "at most half of the duration"),
        ({"duration": math.inf}, "duration = inf s"),
    ],
)
def test_a_helix_has_sizes_that_make_sense(options: dict[str, float], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        ConicalHelix(**options)


# The circle and the figure of eight ---------------------------------------------------------


def shares(path: Circle | Lissajous, ramp: float) -> list[tuple[float, float]]:
    """Times, and how far a path of this ramp has come then: by symmetry and constant speed."""
    D = path.duration
    assert path.ramp == ramp
    cruise = 1.0 / (D - ramp)
    return [(0.0, 0.0), (ramp, cruise * ramp / 2), (D / 2, 0.5), (0.6 * D, 0.5 + 0.1 * D * cruise)]


def tip_in_start_axes(path: Path, t: float) -> Array:
    view = dq.to_se3(view_pose(dq.IDENTITY, path.command(t, TIP_DEPTH)).x_d)
    return np.array(view.act(np.array([0.0, 0.0, TIP_DEPTH])))


@pytest.mark.parametrize("circle", [Circle(), Circle(-0.03, turns=2.5, duration=5.0, ramp=0.5)])
def test_the_tip_draws_the_circle_in_its_closed_form(circle: Circle) -> None:
    r, n = circle.radius, circle.turns
    for t, s in shares(circle, circle.ramp):
        turn = 2 * math.pi * n * s
        expected = [r * math.cos(turn) - r, r * math.sin(turn), TIP_DEPTH]
        assert_allclose(tip_in_start_axes(circle, t), expected, rtol=0, atol=1e-14)


def test_the_tip_draws_the_figure_in_its_closed_form() -> None:
    path = Lissajous(size=(0.03, 0.02, 0.01), turns=2.0, duration=6.0, ramp=0.5)
    for t, s in shares(path, path.ramp):
        u = 4 * math.pi * s
        z = TIP_DEPTH + 0.01 * (math.cos(2 * u) - 1)
        expected = [0.03 * math.sin(u), -0.02 * math.sin(2 * u), z]
        assert_allclose(tip_in_start_axes(path, t), expected, rtol=0, atol=1e-14)


def test_circle_and_figure_close() -> None:
    for path in (Circle(), Lissajous(turns=3.0)):
        end = tip_in_start_axes(path, path.duration)
        assert_allclose(end, [0.0, 0.0, TIP_DEPTH], rtol=0, atol=1e-15)


def test_a_figure_that_would_come_out_of_the_trocar_is_refused() -> None:
    with pytest.raises(OptionError, match=r"10\.0 mm inside; a figure that comes out by 20\.0 mm"):
        Lissajous(size=(0.01, 0.01, 0.01)).command(0.0, 0.01)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"radius": math.nan}, "radius = nan"),
        ({"turns": math.inf}, "turns = inf"),
        ({"ramp": 5.0}, "at most half of the duration"),
        ({"duration": math.nan}, "duration = nan"),
    ],
)
def test_a_circle_has_sizes_that_make_sense(options: dict[str, float], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Circle(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (0.0, math.nan, 0.0)}, "size = .* three finite"),
        ({"size": (0.0, 0.0)}, "size = .* three finite"),
        ({"turns": math.nan}, "turns = nan"),
        ({"ramp": 0.0}, "the ramp must be positive"),
    ],
)
def test_a_figure_has_sizes_that_make_sense(options: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Lissajous(**options)


# The moves ---------------------------------------------------------------------------------


def test_moves_reach_each_view_and_hold_it() -> None:
    assert MOVES.duration == pytest.approx(2 * (0.8 + 0.4))
    for t, view in ((0.8, 0), (1.0, 0), (1.1999, 0), (2.0, 1), (2.4, 1)):
        assert_allclose(
            values(MOVES.command(t, TIP_DEPTH)), [*MOVES.views[view], 0, 0, 0, 0], atol=1e-15
        )


def test_a_move_is_half_way_at_half_of_its_time() -> None:
    for t, expected in ((0.4, [0.05, -0.1, 0.15, 0.02]), (1.6, [0.0, -0.1, 0.15, 0.02])):
        assert_allclose(values(MOVES.command(t, TIP_DEPTH))[:4], expected, atol=1e-15)


def test_a_move_starts_and_stops_without_a_jolt() -> None:
    for corner in (0.0, 0.8, 1.2, 2.0):

        def rates(t: float, corner: float = corner) -> Array:
            return values(MOVES.command(corner + t, TIP_DEPTH))[4:]

        assert_allclose(derivative(rates, 1e-5), 0.0, rtol=0, atol=1e-4)


def test_moves_without_a_dwell_do_not_stop_for_long() -> None:
    path = ViewMoves(views=MOVES.views, move=0.5, dwell=0.0)
    assert path.duration == 1.0
    assert_allclose(values(path.command(0.5, TIP_DEPTH)), [*MOVES.views[0], 0, 0, 0, 0])
    assert values(path.command(0.51, TIP_DEPTH))[4:].any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"views": ()}, r"views = \(\), it must be at least one"),
        ({"views": ((0.0, 0.0, 0.0, math.nan),)}, "views = .* finite numbers"),
        ({"views": ((0.0, 0.0),)}, r"view \(alpha, beta, gamma, t_z\)"),
        ({"views": MOVES.views, "move": 0.0}, "move = 0.0 s, it must be positive"),
        ({"views": MOVES.views, "move": math.inf}, "move = inf s"),
        ({"views": MOVES.views, "dwell": -1.0}, "dwell = -1.0 s, it must be finite and 0 or more"),
        ({"views": MOVES.views, "dwell": math.nan}, "dwell = nan s"),
    ],
)
def test_moves_that_make_no_sense_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        ViewMoves(**options)


# The steps ---------------------------------------------------------------------------------


def test_steps_hold_each_view_for_its_time() -> None:
    assert STEPS.duration == 2 * 0.5
    for t, view in ((0.0, 0), (0.49, 0), (0.5, 1), (0.99, 1), (1.0, 1)):
        assert STEPS.command(t, TIP_DEPTH) == ViewCommand(*STEPS.views[view])


def test_steps_hold_plain_tuples() -> None:
    array = np.array(STEPS.views)
    assert ViewSteps(views=array, dwell=0.5) == STEPS  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("views", "dwell", "message"),
    [
        ((), 1.0, r"views = \(\), it must be at least one"),
        (((0.0, 0.0, 0.0),), 1.0, r"view \(alpha, beta, gamma, t_z\)"),
        (((0.0, 0.0, 0.0, 0.0),), 0.0, "dwell = 0.0 s, it must be positive"),
        (((0.0, 0.0, 0.0, 0.0),), math.nan, "dwell = nan s"),
    ],
)
def test_steps_that_make_no_sense_are_refused(
    views: tuple[tuple[float, float, float, float], ...], dwell: float, message: str
) -> None:
    with pytest.raises(OptionError, match=message):
        ViewSteps(views, dwell)
