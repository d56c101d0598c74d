"""Tasks: what is wanted of the arm, as an error with its Jacobian and its drift.

A new task is a frozen dataclass derived from Task with evaluate(), added to TASKS. Tasks that
are added up share a level: ``TipTask() + RollTask(weight=0.01)``.
"""

from __future__ import annotations

from typing import Any

from rcmqp.maths.options import check_name
from rcmqp.tasks.base import Residual, Task, Together
from rcmqp.tasks.objectives import ObjectiveTask, PostureTask
from rcmqp.tasks.placement import (
    DepthTask,
    DirectionTask,
    OrientationTask,
    PoseTask,
    RcmTask,
    RollTask,
    TipTask,
)
from rcmqp.world.insertion import Insertion

TASKS: dict[str, type[Task]] = {
    task.name: task
    for task in (
        PoseTask,
        RcmTask,
        TipTask,
        DepthTask,
        RollTask,
        DirectionTask,
        OrientationTask,
        PostureTask,
        ObjectiveTask,
    )
}


def make_task(name: str, insertion: Insertion, **options: Any) -> Task:
    """Make a task by name; what the insertion knows need not be given.

    Raises:
        UnknownName: the task is not known, or does not have the option.
        OptionError: an option's value is not allowed.
    """
    check_name("task", name, TASKS, options)
    return TASKS[name].made_for(insertion, **options)


__all__ = [
    "TASKS",
    "DepthTask",
    "DirectionTask",
    "ObjectiveTask",
    "OrientationTask",
    "PoseTask",
    "PostureTask",
    "RcmTask",
    "Residual",
    "RollTask",
    "Task",
    "TipTask",
    "Together",
    "make_task",
]
