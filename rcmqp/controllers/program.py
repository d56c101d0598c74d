"""Levels and limits as numbers, so that compiled code can make their rows each cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rcmqp import _kernel
from rcmqp.limits import JointLimits, Limit
from rcmqp.maths.dualquaternion import Array
from rcmqp.tasks import Task, Together
from rcmqp.world.arm import Arm

LevelOfTasks: TypeAlias = Task | Together


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """What _kernel.step() needs of tasks and limits; see rcmqp/kernel/rows.h.

    Attributes:
        n: joints.
        size: rows of all levels, with the rest.
        tasks: (tasks, TASK_NUMBERS) kind, root of the weight, parameters.
        vectors: (tasks, 2, nv) parameters that are one number a joint.
        ends: (levels + 1,) where each level's rows end; the last is the rest.
        damping: (levels + 1,) of each level; the rest's is zero.
        limits: (limits, LIMIT_NUMBERS) kind, parameters.
        joints: (JOINT_NUMBERS, nv) the table of the joints' limits; zeros without any.
        rows: how many hard rows there are.
        names: of the joints, then of the rows.
    """

    n: int
    size: int
    tasks: Array
    vectors: Array
    ends: NDArray[np.int64]
    damping: Array
    limits: Array
    joints: Array
    rows: int
    names: tuple[str, ...]

    @property
    def shape(self) -> tuple[int, int]:
        """Of an active set: levels with the hard rows and the rest, bounds."""
        return len(self.ends) + 1, self.n + self.rows

    @classmethod
    def of(cls, levels: Sequence[LevelOfTasks], limits: Sequence[Limit], arm: Arm) -> Self | None:
        """The program of levels and limits; None where one of them is not in compiled code."""
        nv = arm.nv
        tasks, vectors, ends = [], [], []
        for level in levels:
            if isinstance(level, Together) and type(level) is not Together:
                return None
            for task in level.tasks if isinstance(level, Together) else (level,):
                found = task.program() if _own(task) else None
                if found is None or any(np.shape(given) != (nv,) for given in found[1]):
                    return None
                numbers, given = found
                if level is task:  # a weight means nothing on a level of its own
                    numbers = (numbers[0], 1.0, *numbers[2:])
                tasks.append(numbers)
                vectors.append([*given, *[np.zeros(nv)] * (2 - len(given))])
            ends.append(sum(_ROWS.get(int(numbers[0]), nv) for numbers in tasks))
        lines = [limit.program() if _own(limit) else None for limit in limits]
        boxes = [limit for limit in limits if isinstance(limit, JointLimits)]
        if None in lines or any(box.arm.joints != arm.joints for box in boxes):
            return None
        joints = boxes[0].table if boxes else np.zeros((_kernel.JOINT_NUMBERS, nv))
        if any(not np.array_equal(box.table, joints) for box in boxes):
            return None
        table = np.zeros((len(lines), _kernel.LIMIT_NUMBERS))
        for row, line in zip(table, lines, strict=True):
            row[: len(line or ())] = line or ()
        names = [name for limit in limits for name in limit.row_names]
        size = (ends[-1] if ends else 0) + nv
        return cls(
            nv,
            size,
            np.array(tasks, dtype=float).reshape(len(tasks), _kernel.TASK_NUMBERS),
            np.array(vectors, dtype=float).reshape(len(tasks), 2, nv),
            np.array([*ends, size], dtype=np.int64),
            np.array([*(level.speed_damping for level in levels), 0.0]),
            table,
            joints,
            len(names),
            (*arm.joints, *names),
        )


_ROWS = {_kernel.RCM: 2, _kernel.TIP: 3, _kernel.ROLL: 1, _kernel.POSE: 8}
"""Rows of a task; of the others, one a joint."""


def _own(item: Task | Limit) -> bool:
    """Whether program() is of the item's own class: a derived class may change anything."""
    return "program" in vars(type(item))
