"""One quadratic program in each cycle: least squares inside limits."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.controllers.stack import Evaluated, Stack
from rcmqp.errors import OptionError
from rcmqp.limits import Limit
from rcmqp.qp import HierarchySolution
from rcmqp.references.view import Reference
from rcmqp.tasks import Task, Together
from rcmqp.tasks.base import CompiledTask
from rcmqp.world.arm import Arm, ArmState

NUMBERS = ("residual", "exact", "bounded", "excess", "kkt")
"""What a Stack of one level records of a step."""

INFEASIBLE = "the inequalities cannot all hold"


@dataclass(frozen=True, eq=False)
class Still(CompiledTask):
    """Keep the joints still: e = 0, de/dt = v. On a level with others it damps: weight |v|^2."""

    name: ClassVar[str] = "still"
    unit: ClassVar[str] = "rad"

    @functools.cached_property
    def block(self) -> Block:
        """Error (nv,), zero."""
        return Block("still")


class OneLevel:
    """A sum of weighted squares to be minimised inside limits, in compiled code.

    It is a hierarchy of one strict level, so the answer is computed in closed form, or by the
    active set that a backend proposes, and verified; see Hierarchy.

    Attributes:
        stack: levels and limits.
    """

    def __init__(
        self, tasks: Sequence[Task], limits: Sequence[Limit], arm: Arm, period: float, backend: str
    ) -> None:
        """Make the compiled part.

        Args:
            tasks: at least one; their dampings must be zero.
            limits: in the order in which they narrow the box.
            arm: whose joints the unknowns are.
            period: sampling period T [s].
            backend: see Hierarchy.

        Raises:
            OptionError: a task is damped.
            OptionError, UnknownName, SolverNotInstalled: see Stack.
        """
        if damped := [type(task).__name__ for task in tasks if task.speed_damping]:
            raise OptionError(
                f"{', '.join(damped)} damped; one level of weighted squares has no dampings: give "
                "damping=0.0, and a Still task for what is to cost speed"
            )
        self.stack = Stack(
            [Together(tuple(tasks))],
            limits,
            arm,
            period,
            approach=0.0,
            backend=backend,
            guarded=0,
            numbers=NUMBERS,
        )

    def reset(self) -> None:
        """Forget the warm start."""
        self.stack.reset()

    def solve(
        self, state: ArmState, reference: Reference, evaluated: Evaluated | None = None
    ) -> tuple[HierarchySolution, str]:
        """The optimum, and why it is not to be used; empty if it is.

        Args:
            state: of the arm.
            reference: what the tasks are asked for.
            evaluated: what the limits that are written in Python give, where it is known.

        Raises:
            InvalidProblem: what they give is not usable.
        """
        solution = self.stack.step(state, reference, evaluated)
        numbers = solution.recorded
        if numbers["excess"] > 0.0 and not solution.limits_hold:
            return solution, INFEASIBLE
        return solution, "" if numbers["exact"] else "no verified optimum"
