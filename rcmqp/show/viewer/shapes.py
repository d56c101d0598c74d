"""Shapes of an arm's links, from its URDF, as Meshcat takes them; nothing else imports collada."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import collada
import numpy as np
import pinocchio as pin
from collada.common import DaeError as Unreadable

from rcmqp.errors import ArmWarning
from rcmqp.maths.dualquaternion import Array
from rcmqp.show.viewer.meshcat_ import Triangles, smooth
from rcmqp.show.viewer.meshcat_ import geometry as g
from rcmqp.world.arm import Arm
from rcmqp.world.carried import changed_meshes
from rcmqp.world.geometry import geometry_of, hangs_on

Colour = tuple[float, float, float]
"""Red, green, blue from 0 to 1."""

IGNORED = [collada.common.DaeUnsupportedError, collada.common.DaeBrokenRefError]
"""What a file may have wrong, such as a picture that is missing."""


def collada_triangles(path: Path, scale: Array) -> dict[Colour | None, Array]:
    """A file's triangles of each colour, as its scene places them.

    The file's unit counts; its up axis does not, as elsewhere where URDFs are drawn. Its normals,
    and pictures on its faces, are left out.

    Args:
        path: of the file.
        scale: (3,) what the URDF multiplies points with.

    Returns:
        Corners (m, 3, 3) of each colour's triangles [m]; the colour is None if the file has none.

    Raises:
        Unreadable: this is not a Collada file, or a broken one.
    """
    file = collada.Collada(str(path), ignore=IGNORED)
    size = scale * (file.assetInfo.unitmeter or 1.0)
    found: dict[Colour | None, list[Array]] = {}
    for placed in file.scene.objects("geometry") if file.scene else ():
        for primitive in placed.original.primitives:
            if hasattr(primitive, "triangleset"):  # polygons
                primitive = primitive.triangleset()
            if isinstance(primitive, collada.triangleset.TriangleSet) and len(primitive):
                points = primitive.vertex @ placed.matrix[:3, :3].T + placed.matrix[:3, 3]
                colour = _material_colour(placed.materialnodebysymbol.get(primitive.material))
                corners = points[primitive.vertex_index] * size
                if np.linalg.det(placed.matrix[:3, :3]) * np.prod(size) < 0.0:  # mirrored
                    corners = corners[:, ::-1]
                found.setdefault(colour, []).append(corners)
    return {colour: np.concatenate(each) for colour, each in found.items()}


def _material_colour(bound: Any) -> Colour | None:
    """A material's colour, as a scene binds it; None if the material is a picture or missing."""
    effect = getattr(getattr(bound, "target", None), "effect", None)
    diffuse = getattr(effect, "diffuse", None)
    if not isinstance(diffuse, tuple | list | np.ndarray):
        return None
    red, green, blue = (float(x) for x in diffuse[:3])
    return red, green, blue


GREY = (0.78, 0.79, 0.81)
CHAIN_RADIUS = 0.035
"""Of the cylinders that stand for links without shapes [m]."""

_Z_FROM_Y = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=float)
"""Turns what three.js draws along y, cylinders and capsules, along z."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One shape, fixed to a link.

    Attributes:
        joint: index in the arm's model of the joint that moves it; 0 for the base.
        placement: (4, 4) in that joint's frame.
        data: Meshcat's object, lowered.
        colour: (3,) red, green, blue from 0 to 1.
    """

    joint: int
    placement: Array
    data: dict[str, Any]
    colour: Colour


def arm_parts(arm: Arm) -> list[Part]:
    """The arm's shapes: its URDF's, or, without any that can be read, cylinders base to flange.

    What the URDF mounts beyond the flange, such as a gripper, is left out: there the instrument
    is mounted.
    """
    return _urdf_parts(arm) or _chain_parts(arm)


def _urdf_parts(arm: Arm) -> list[Part]:
    geometry = geometry_of(arm, pin.GeometryType.VISUAL)
    if geometry is None:
        return []
    if geometry.missing:
        warnings.warn(_without(arm, geometry.missing), ArmWarning, stacklevel=1)
    if arm.source is not None and (others := changed_meshes(arm.source)):
        warnings.warn(
            f"{arm.name} does not look as it did when the run was made: {', '.join(others)} of "
            "that name are here, with another content",
            ArmWarning,
            stacklevel=1,
        )
    parts = []
    for shape in geometry.shapes.geometryObjects:
        body = geometry.model.frames[shape.parentFrame]
        if hangs_on(geometry.model, shape.parentFrame, arm.flange):
            continue
        frame = arm.model.frames[arm.model.getFrameId(body.name, pin.FrameType.BODY)]
        placement = frame.placement * body.placement.actInv(shape.placement)
        for data, fix, colour in _lowered(shape):
            parts.append(Part(frame.parentJoint, placement.homogeneous @ fix, data, colour))
    return parts


def _without(arm: Arm, meshes: Sequence[str]) -> str:
    """Warning text for meshes that are missing."""
    if arm.source is not None and arm.source.carried:
        return (
            f"{arm.name} is drawn without its {len(meshes)} meshes, which are not in the run's "
            f"file; where {arm.name} is, give it with --arm"
        )
    return (
        f"{arm.name} is drawn without {', '.join(meshes)}: no such mesh, or it cannot be read; "
        "give the folder that has the package as packages in an arm's file"
    )


def _lowered(shape: Any) -> list[tuple[dict[str, Any], Array, Colour]]:
    """Meshcat's objects of a shape, the factor of its placement, and their colours."""
    geometry, own = shape.geometry, _colour(shape)
    if isinstance(geometry, coal.Cylinder):
        return [(_mesh(g.Cylinder(2.0 * geometry.halfLength, geometry.radius)), _Z_FROM_Y, own)]
    if isinstance(geometry, coal.Sphere):
        return [(_mesh(g.Sphere(geometry.radius)), np.eye(4), own)]
    if isinstance(geometry, coal.Box):
        return [(_mesh(g.Box((2.0 * geometry.halfSide).tolist())), np.eye(4), own)]
    if not isinstance(geometry, coal.BVHModelBase):
        return []
    surfaces = [(smooth(corners), colour) for colour, corners in _triangles(shape).items()]
    return [(_mesh(Triangles(surface)), np.eye(4), colour or GREY) for surface, colour in surfaces]


def _triangles(shape: Any) -> dict[Colour | None, Array]:
    """Corners (m, 3, 3) of a mesh's triangles by colour: the URDF's, or else the file's own."""
    path = Path(shape.meshPath)
    if path.suffix.lower() == ".dae" and not shape.overrideMaterial:
        with contextlib.suppress(Unreadable):  # what follows does without its colours
            return collada_triangles(path, shape.meshScale)
    mesh = shape.geometry
    rows = [mesh.tri_indices(i) for i in range(mesh.num_tris)]
    faces = np.array([[row[0], row[1], row[2]] for row in rows])
    if np.prod(shape.meshScale) < 0.0:  # mirrored, so that they go round the other way
        faces = faces[:, ::-1]
    return {_colour(shape): mesh.vertices()[faces]}


def _colour(shape: Any) -> Colour:
    """Colour in the URDF, or the default of its parser."""
    red, green, blue = (float(x) for x in shape.meshColor[:3])
    return red, green, blue


def _mesh(geometry: Any) -> dict[str, Any]:
    mesh = g.Mesh(geometry, g.MeshLambertMaterial())
    geometry.uuid, mesh.material.uuid, mesh.uuid = "geometry", "material", "mesh"  # not by chance
    lowered: dict[str, Any] = mesh.lower()
    return lowered


def _chain_parts(arm: Arm) -> list[Part]:
    """For an arm without shapes: cylinders from the base over the joints to the flange.

    A ball is on each joint.
    """
    parts = []
    for i, end in enumerate([*arm.model.jointPlacements[1:], arm.jMflange]):
        if i > 0:
            parts.append(Part(i, np.eye(4), _mesh(g.Sphere(1.25 * CHAIN_RADIUS)), GREY))
        parts.extend(_rod(i, end.translation))
    return parts


def _rod(joint: int, end: Sequence[float] | Array) -> list[Part]:
    """A cylinder from a joint's origin to ``end`` (3,) in its frame; none where that is near."""
    end = np.asarray(end, dtype=float)
    length = float(np.linalg.norm(end))
    if length < CHAIN_RADIUS:
        return []
    placement = np.eye(4)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / length)
    placement[:3, :3], placement[:3, 3] = turn.toRotationMatrix(), end / 2.0
    rod = _mesh(g.Cylinder(length, CHAIN_RADIUS))
    return [Part(joint, placement @ _Z_FROM_Y, rod, GREY)]
