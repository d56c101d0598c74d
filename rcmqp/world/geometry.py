"""Shapes of an arm's links, from its URDF, with the meshes that can be found."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from rcmqp.world.arm import Arm, ModelSource


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
