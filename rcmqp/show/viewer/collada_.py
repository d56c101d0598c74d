"""What is read of Collada files: triangles, by colour; nothing else imports collada."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import collada
import numpy as np
from collada.common import DaeError as Unreadable

from rcmqp.maths.dualquaternion import Array

__all__ = ["Colour", "Unreadable", "triangles"]

Colour = tuple[float, float, float]
"""Red, green, blue from 0 to 1."""

IGNORED = [collada.common.DaeUnsupportedError, collada.common.DaeBrokenRefError]
"""What a file may have wrong, such as a picture that is missing."""


def triangles(path: Path, scale: Array) -> dict[Colour | None, Array]:
    """A file's triangles of each colour, as its scene places them.

    The file's unit counts; its up axis does not, as elsewhere where URDFs are drawn. Its normals,
    and pictures on its faces, are left out.

    Args:
        path: of the file.
        scale: (3,) what the URDF multiplies points with.

    Returns:
        Corners (m, 3, 3) of each colour's triangles [m]; the colour is None if the file has none.

    Raises:
        Unreadable: this is no Collada file, or a broken one.
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
                colour = _colour(placed.materialnodebysymbol.get(primitive.material))
                corners = points[primitive.vertex_index] * size
                if np.linalg.det(placed.matrix[:3, :3]) * np.prod(size) < 0.0:  # mirrored
                    corners = corners[:, ::-1]
                found.setdefault(colour, []).append(corners)
    return {colour: np.concatenate(each) for colour, each in found.items()}


def _colour(bound: Any) -> Colour | None:
    """A material's colour, as a scene binds it; None if the material is a picture or missing."""
    effect = getattr(getattr(bound, "target", None), "effect", None)
    diffuse = getattr(effect, "diffuse", None)
    if not isinstance(diffuse, tuple | list | np.ndarray):
        return None
    red, green, blue = (float(x) for x in diffuse[:3])
    return red, green, blue
