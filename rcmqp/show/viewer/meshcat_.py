"""What is used of meshcat: its geometries and commands, without its server."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from rcmqp.show.viewer.surface import Surface

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of its server's event loop
    from meshcat import geometry
    from meshcat.commands import SetTransform
    from meshcat.path import Path as TreePath

__all__ = ["SetTransform", "TreePath", "Triangles", "geometry"]


class Triangles(geometry.Geometry):  # type: ignore[misc]
    """A surface with its normals, which meshcat's own triangles do not have."""

    def __init__(self, surface: Surface) -> None:
        super().__init__()
        self.surface = surface

    def lower(self, object_data: Any) -> dict[str, Any]:
        """As three.js reads it."""
        points, normals, faces = (
            geometry.pack_numpy_array(np.asarray(array, dtype).T)
            for array, dtype in (
                (self.surface.points, np.float32),
                (self.surface.normals, np.float32),
                (self.surface.faces, np.uint32),
            )
        )
        data = {"attributes": {"position": points, "normal": normals}, "index": faces}
        return {"uuid": self.uuid, "type": "BufferGeometry", "data": data}
