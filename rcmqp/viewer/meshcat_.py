"""What is used of meshcat: its geometries and commands, without its server."""

from __future__ import annotations

import warnings

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of its server's event loop
    from meshcat import geometry
    from meshcat.commands import SetTransform
    from meshcat.path import Path as TreePath

__all__ = ["SetTransform", "TreePath", "geometry"]
