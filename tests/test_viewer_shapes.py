"""Meshes on their way to the page: read, placed, coloured, smoothed."""

from __future__ import annotations

import itertools
from pathlib import Path

import collada
import numpy as np
import pinocchio as pin
import pytest
from helpers import assert_allclose
from test_urdf import urdf

from rcmqp import load_arm
from rcmqp.maths.dualquaternion import Array
from rcmqp.show.viewer.meshcat_ import GRAIN, NORMAL_GRAIN, smooth
from rcmqp.show.viewer.shapes import arm_parts
from rcmqp.show.viewer.shapes import collada_triangles as triangles

QUAD = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="c"><lambert>
<diffuse><color>0.2 0.4 0.6 1</color></diffuse></lambert></technique></profile_COMMON></effect>
</library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 1 0 0 1 2 0 0 2 0</float_array>
<technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist material="painted" count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>4</vcount><p>0 1 2 3</p></polylist>
<triangles material="bare" count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 1 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><translate>0 0 5</translate>
<node><rotate>0 0 1 90</rotate><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="painted" target="#m"/></technique_common></bind_material>
</instance_geometry></node></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


def area(corners: Array) -> Array:
    a, b, c = np.moveaxis(corners, 1, 0)
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


@pytest.mark.parametrize("name", ["panda", "ur10"])  # triangles; polygons and nested nodes too
def test_colladas_triangles_lie_where_pinocchio_has_them(name: str) -> None:
    arm = load_arm(name)
    assert arm.urdf is not None
    folders = [str(folder) for folder in arm.urdf.resolve().parents]
    shapes = pin.buildGeomFromUrdf(
        pin.buildModelFromUrdf(str(arm.urdf)), str(arm.urdf), pin.VISUAL, package_dirs=folders
    ).geometryObjects
    assert len(shapes) > 6
    for shape in shapes:
        found = np.concatenate(list(triangles(Path(shape.meshPath), shape.meshScale).values()))
        mesh = shape.geometry
        rows = [mesh.tri_indices(i) for i in range(mesh.num_tris)]
        known = mesh.vertices()[[[row[0], row[1], row[2]] for row in rows]]
        for bound in (np.min, np.max):
            assert_allclose(bound(found, (0, 1)), bound(known, (0, 1)), rtol=0, atol=1e-6)
        assert area(found).sum() == pytest.approx(area(known).sum(), rel=1e-4)
        middles = [each.mean(1).T @ area(each) / area(each).sum() for each in (found, known)]
        assert_allclose(middles[0], middles[1], rtol=0, atol=1e-5)


def test_a_collada_file_keeps_its_unit_nodes_polygons_and_colours(tmp_path: Path) -> None:
    file = tmp_path / "quad.dae"
    file.write_text(QUAD)
    found = triangles(file, np.array([2.0, 1.0, 1.0]))
    assert set(found) == {(0.2, 0.4, 0.6), None}
    painted, bare = found[0.2, 0.4, 0.6], found[None]
    assert_allclose(painted.reshape(-1, 3).min(0), [-0.04, 0.0, 0.05], atol=1e-8)
    assert_allclose(painted.reshape(-1, 3).max(0), [0.0, 0.01, 0.05], atol=1e-8)
    assert len(painted) == 2
    assert_allclose(bare, [[[0, 0, 0.05], [0, 0.01, 0.05], [-0.04, 0, 0.05]]], atol=1e-8)


def test_a_ball_is_smooth_and_its_points_are_shared() -> None:
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 61), np.linspace(0, np.pi, 31), indexing="ij")
    grid = 0.1 * np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    corners = np.stack([np.stack([a, b, c], 2), np.stack([a, c, d], 2)]).reshape(-1, 3, 3)
    ball = smooth(corners)
    assert len(ball.points) == 60 * 29 + 2
    assert len(ball.faces) == 2 * 60 * 30 - 2 * 60  # those at the poles have no area
    assert_allclose(ball.normals, ball.points / 0.1, atol=NORMAL_GRAIN + 0.01)
    kept = corners[area(corners) > 1e-9]
    assert_allclose(ball.points[ball.faces], kept, rtol=0, atol=GRAIN)


@pytest.mark.parametrize(("degrees", "points"), [(30.0, 4), (40.0, 6)])
def test_facets_share_points_up_to_an_edges_angle(degrees: float, points: int) -> None:
    turn = pin.utils.rotate("y", np.radians(degrees))
    left = np.array([[0, 0, 0], [0, 1, 0], [-1, 0, 0]], dtype=float)
    right = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) @ turn.T
    assert len(smooth(np.array([left, right])).points) == points


def test_a_box_keeps_its_edges() -> None:
    corners = []
    for axis, side in itertools.product(range(3), (-1.0, 1.0)):
        square = np.full((4, 3), side)
        square[:, [(axis + 1) % 3, (axis + 2) % 3]] = [[-1, -1], [1, -1], [1, 1], [-1, 1]]
        square = square if side > 0 else square[::-1]
        corners += [square[[0, 1, 2]], square[[0, 2, 3]]]
    box = smooth(np.array(corners))
    assert len(box.points) == 24
    assert np.array_equal(np.sort(np.abs(box.normals), axis=1), np.tile([0.0, 0.0, 1.0], (24, 1)))
    assert (np.sum(box.normals * box.points, axis=1) > 0.0).all()


@pytest.mark.parametrize("ending", ["stl", "dae"])
@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (1, -2, 1), (-1, -1, -1), (-1, -1, 1)])
def test_triangles_of_a_mirrored_mesh_still_face_outwards(
    tmp_path: Path, ending: str, scale: tuple[int, int, int]
) -> None:
    """A tetrahedron about the origin: each normal points away from it."""
    points = 0.05 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    file = tmp_path / f"mesh.{ending}"
    if ending == "stl":
        corners = ["".join(f"vertex {x} {y} {z}\n" for x, y, z in points[face]) for face in faces]
        loops = (f"facet normal 0 0 0\nouter loop\n{each}endloop\nendfacet\n" for each in corners)
        file.write_text(f"solid s\n{''.join(loops)}endsolid s\n")
    else:
        mesh = collada.Collada()
        source = collada.source.FloatSource("p", points.ravel(), ("X", "Y", "Z"))
        geometry = collada.geometry.Geometry(mesh, "g", "g", [source])
        inputs = collada.source.InputList()
        inputs.addInput(0, "VERTEX", "#p")
        geometry.primitives.append(geometry.createTriangleSet(faces.ravel(), inputs, ""))
        mesh.geometries.append(geometry)
        node = collada.scene.Node("n", children=[collada.scene.GeometryNode(geometry, [])])
        mesh.scenes.append(collada.scene.Scene("s", [node]))
        mesh.scene = mesh.scenes[0]
        with file.open("wb") as stream:
            mesh.write(stream)
    visual = f'<mesh filename="{file.name}" scale="{" ".join(map(str, scale))}"/>'
    visual = f"<visual><geometry>{visual}</geometry></visual>"
    shaped = urdf().replace('<link name="l3"/>', f'<link name="l3">{visual}</link>')
    (tmp_path / "r.urdf").write_text(shaped)
    (part,) = arm_parts(load_arm(tmp_path / "r.urdf", "l7", home=[0.3] * 7))
    attributes = part.data["geometries"][0]["data"]["attributes"]
    position, normal = (
        np.frombuffer(bytes(attributes[name]["array"].data), "<f4").reshape(-1, 3)
        for name in ("position", "normal")
    )
    assert len(position) == 12
    assert (np.sum(position * normal, axis=1) > 0.0).all()
