"""What a run's file says that follows from what a cycle leaves: errors, depth, tilt, and so on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rcmqp import _kernel
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.scenario import Scenario
from rcmqp.world.insertion import Insertion

_OBSERVED = ("tip_error", "effector_error", "orientation_error", "rcm_error", "depth", "tilt")
"""Columns of what _kernel.observed() sees."""


class Derived:
    """Channels of a run out of the rows that its cycles leave, block after block.

    The blocks' sizes do not matter, to the bit. The tip of an instrument with a wrist is its tool,
    its depth is that of the tool along the shaft, and its orientation error is that from the
    orientation at the start.
    """

    def __init__(self, scenario: Scenario, insertion: Insertion) -> None:
        self._scenario, self._insertion = scenario, insertion
        self._done = 0
        self._x: Array | None = None

    def of(self, rows: Mapping[str, Array]) -> dict[str, Array]:
        """What the next rows say.

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
            tool = np.array([insertion.state(q).tool_at[0] for q in rows["q"]])
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
        found = np.cumprod(np.where(same, 1.0, -1.0))[:, None] * x
        self._x = found[-1:]
        return np.asarray(found)
