"""What tests of the safe stop start from."""

from __future__ import annotations

import pytest

from rcmqp import Insertion, Reference, ViewCommand, view_pose
from rcmqp.controllers import CONTROLLERS
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths import ConicalHelix
from rcmqp.references.view import carried

T = 8e-3
every_controller = pytest.mark.parametrize("name", list(CONTROLLERS))


def view(insertion: Insertion, t: float = 5.0) -> Reference:
    return view_pose(insertion.x_rcm, ConicalHelix().command(t, insertion.tip_depth))


def home(insertion: Insertion, offset: Array | None = None) -> Reference:
    """The view of the start, the trocar carried off by ``offset`` (3,)."""
    x_rcm = insertion.x_rcm if offset is None else carried(insertion.x_rcm, offset)
    return view_pose(x_rcm, ViewCommand())
