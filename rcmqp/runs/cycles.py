"""What cycles leave, one by one, put together to parts of a run."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.controllers.base import SAFE_STOP
from rcmqp.controllers.given import Given
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.channels import CHANNELS, PART
from rcmqp.runs.derived import Derived
from rcmqp.runs.head import Named
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario
from rcmqp.world.carried import CarriedArm
from rcmqp.world.insertion import Insertion

ROW = (*(name for name, channel in CHANNELS.items() if channel.source == "cycle"), "J")
"""What a cycle leaves: channels of Run; and J (6, nv), the effector's Jacobian J_local."""


class Described(Named, Protocol):
    """What a run's file says of a controller: a Controller, or what is known of one elsewhere."""

    @property
    def given(self) -> Given: ...  # noqa: D102

    @property
    def diagnostics(self) -> Mapping[str, tuple[str, str]]: ...  # noqa: D102

    @property
    def insertion(self) -> Insertion: ...  # noqa: D102


class Cycles:
    """Takes what each cycle leaves, and gives the Run that the cycles since the last one make.

    The parts' sizes do not matter, to the bit.

    Attributes:
        shapes: of what ROW names.
        size: cycles that there is room for.
    """

    def __init__(
        self,
        scenario: Scenario,
        controller: Described,
        versions: Mapping[str, str],
        size: int = PART,
    ) -> None:
        """Before the first cycle.

        Args:
            scenario: what is run.
            controller: made for it.
            versions: of Python and packages, see simulate.versions().
            size: cycles that there is room for.
        """
        arm = controller.insertion.arm
        self._scenario, self._controller, self._versions = scenario, controller, dict(versions)
        if (carried := CarriedArm.of(arm)) is not None:
            self._scenario = dataclasses.replace(scenario.portable(), carried_arm=carried)
        given = self._scenario.angles_start
        wrist = tuple(controller.insertion.angles_start[len(given) :])  # where it leaves them out
        self._scenario = dataclasses.replace(self._scenario, angles_start=given + wrist)
        self._derived = Derived(scenario, controller.insertion)
        sizes = {"n": 1, "nq": arm.nq, "nv": arm.nv}
        self.shapes = {name: CHANNELS[name].sizes(**sizes)[1:] for name in ROW if name != "J"}
        self.shapes["J"] = (6, arm.nv)
        self.size = size
        self._ends = np.cumsum([math.prod(shape) for shape in self.shapes.values()]).tolist()
        self._table = np.empty((size, self._ends[-1]))
        self._forget()

    def __len__(self) -> int:
        """Cycles since the last part."""
        return len(self._times)

    def add(
        self,
        solve_time: float,
        diagnostics: Mapping[str, float],
        stop: str,
        *row: Array,
        path_time: float | None = None,
        time: float | None = None,
        pivot: ArrayLike | None = None,
    ) -> None:
        """Take a cycle.

        Args:
            solve_time: how long the controller took [s].
            diagnostics: of its answer; a number that is not there every time is NaN where it
                is not.
            stop: why the controller stopped safely; empty where it did not.
            row: what ROW names, C-contiguous arrays of float64.
            path_time: on the path's own clock [s]; the time, if not given.
            time: when the cycle was [s]; one period after the last, if no cycle's is given.
            pivot: (3,) trocar in the world [m]; where the scenario has it, if no cycle's is given.
        """
        _kernel.store(self._table, len(self._times), *row)
        self._times.append(solve_time)
        self._path_times.append(math.nan if path_time is None else path_time)
        if time is not None:
            self._seen.setdefault("time", []).append(time)
        if pivot is not None:
            self._seen.setdefault("pivot", []).append(pivot)
        self._diagnostics.append(dict(diagnostics))
        if stop:
            self._stops.setdefault(stop, []).append(len(self._times) - 1)

    def part(self) -> Run:
        """The run of the cycles since the last part, which are forgotten."""
        columns = np.split(self._table[: len(self)], self._ends[:-1], axis=1)
        rows = {
            name: np.array(column, order="C").reshape(-1, *shape)
            for column, (name, shape) in zip(columns, self.shapes.items(), strict=True)
        }
        names = dict.fromkeys(itertools.chain.from_iterable(self._diagnostics))
        diagnostics = {
            name: np.array([numbers.get(name, math.nan) for numbers in self._diagnostics])
            for name in names
        }
        rows |= {name: np.array(values, dtype=float) for name, values in self._seen.items()}
        rows |= self._derived.of(rows)
        del rows["J"]
        path_time = np.array(self._path_times)
        rows["path_time"] = np.where(np.isnan(path_time), rows["time"], path_time)
        controller, arm = self._controller, self._controller.insertion.arm
        made = Run(
            scenario=self._scenario,
            controller=controller.name,
            options=controller.options,
            versions=self._versions,
            joints=arm.joints,
            urdf_sha256=arm.sha256,
            lower=arm.lower,
            upper=arm.upper,
            velocity_limit=arm.velocity,
            acceleration_limit=arm.acceleration,
            jerk_limit=arm.jerk,
            assumed=tuple(sorted(arm.assumed)),
            given=controller.given,
            arm=self._scenario.carried_arm,
            **rows,
            solve_time=np.array(self._times),
            diagnostics=diagnostics,
            about_diagnostics={**SAFE_STOP, **controller.diagnostics},
            stops=self._stops,
        )
        self._forget()
        return made

    def follow(self, part: Run) -> None:
        """Go on after a part that was made elsewhere; none is left to be made here."""
        self._derived.follow(part.x)

    def _forget(self) -> None:
        self._times: list[float] = []
        self._path_times: list[float] = []
        self._seen: dict[str, list[ArrayLike]] = {}
        self._diagnostics: list[dict[str, float]] = []
        self._stops: dict[str, list[int]] = {}
