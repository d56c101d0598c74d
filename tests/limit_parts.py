"""What tests of limits start from."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from rcmqp import load_arm
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.view import STILL, Reference
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Instrument

ARMS = ("lwa3", "kinova", "panda", "ur5", "z1")
T = 1e-3
SCOPE = Instrument(length=0.33, radius=0.005)


def reference(pivot: Array, pivot_dot: Array = STILL) -> Reference:
    return Reference(dq.IDENTITY, np.zeros(8), pivot, pivot_dot)


@functools.cache
def insertion(arm: str) -> Insertion:
    loaded = load_arm(arm)
    return Insertion.on_shaft(loaded, SCOPE, loaded.random_angles(np.random.default_rng(11)))


NEEDED: dict[str, dict[str, Any]] = {
    "keep_out": {"centre": (0.4, 0.1, 0.3), "radius": 0.02, "part": "tip"},
    "keep_in": {"centre": (0.4, 0.1, 0.3), "radius": 0.2, "part": "shaft"},
    "entry_sphere": {"centre": (0.0, 0.0, 0.0), "radius": 0.01, "on_trocar": True},
}
