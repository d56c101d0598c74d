"""The rendered image, against projections made without it."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose, random_placement
from matplotlib.path import Path as Outline

from rcmqp import Camera, load_scenario
from rcmqp.errors import OptionError
from rcmqp.experiments.study.figures import views
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array, from_se3, to_se3
from rcmqp.references.operators import CameraTrial
from rcmqp.references.view import view_pose
from rcmqp.show.labels import SPHERES
from rcmqp.world.camera import BACKGROUND, NOTHING, OUTSIDE, Pinhole, camera_pose, in_camera
from rcmqp.world.obstacles import Sphere


def silhouette(c: Array, radius: float, focal_length: float, size: int) -> Outline:
    """Outline [pixels] of a sphere at c (3,) in the camera's axes: its tangent circle, projected.

    A line through the camera touches the sphere where it is square to the radius.
    """
    distance = np.linalg.norm(c)
    share = (radius / distance) ** 2
    turn = np.linspace(0.0, 2.0 * np.pi, 1001)
    _, _, axes = np.linalg.svd(c[None, :])
    ring = np.cos(turn)[:, None] * axes[1] + np.sin(turn)[:, None] * axes[2]
    points = c * (1.0 - share) + radius * math.sqrt(1.0 - share) * ring
    return Outline(size / 2.0 + focal_length * points[:, :2] / points[:, 2:])


def middles(size: int) -> Array:
    """Middles (size * size, 2) of the pixels, rows first."""
    i = np.arange(size) + 0.5
    return np.stack(np.meshgrid(i, i), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("objective", [0, 1, 2, 3])
def test_a_target_view_shows_its_sphere_to_the_pixel_where_a_pinhole_projects_it(
    objective: int,
) -> None:
    """In the world of an arm, with Pinocchio's placements and the camera put there by hand."""
    scenario, size = load_scenario("camera_task", "meka_a2"), 200
    path, insertion = scenario.path, scenario.insertion()
    assert isinstance(path, CameraTrial)
    image = views(scenario, size)[objective + 1].reshape(-1, 3)

    start = to_se3(insertion.x_rcm)
    x, y, z = path.task.targets[objective]
    along = np.array([x, y, z]) / math.hypot(x, y, z)
    right = np.cross([0.0, 1.0, 0.0], along)  # no roll: the image's x stays level
    right /= np.linalg.norm(right)
    R = start.rotation @ np.column_stack([right, np.cross(along, right), along])
    camera = pin.SE3(R, start.act(np.array([x, y, z])))
    f = size / 2.0 / math.tan(scenario.instrument.camera.field_of_view / 2.0)
    sphere = path.task.spheres[objective]
    seen = camera.actInv(start.act(np.array(sphere.centre)))
    expected = silhouette(seen, sphere.radius, f, size).contains_points(middles(size))
    hue = image / np.maximum(image.sum(axis=1, keepdims=True), 1e-9)
    colour = np.array(SPHERES[objective])
    found = np.linalg.norm(hue - colour / colour.sum(), axis=1) < 1e-6
    assert found.sum() > 300
    assert np.array_equal(found, expected)


def test_the_first_view_shows_everything_and_a_target_view_only_its_own_sphere() -> None:
    scenario = load_scenario("camera_task", "panda")
    path = scenario.path
    assert isinstance(path, CameraTrial)
    pinhole, task = Pinhole(size=200), path.task
    shown = (*task.spheres, task.obstacle)
    for i, target in enumerate([(0.0, 0.0, 0.10), *task.targets]):
        view = path.mapping.view(path.mapping.way(target, 0.10), (0.0, 0.0, 0.0), 0.10)
        x_cam = camera_pose(view_pose(dq.IDENTITY, view).x_d, 0.10)
        assert_allclose(dq.translation(x_cam), target, rtol=0, atol=1e-15)
        index, _ = pinhole.seen(x_cam, shown)
        assert set(np.unique(index)) - {NOTHING, OUTSIDE} == (set(range(5)) if i == 0 else {i - 1})


def test_pixels_show_what_a_ray_meets_first() -> None:
    rng = np.random.default_rng(7)
    aMc = random_placement(rng)
    near, far = (Sphere(tuple(aMc.act(np.array([0.0, 0.0, z]))), 0.01) for z in (0.05, 0.08))
    behind = Sphere(tuple(aMc.act(np.array([0.0, 0.0, -0.05]))), 0.02)
    pinhole, middle = Pinhole(size=101), (50, 50)
    for spheres, expected in (((near, far), 0), ((far, near), 1), ((behind, far), 1)):
        index, facing = pinhole.seen(from_se3(aMc), spheres)
        assert index[middle] == expected
        assert facing[middle] == pytest.approx(1.0, abs=1e-12)
    assert (pinhole.seen(from_se3(aMc), [behind])[0] <= NOTHING).all()


def test_the_image_is_round_and_as_wide_as_the_field_of_view() -> None:
    pinhole = Pinhole(Camera(math.radians(60.0)), 99)
    index, _ = pinhole.seen(dq.IDENTITY, [])
    away = np.hypot(*(middles(99).T - 49.5)).reshape(99, 99)
    assert (index[away < 49.49] == NOTHING).all()
    assert (index[away > 49.51] == OUTSIDE).all()
    edge = pinhole.project([math.tan(math.radians(30.0)), 0.0, 1.0])
    assert_allclose(edge, [99.0, 49.5], rtol=0, atol=1e-12)
    assert np.isnan(pinhole.project([0.0, 0.0, -1.0])).all()


def test_a_point_is_seen_where_pinocchio_puts_it() -> None:
    rng = np.random.default_rng(7)
    aMc, point = random_placement(rng), rng.normal(size=3)
    assert_allclose(in_camera(from_se3(aMc), point), aMc.actInv(point), rtol=0, atol=1e-14)


def test_light_falls_from_the_camera() -> None:
    image = Pinhole(size=101).render(dq.IDENTITY, [Sphere((0.0, 0.0, 0.05), 0.01)], [(1, 1, 1)])
    row = image[50, :, 0]
    lit = np.flatnonzero(row > 0.4)
    assert row[50] == pytest.approx(1.0, abs=1e-3)
    assert (np.diff(row[lit[0] : 51]) >= 0.0).all()
    assert row[lit[0]] < 0.7


def test_each_sphere_has_its_colour_the_abdomen_its_own_and_the_outside_is_black() -> None:
    spheres = [Sphere((x, 0.0, 0.05), 0.004) for x in (-0.01, 0.01)]
    colours = [(0.9, 0.5, 0.1), (0.1, 0.6, 0.8)]
    pinhole = Pinhole(size=101)
    index, facing = pinhole.seen(dq.IDENTITY, spheres)
    image = pinhole.render(dq.IDENTITY, spheres, colours)
    for i, colour in enumerate(colours):
        row, column = np.argwhere(facing * (index == i) > 0.99)[0]
        assert_allclose(image[row, column], colour, rtol=0.01)
    for corner in ((0, 0), (0, 100), (100, 0), (100, 100)):
        assert image[corner].max() == 0.0
    assert max(BACKGROUND) > 0.1
    assert_allclose(image[[30, 50], [50, 50]], [BACKGROUND] * 2)


def test_an_image_without_pixels_is_refused() -> None:
    with pytest.raises(OptionError, match=r"size = 0.*whole number"):
        Pinhole(size=0)
