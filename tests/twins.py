"""Library tasks and limits as a user would have written them; cycles to try them in."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any, TypeVar, cast

import numpy as np
import oracles.limits
import oracles.tasks

from rcmqp import ArmState, Insertion, Reference, load_scenario
from rcmqp.limits import JointLimits, KeepOut, Limit, TrocarCone, TrocarDepth
from rcmqp.tasks import (
    ObjectiveTask,
    RcmTask,
    RollTask,
    Task,
    TipTask,
)
from rcmqp.tasks.base import block_of

T = 1e-3

Item = TypeVar("Item", Task, Limit)


def twin(item: Item) -> Item:
    """The same task or limit, as a user would have written it in Python."""
    rows: Any = oracles.tasks.residual if isinstance(item, Task) else oracles.limits.constraint

    def evaluate(self: Item, state: ArmState, reference: Reference) -> Any:
        return rows(self, state, reference)

    kind: Any = type(f"Own{type(item).__name__}", (type(item),), {"evaluate": evaluate})
    options = {
        part.name: getattr(item, part.name) for part in dataclasses.fields(item) if part.init
    }
    made = kind(**options)
    assert block_of(made) is None
    return cast(Item, made)


def every(items: list[Item], chosen: list[int]) -> list[Item]:
    """The items, those in the chosen places as their twins."""
    return [twin(item) if k in chosen else item for k, item in enumerate(items)]


def insertion_of(arm: str) -> Insertion:
    return load_scenario("obstacle", arm).insertion()


def cycles(insertion: Insertion, count: int = 12) -> Iterator[tuple[ArmState, Reference]]:
    """Near the start, moving, some of them fast; the view somewhere beside."""
    rng, arm = np.random.default_rng(7), insertion.arm
    for _ in range(count):
        angles = insertion.angles_start + 10.0 ** rng.uniform(-4, -0.5) * rng.normal(size=arm.nv)
        v = 10.0 ** rng.uniform(-3, -0.5) * arm.velocity * rng.uniform(-1, 1, size=arm.nv)
        a = rng.uniform(-1.0, 1.0, arm.nv) * np.minimum(arm.acceleration, 10.0)
        near = insertion.state(arm.configuration(angles + 0.02 * rng.normal(size=arm.nv)))
        pivot = np.array(insertion.trocar.pivot) + 1e-3 * rng.normal(size=3)
        reference = Reference(near.x, 0.1 * rng.normal(size=8), pivot, 0.02 * rng.normal(size=3))
        yield insertion.state(arm.configuration(angles), v, a), reference


def usual(insertion: Insertion) -> tuple[list[Task], list[Limit]]:
    """The default levels, and limits of which all are met somewhere."""
    deep = (insertion.tip_depth - 1e-3, insertion.tip_depth + 1e-3)
    trocar = dataclasses.replace(insertion.trocar, cone_half_angle=0.01, depth_range=deep)
    objective = ObjectiveTask.made_for(insertion)
    levels: list[Task] = [RcmTask(period=T), TipTask(), RollTask(), objective]
    beyond = insertion.tip(insertion.x_rcm) - insertion.trocar.pivot + np.array([0.02, 0.0, 0.0])
    sphere = KeepOut(
        centre=(float(beyond[0]), float(beyond[1]), float(beyond[2])),
        radius=0.015,
        instrument=insertion.instrument,
        on_trocar=True,
    )
    box = JointLimits(insertion.arm, T)
    return levels, [box, TrocarCone(trocar, gain=20.0), TrocarDepth(trocar), sphere]
