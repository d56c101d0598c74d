"""Right is right in the picture, for cameras that look aside and are rolled."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from at_the_device import QUICK, T
from helpers import assert_allclose

from rcmqp import Camera, Instrument, Scenario
from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.hand import DeviceState, HandMapping, HandView, ImageHand
from rcmqp.references.operators import CameraTrial
from rcmqp.references.operators.camera_task import CameraTask
from rcmqp.references.view import ViewCommand, view_pose
from rcmqp.runs.loading import load_scenario
from rcmqp.world.camera import Pinhole, camera_pose, in_camera
from rcmqp.world.insertion import Insertion

ROLLS = tuple(math.radians(float(roll)) for roll in range(-180, 181, 30))
ANGLES = (0.0, math.radians(30.0), math.radians(70.0))
DRAG = 1e-4
"""How far a hand is dragged [m]."""

Asking = Callable[[DeviceState], ViewCommand]


def scope(angle: float, roll: float) -> Instrument:
    return Instrument(camera=Camera(angle=angle, roll=roll))


@functools.cache
def straight() -> Scenario:
    return load_scenario("camera_task", "panda")


def insertion(angle: float, roll: float) -> Insertion:
    scenario = dataclasses.replace(straight(), instrument=scope(angle, roll))
    arm = straight().insertion().bare
    return Insertion(arm, scenario.instrument, scenario.trocar, scenario.angles_start)


def image_hand(there: Insertion) -> Asking:
    return ImageHand(there).ask


def hand_view(there: Insertion) -> Asking:
    return HandView(HandMapping(), there).ask


def pixels(there: Insertion, view: ViewCommand, point: Array) -> Array:
    """Where the picture of a view shows a point (3,) of the world."""
    camera = there.instrument.camera
    x_cam = camera_pose(view_pose(there.x_rcm, view).x_d, there.tip_depth, camera)
    return Pinhole(camera).project(in_camera(x_cam, point))


def content(there: Insertion, view: ViewCommand, away: float) -> Array:
    """A point (3,) of the world that the picture has in its middle, ``away`` [m] off."""
    camera = there.instrument.camera
    x_cam = camera_pose(view_pose(there.x_rcm, view).x_d, there.tip_depth, camera)
    return np.asarray(dq.to_se3(x_cam).act(np.array([0.0, 0.0, away])))


@pytest.mark.parametrize("hand", [image_hand, hand_view])
@pytest.mark.parametrize("angle", ANGLES)
def test_a_drag_moves_the_content_of_the_picture_the_other_way(
    hand: Callable[[Insertion], Asking], angle: float
) -> None:
    """To the right and downwards, at any roll of the camera, within a degree."""
    for roll, away in itertools.product(ROLLS, (0.03, 0.1)):
        there = insertion(angle, roll)
        for to in ((1.0, 0.0), (0.0, 1.0)):
            ask = hand(there)
            before = ask(DeviceState((0.0, 0.0, 0.0)))
            point = content(there, before, away)
            after = ask(DeviceState((DRAG * to[0], DRAG * to[1], 0.0)))
            moved = pixels(there, after, point) - pixels(there, before, point)
            off = math.atan2(moved[0] * to[1] - moved[1] * to[0], -float(moved @ to))
            assert abs(off) < math.radians(1.0)
            assert np.linalg.norm(moved) > 0.1


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("tilted", [(0.015, -0.01), (0.05, 0.04), (-0.04, 0.05)])
def test_after_a_roll_of_the_handle_and_elsewhere_right_is_still_right(
    angle: float, tilted: tuple[float, float]
) -> None:
    """The live hand; the view is tilted by up to thirty degrees, and rolled by the handle."""
    x, y = tilted
    for roll, away, to in itertools.product(
        ROLLS, (0.03, 0.1), ((1.0, 0.0), (0.0, 1.0), (0.6, 0.8))
    ):
        there = insertion(angle, math.radians(20.0))
        hand = ImageHand(there)
        hand.ask(DeviceState((0.0, 0.0, 0.0)))
        for share in np.linspace(0.0, 1.0, 8):  # a step that leads out of the cone is not taken
            before = hand.ask(DeviceState((share * x, share * y, 0.0), roll=share * roll))
        point = content(there, before, away)
        after = hand.ask(DeviceState((x + DRAG * to[0], y + DRAG * to[1], 0.0), roll=roll))
        moved = pixels(there, after, point) - pixels(there, before, point)
        off = math.atan2(moved[0] * to[1] - moved[1] * to[0], -float(moved @ to))
        assert abs(off) < math.radians(1.0)
        assert np.linalg.norm(moved) > 0.1


def test_a_straight_scope_stays_upright_and_one_that_looks_aside_does_not_spin() -> None:
    """On a wide circle of the hand; a spin is a turn about the shaft, from pose to pose."""
    for angle in ANGLES:
        there = insertion(angle, 0.0)
        hand, spins = ImageHand(there), [0.0]
        x = dq.to_se3(view_pose(there.x_rcm, hand.view).x_d)
        for turn in np.linspace(0.0, 2.0 * math.pi, 2000):
            place = (0.03 * math.sin(turn), 0.03 - 0.03 * math.cos(turn), 0.0)
            view = hand.ask(DeviceState(place))
            before, x = x, dq.to_se3(view_pose(there.x_rcm, view).x_d)
            spins.append(pin.log3(before.rotation.T @ x.rotation)[2])
        if angle:
            assert max(map(abs, spins)) < 1e-7
        else:
            assert view.gamma == 0.0


@pytest.mark.parametrize(
    ("angle", "roll"), [(30.0, 0.0), (30.0, -120.0), (70.0, 45.0), (0.0, 180.0)]
)
def test_an_operator_finds_the_views_with_a_scope_that_looks_aside(
    angle: float, roll: float
) -> None:
    """On a perfect arm; each objective shows its sphere near the middle of the picture."""
    chosen = scope(math.radians(angle), math.radians(roll))
    scenario = load_scenario("camera_task", "panda", instrument=chosen)
    there, path = insertion(chosen.camera.angle, chosen.camera.roll), scenario.path
    assert isinstance(path, CameraTrial)
    path = dataclasses.replace(path, operator=QUICK)
    asking, x, objective = path.start(there, T, 0), there.x_rcm, 0
    for k in range(round(120.0 / T)):
        view = asking.command(k * T, x)
        if asking.objective > objective:
            x_cam = camera_pose(x, there.tip_depth, chosen.camera)
            world = np.array(there.trocar.pivot) + there.from_start(
                path.task.spheres[objective].centre
            )
            seen = in_camera(x_cam, world)
            assert math.degrees(math.atan2(math.hypot(seen[0], seen[1]), seen[2])) < 20.0
            objective = asking.objective
        if view is None:
            break
        x = view_pose(there.x_rcm, view).x_d
    assert objective == 4


def test_a_task_whose_spheres_the_camera_looks_past_is_refused() -> None:
    there = insertion(math.radians(45.0), 0.0)
    with pytest.raises(OptionError, match=r"looks along \[0.0, 0.707, 0.707\].*out of the image"):
        CameraTrial().start(there, T, 0)


def test_a_camera_that_looks_along_the_shaft_leaves_the_task_as_it_was() -> None:
    """To the byte of the scenario's text: digests of earlier runs stay."""
    assert "towards" not in straight().to_json()
    again = load_scenario("camera_task", "panda", instrument=scope(0.0, 0.0))
    assert again == straight()
    aside = load_scenario("camera_task", "panda", instrument=scope(0.5, 0.0))
    assert Scenario.from_json(aside.to_json()) == aside
    assert isinstance(aside.path, CameraTrial)
    expected = np.array(CameraTask().targets[0]) + 0.035 * np.array(
        [0.0, math.sin(0.5), math.cos(0.5)]
    )
    assert_allclose(aside.path.spheres[0].centre, expected, rtol=0, atol=1e-15)
