"""Shapes of an arm's links, from its URDF, and whether they touch each other."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm, ModelSource
from rcmqp.world.instrument import Instrument


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """Shapes of an arm's URDF.

    Attributes:
        model: of the whole URDF, all joints free.
        shapes: fixed to that model's frames.
        missing: file names of the meshes that were not found or cannot be read; their shapes are
            not there.
    """

    model: pin.Model
    shapes: pin.GeometryModel
    missing: tuple[str, ...]


def geometry_of(arm: Arm, kind: pin.GeometryType) -> Geometry | None:
    """The visual or collision shapes of an arm; None where it was made of no URDF."""
    if arm.source is None:
        return None
    root = ET.fromstring(arm.source.text)
    if arm.source.carried:  # its meshes are elsewhere, and the names of files are a stranger's
        missing = _drop(root, kind, lambda mesh: True)
    else:
        missing = _resolve_meshes(root, kind, _folders(arm.source))
    text = ET.tostring(root, encoding="unicode")
    model = pin.buildModelFromXML(text)
    try:
        shapes = pin.buildGeomFromUrdfString(model, text, kind)
    except (ValueError, RuntimeError):  # a mesh is of a kind that is not read
        missing += _drop(root, kind, lambda mesh: not _readable(mesh.get("filename", "")))
        text = ET.tostring(root, encoding="unicode")
        shapes = pin.buildGeomFromUrdfString(model, text, kind)
    return Geometry(model, shapes, tuple(missing))


def mesh_files(source: ModelSource) -> dict[str, Path]:
    """The files of an arm's meshes that are here, by their names in the URDF."""
    meshes = ET.fromstring(source.text).iter("mesh")
    names = dict.fromkeys(mesh.get("filename", "") for mesh in meshes)
    found = ((name, _mesh_path(name, _folders(source))) for name in names)
    return {name: path for name, path in found if path is not None}


def _folders(source: ModelSource) -> list[Path]:
    """In which meshes are looked for."""
    return [*source.packages, *source.urdf.resolve().parents]


def hangs_on(model: pin.Model, frame: int, name: str) -> bool:
    """Whether a frame of the model hangs on the link with this name, and is not the link."""
    while frame > 0:
        frame = model.frames[frame].parentFrame
        if model.frames[frame].name == name and model.frames[frame].type == pin.FrameType.BODY:
            return True
    return False


def _resolve_meshes(
    root: ET.Element, kind: pin.GeometryType, folders: Iterable[Path]
) -> list[str]:
    """Put the path of each mesh into the XML, take out those not found, and return these."""

    def lost(mesh: ET.Element) -> bool:
        path = _mesh_path(mesh.get("filename", ""), folders)
        if path is not None:
            mesh.set("filename", str(path))
        return path is None

    return _drop(root, kind, lost)


def _drop(
    root: ET.Element, kind: pin.GeometryType, unwanted: Callable[[ET.Element], bool]
) -> list[str]:
    """Take out the shapes with unwanted meshes, and return the meshes' file names."""
    dropped, tag = [], "visual" if kind == pin.GeometryType.VISUAL else "collision"
    for link in root.iterfind("link"):
        for shape in link.findall(tag):
            mesh = shape.find("geometry/mesh")
            if mesh is not None and unwanted(mesh):
                dropped.append(mesh.get("filename", ""))
                link.remove(shape)
    return sorted(set(dropped))


def _mesh_path(name: str, folders: Iterable[Path]) -> Path | None:
    """The file of a mesh: package://name/rest in the folders, or a path from the URDF's folder."""
    scheme, colon, rest = name.partition("://")
    if colon and scheme == "file":
        name = rest
    elif colon:
        package, _, inside = rest.partition("/")
        tried = [
            *(folder / rest for folder in folders),
            *(folder / inside for folder in folders if folder.name == package),
        ]
        return next((path for path in tried if path.is_file()), None)
    return next((path for f in folders if (path := f / name).is_file()), None)


def _readable(path: str) -> bool:
    """Whether a mesh's file can be read."""
    try:
        coal.MeshLoader().load(path, np.ones(3))
    except (ValueError, RuntimeError):
        return False
    return True


LINK_RADIUS = 0.03
"""Of the capsules that stand for links without shapes [m]."""

THIN = 1e-4
"""Least side of the box around a flat mesh [m]."""

SHAFT = "the shaft"

SAMPLES, ALWAYS = 40, 0.5
"""Random configurations; two shapes that touch in more than this share of them are built so."""


class Collisions:
    """Shapes of an arm with an instrument, and the pairs of them that may run into each other.

    Shapes are the collision shapes of the URDF, of meshes the convex hulls; without any, capsules
    from joint to joint. Links that hang on the same or on neighbouring joints are no pair.
    A wrist counts as straight, which it is at every start.
    """

    def __init__(self, arm: Arm, instrument: Instrument) -> None:
        """Gather the shapes, and leave out the pairs that always touch."""
        self.arm = arm
        self._shapes = pin.GeometryModel()
        for name, joint, placement, shape in _links(arm):
            self._add(name, joint, placement, shape)
        start = instrument.mount_offset + 2.0 * instrument.radius
        length = instrument.tip - start
        middle = instrument.on_shaft(start + length / 2.0)
        capsule = coal.Capsule(instrument.radius, length)
        self._add(SHAFT, arm.last_joint, arm.jMflange * middle, capsule)
        self._data = arm.model.createData()
        self._pair()

    def first(self, angles: ArrayLike) -> str:
        """Names of two parts that touch at joint angles (nv,), such as "forearm and the shaft"."""
        q = self.arm.configuration(angles)
        if not pin.computeCollisions(
            self.arm.model, self._data, self._shapes, self._shapes_data, q, True
        ):
            return ""
        touching = self._touching()
        pair = self._shapes.collisionPairs[touching[0]]
        names = [self._shapes.geometryObjects[i].name for i in (pair.first, pair.second)]
        return " and ".join(names)

    def _add(
        self, name: str, joint: int, placement: pin.SE3, shape: coal.CollisionGeometry
    ) -> None:
        self._shapes.addGeometryObject(pin.GeometryObject(name, joint, placement, shape))

    def _pair(self) -> None:
        """Make the pairs, look at random configurations, and keep those that mean something."""
        objects = self._shapes.geometryObjects
        pairs = [
            pin.CollisionPair(i, j)
            for i, j in combinations(range(len(objects)), 2)
            if abs(objects[i].parentJoint - objects[j].parentJoint) >= 2
        ]
        for pair in pairs:
            self._shapes.addCollisionPair(pair)
        self._shapes_data = self._shapes.createData()
        counts, rng = np.zeros(len(pairs)), np.random.default_rng(0)
        for _ in range(SAMPLES):
            q = self.arm.configuration(self.arm.random_angles(rng))
            pin.computeCollisions(
                self.arm.model, self._data, self._shapes, self._shapes_data, q, False
            )
            counts[self._touching()] += 1
        for pair, count in zip(pairs, counts, strict=True):
            if count > ALWAYS * SAMPLES:
                self._shapes.removeCollisionPair(pair)
        self._shapes_data = self._shapes.createData()

    def _touching(self) -> list[int]:
        results = self._shapes_data.collisionResults
        return [i for i, result in enumerate(results) if result.isCollision()]


def _links(arm: Arm) -> list[tuple[str, int, pin.SE3, coal.CollisionGeometry]]:
    """Name, joint, placement in the joint's frame, and shape, of everything before the flange."""
    found = geometry_of(arm, pin.GeometryType.COLLISION)
    links = []
    for shape in () if found is None else found.shapes.geometryObjects:
        assert found is not None
        body = found.model.frames[shape.parentFrame]
        if hangs_on(found.model, shape.parentFrame, arm.flange):
            continue
        frame = arm.model.frames[arm.model.getFrameId(body.name, pin.FrameType.BODY)]
        placement = frame.placement * body.placement.actInv(shape.placement)
        convex, centre = _convex(shape.geometry)
        placement = placement * pin.SE3(np.eye(3), centre)
        links.append((body.name, frame.parentJoint, placement, convex))
    return links or _capsules(arm)


def _convex(shape: coal.CollisionGeometry) -> tuple[coal.CollisionGeometry, Array]:
    """A convex shape, and where its origin is in the shape's axes: of a mesh, its hull.

    Of a mesh that is flat, or has a point with more than 255 neighbours on the hull, which coal
    does not take, it is the box around it.
    """
    if not isinstance(shape, coal.BVHModelBase):
        return shape, np.zeros(3)
    try:
        shape.buildConvexHull(False, "Qt")
    except (RuntimeError, ValueError):
        points = np.array(shape.vertices())
        low, high = points.min(axis=0), points.max(axis=0)
        return coal.Box(*np.maximum(high - low, THIN)), (low + high) / 2.0
    return shape.convex, np.zeros(3)


def _capsules(arm: Arm) -> list[tuple[str, int, pin.SE3, coal.CollisionGeometry]]:
    """Capsules from joint to joint, for an arm without shapes."""
    links = []
    for joint, end in enumerate([*list(arm.model.jointPlacements)[1:], arm.jMflange]):
        length = float(np.linalg.norm(end.translation))
        if length < 2.0 * LINK_RADIUS:
            continue
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end.translation / length)
        placement = pin.SE3(turn.matrix(), end.translation / 2.0)
        capsule = coal.Capsule(LINK_RADIUS, length - 2.0 * LINK_RADIUS)
        links.append((f"link {joint}", joint, placement, capsule))
    return links
