"""Cycles collected into parts of a run, with the channels that are computed from them."""

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
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.channels import CHANNELS, PART
from rcmqp.runs.head import Named
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario
from rcmqp.world.carried import CarriedArm
from rcmqp.world.insertion import Insertion

_OBSERVED = ("tip_error", "effector_error", "orientation_error", "rcm_error", "depth", "tilt")
"""Columns of what _kernel.observed() sees."""


class Derived:
    """Computes channels of a run from the rows of its cycles, block after block.

    The blocks' sizes do not matter, to the bit. The tip of an instrument with a wrist is its tool,
    its depth is that of the tool along the shaft, and its orientation error is that from the
    orientation at the start.
    """

    def __init__(self, scenario: Scenario, insertion: Insertion) -> None:
        self._scenario, self._insertion = scenario, insertion
        self._done = 0
        self._x: Array | None = None

    def of(self, rows: Mapping[str, Array]) -> dict[str, Array]:
        """Compute the channels of the next rows.

        Args:
            rows: x, x_d (n, 8) as dual quaternions of either sign, J (n, 6, nv), the effector's
                Jacobian, and, for an instrument with a wrist, q (n, nq); time (n,) and
                pivot (n, 3), if they are not the scenario's.

        Returns:
            Arrays of n rows: every channel of Run that is not in what a cycle leaves; and x and
            x_d, with their signs as Run has them.
        """
        scenario, insertion = self._scenario, self._insertion
        cycles = range(self._done, self._done + len(rows["x"]))
        self._done = cycles.stop
        T = scenario.period
        pivot = rows["pivot"] if "pivot" in rows else scenario.pivots(cycles)
        even = T * np.arange(cycles.start, cycles.stop, dtype=float)
        x = self._continuous(rows["x"])
        x_d = dq.align_sign(rows["x_d"], x)
        axis = np.array(scenario.trocar.axis)
        tip, tip_d, seen = _kernel.observed(x, x_d, pivot, axis, insertion.tip_depth)
        if insertion.arm.wrist is not None:
            tool = np.array([insertion.state(q).tool_at[1:2] for q in rows["q"]])[:, 0]
            tip, along = dq.translation(tool), dq.rotate(dq.P(x), np.array([0.0, 0.0, 1.0]))
            seen[:, _OBSERVED.index("depth")] = np.sum((tip - pivot) * along, axis=1)
            turn = dq.quaternion_mul(dq.quaternion_conj(dq.P(tool)), dq.P(insertion.tool_start))
            seen[:, _OBSERVED.index("tip_error")] = np.linalg.norm(tip - tip_d, axis=1)
            seen[:, _OBSERVED.index("orientation_error")] = 2.0 * np.arctan2(
                np.linalg.norm(turn[:, 1:], axis=1), np.abs(turn[:, 0])
            )
        return {
            "time": rows.get("time", even),
            "pivot": pivot,
            "x": x,
            "x_d": x_d,
            "tip": tip,
            "tip_d": tip_d,
            **dict(zip(_OBSERVED, seen.T.copy(), strict=True)),
            "singular_value": _kernel.least_singular_values(rows["J"]),
        }

    def follow(self, x: Array) -> None:
        """Go on after n rows that were made elsewhere, with poses x (n, 8)."""
        self._done += len(x)
        self._x = x[-1:]

    def _continuous(self, x: Array) -> Array:
        """Poses (n, 8) with signs such that each is on the side of the one before."""
        before = x[:1] if self._x is None else self._x
        chain = np.concatenate([before, x])
        same = np.sum(chain[1:, :4] * chain[:-1, :4], axis=1) >= 0.0
        poses = np.cumprod(np.where(same, 1.0, -1.0))[:, None] * x
        self._x = poses[-1:]
        return np.asarray(poses)


ROW = (*(name for name, channel in CHANNELS.items() if channel.source == "cycle"), "J")
"""What a cycle leaves: channels of Run; and J (6, nv), the effector's Jacobian J_local."""


class Described(Named, Protocol):
    """A controller as a run's file describes it: a Controller, or its data in another process."""

    @property
    def given(self) -> Given: ...  # noqa: D102

    @property
    def diagnostics(self) -> Mapping[str, tuple[str, str]]: ...  # noqa: D102

    @property
    def insertion(self) -> Insertion: ...  # noqa: D102


class Cycles:
    """Collects cycles, and makes a Run of those since the last one.

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
        """Prepare a record that has no cycles yet.

        Args:
            scenario: what is run.
            controller: made for it.
            versions: of Python and packages, see simulate.versions().
            size: the most cycles that it can hold.
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
        """Take a cycle; see Recorder.append() for the arguments.

        Args:
            solve_time: how long the controller took [s].
            diagnostics: of its answer.
            stop: why the controller stopped safely; empty where it did not.
            row: what ROW names, C-contiguous arrays of float64.
            path_time: on the path's own clock [s].
            time: of the cycle [s].
            pivot: (3,) trocar in the world [m].
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
        """Go on after a part that was made elsewhere."""
        self._derived.follow(part.x)

    def _forget(self) -> None:
        self._times: list[float] = []
        self._path_times: list[float] = []
        self._seen: dict[str, list[ArrayLike]] = {}
        self._diagnostics: list[dict[str, float]] = []
        self._stops: dict[str, list[int]] = {}
