"""The references that a scenario gives its controller, one for each sampling instant."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import TYPE_CHECKING

import numpy as np

from rcmqp import _kernel
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.governor import Governed, PathClock
from rcmqp.references.operators import Steered
from rcmqp.references.paths import Path, views_of
from rcmqp.references.planner import Planner
from rcmqp.references.view import Reference, carried, view_pose
from rcmqp.world.arm import ArmState
from rcmqp.world.insertion import Insertion
from rcmqp.world.motions import Still

if TYPE_CHECKING:
    from rcmqp.runs.scenario import Scenario

BLOCK = 512
"""Sampling instants that are prepared, and put away, at once."""


def references(
    scenario: Scenario, insertion: Insertion, clock: PathClock | None
) -> Generator[Reference, ArmState | None]:
    """The references of Scenario.references()."""
    planner = scenario.planner(insertion.x_rcm)
    if isinstance(scenario.path, Steered):
        yield from _steered(scenario, scenario.path, insertion, planner)
        return
    if scenario.governor is not None:
        governed = Governed(scenario.path, insertion, clock or PathClock(scenario.governor))
        yield from _governed(scenario, governed, planner)
        return
    state: ArmState | None = None
    for reference in _drawn(scenario, scenario.path, insertion):
        state = yield _planned(scenario, planner, reference, state)


def _planned(
    scenario: Scenario, planner: Planner | None, reference: Reference, state: ArmState | None
) -> Reference:
    """The reference after the path planner, if there is one."""
    if planner is None:
        return reference
    if state is None or scenario.planner_from == "reference":
        return planner.step(reference)
    return planner.step(reference, state.x)


def _steered(
    scenario: Scenario, path: Steered, insertion: Insertion, planner: Planner | None
) -> Generator[Reference, ArmState | None]:
    """The references of a path that is steered by the state reached last."""
    ask, x = path.start(insertion, scenario.period, scenario.seed).command, insertion.x_rcm
    state: ArmState | None = None
    for cycles in blocks(scenario.cycles):
        for k, offset, pivot_dot in zip(cycles, *_trocar(scenario, cycles), strict=True):
            t = k * scenario.period
            command = ask(t, x)
            if command is None:
                return
            insertion.check_reach(t, command.t_z)
            reference = view_pose(carried(insertion.x_rcm, offset), command, pivot_dot)
            reference = _planned(scenario, planner, reference, state)
            state = yield reference
            x = reference.x_d if state is None else state.x


def _governed(
    scenario: Scenario, governed: Governed, planner: Planner | None
) -> Generator[Reference, ArmState | None]:
    """The references of a path that waits for the arm."""
    state: ArmState | None = None
    for cycles in blocks(scenario.cycles):
        for k, offset, pivot_dot in zip(cycles, *_trocar(scenario, cycles), strict=True):
            reference = governed.reference(k * scenario.period, offset, pivot_dot)
            reference = _planned(scenario, planner, reference, state)
            state = yield reference
            if state is not None:
                governed.see(state, reference)


def _drawn(scenario: Scenario, path: Path, insertion: Insertion) -> Iterator[Reference]:
    """The references of any other path, made a block at a time."""
    for cycles in blocks(scenario.cycles):
        times = scenario.period * np.arange(cycles.start, cycles.stop, dtype=float)
        views = views_of(path, times, insertion.tip_depth)
        deepest = int(np.argmax(views[:, 3]))
        insertion.check_reach(times[deepest], views[deepest, 3])
        ways, pivot_dots = _trocar(scenario, cycles)
        made = _kernel.view_poses(insertion.x_rcm, views, ways, pivot_dots)
        yield from map(Reference, *made, pivot_dots)


def _trocar(scenario: Scenario, cycles: range) -> tuple[Array, Array]:
    """The trocar's motion (n, 3) [m], and its velocity as the controller is told (n, 3) [m/s]."""
    ways = offsets(scenario, cycles)
    if scenario.pivot_velocity == "unknown" or isinstance(scenario.motion, Still):
        return ways, np.zeros_like(ways)
    if scenario.pivot_velocity == "measured":
        return ways, np.array([scenario.motion.velocity(k * scenario.period) for k in cycles])
    before = offsets(scenario, range(max(cycles.start - 1, 0), cycles.start or 1))
    return ways, np.diff(np.concatenate([before, ways]), axis=0) / scenario.period


def offsets(scenario: Scenario, cycles: range) -> Array:
    """The trocar's motion (n, 3) from where it was at the start [m]."""
    if isinstance(scenario.motion, Still):
        return np.zeros((len(cycles), 3))
    return np.array([scenario.motion.position(k * scenario.period) for k in cycles])


def blocks(cycles: int) -> Iterator[range]:
    """All cycles, BLOCK at a time."""
    for first in range(0, cycles, BLOCK):
        yield range(first, min(first + BLOCK, cycles))
