"""What several tests need: derivatives, and geometry in Pinocchio's terms."""

from __future__ import annotations

import functools
import importlib.resources
import tomllib
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import ArrayLike

from rcmqp import (
    ArmState,
    Insertion,
    Run,
    Scenario,
    load_scenario,
    make_controller,
    scenario_names,
    simulate,
)
from rcmqp.maths.dualquaternion import Array

assert_allclose = np.testing.assert_allclose

every_scenario = pytest.mark.parametrize("name", scenario_names())


Call: TypeAlias = Callable[..., tuple[int, str, str]]
"""Of the fixture ``call``."""

SHORT = ("run", "conical_helix", "--duration", "0.1", "--period", "0.01")
"""A command line that simulates ten cycles."""


def ran(scenario: Scenario, controller: str = "dual_quaternion", **options: object) -> Run:
    """The run of a scenario under a controller by name."""
    made = make_controller(controller, scenario.insertion(), scenario.period, **options)
    return simulate(scenario, made)


def derivative(f: Callable[[float], ArrayLike], h: float = 1e-3) -> Array:
    """df/dt at 0: two central differences, extrapolated so that the h^2 term drops out.

    For functions and time scales of order 1 it is good to some 1e-12.
    """

    def central(step: float) -> Array:
        return np.asarray(np.subtract(f(step), f(-step)) / (2.0 * step))

    return (4.0 * central(h / 2) - central(h)) / 3.0


@functools.cache
def inserted(arm: str = "lwa3") -> Insertion:
    """An arm as the paper's helix has it at the start."""
    return load_scenario("conical_helix", arm).insertion()


def near_start(insertion: Insertion, rng: np.random.Generator, spread: float = 0.2) -> ArmState:
    """A state some 10 degrees from the start: no symmetry left, no singularity near."""
    angles = insertion.angles_start + rng.uniform(-spread, spread, insertion.arm.nv)
    return insertion.state(insertion.arm.configuration(angles))


def nearer(x_d: Array, x: Array) -> Array:
    """Of the two dual quaternions (8,) of a pose the one that is nearer to x (8,)."""
    return x_d if x_d[:4] @ x[:4] >= 0.0 else -x_d


def size(v: Array) -> float:
    return float(np.linalg.norm(v))


def random_placement(rng: np.random.Generator) -> pin.SE3:
    return pin.exp6(rng.normal(size=6))


def shaft_distance(aMe: pin.SE3, point: ArrayLike) -> float:
    """Distance of a point from the z axis of a placement, by the cross product."""
    z = aMe.rotation[:, 2]
    return float(np.linalg.norm(np.cross(np.asarray(point) - aMe.translation, z)))


def robot_toml(name: str) -> dict[str, Any]:
    """What the registry says of an arm, read past rcmqp's own loader."""
    folder = importlib.resources.files("rcmqp.robots") / name
    return tomllib.loads((folder / "robot.toml").read_text(encoding="utf-8"))


def across(J_local: Array, depth: float) -> Array:
    """Velocity (2, nv) of the shaft's point at ``depth`` [m] from the effector, across it."""
    nu, omega = J_local[:3], J_local[3:]
    return np.array([nu[0] + depth * omega[1], nu[1] - depth * omega[0]])
