"""The parts of meshcat that are used, without its server: commands and geometries."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcmqp.maths.dualquaternion import Array

Indices = np.ndarray[Any, np.dtype[np.integer[Any]]]

EDGE = math.radians(35.0)
"""Facets that meet at a larger angle meet at an edge [rad]."""

GRAIN = 2.0**-16
"""Points are rounded to this [m], 15 um: so they meet, and pack well."""

NORMAL_GRAIN = 2.0**-6
"""Components of normals are rounded to this."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles that share points.

    Attributes:
        points: (n, 3) [m].
        normals: (n, 3) outwards, of length 1 to within NORMAL_GRAIN.
        faces: (m, 3) rows of ``points``.
    """

    points: Array
    normals: Array
    faces: Indices


def smooth(corners: Array) -> Surface:
    """Triangles with normals: at each corner the mean of the facets around it, by their area.

    Facets beyond an edge do not count. Triangles without area are left out.

    Args:
        corners: (m, 3, 3) of triangles, counter-clockwise seen from outside [m].
    """
    points, faces = _merged(np.asarray(corners).reshape(-1, 3) / GRAIN)
    faces = faces.reshape(-1, 3)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    areas = np.cross(b - a, c - a)  # twice the area long
    real = areas.any(axis=1)
    faces, areas = faces[real], areas[real]
    at = faces.ravel()
    normals = _unit(_around(at, np.repeat(areas, 3, axis=0)))
    both, rows = _merged(np.hstack([points[at], normals / NORMAL_GRAIN]))
    shared, found = np.split(both, 2, axis=1)
    return Surface(shared * GRAIN, found * NORMAL_GRAIN, rows.reshape(-1, 3))


def _around(at: Indices, areas: Array) -> Array:
    """For each corner, the sum of the areas (k, 3) of all corners at its point, but across edges.

    Args:
        at: (k,) the point that each corner lies at.
        areas: (k, 3) normals of the corners' facets, as long as their area.
    """
    order = np.argsort(at, kind="stable")
    count = np.bincount(at)[at[order]]  # how many share each corner's point
    first = np.searchsorted(at[order], at[order])
    start = np.cumsum(count) - count  # of each corner's stretch in the list of pairs
    one = np.repeat(order, count)
    other = order[np.arange(count.sum()) - np.repeat(start - first, count)]
    unit = _unit(areas)
    smooth = np.sum(unit[one] * unit[other], axis=1) > math.cos(EDGE)
    sums = np.add.reduceat(np.where(smooth[:, None], areas[other], 0.0), start)
    found = np.empty_like(areas)
    found[order] = sums
    return found


def _merged(rows: Array) -> tuple[Array, Indices]:
    """Rows rounded to whole numbers, each kept once, and which of those each row became."""
    rounded = np.round(rows)
    order = np.lexsort(rounded.T)
    new = np.any(np.diff(rounded[order], axis=0, prepend=np.nan), axis=1)
    which = np.empty(len(rows), dtype=np.uint32)
    which[order] = np.cumsum(new) - 1
    return rounded[order][new], which


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of its server's event loop
    from meshcat import geometry
    from meshcat.commands import SetTransform
    from meshcat.path import Path as TreePath


__all__ = ["SetTransform", "Surface", "TreePath", "Triangles", "geometry", "smooth"]


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
