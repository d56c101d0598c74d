"""The control loop: scenario and controller in, recorded run out."""

from __future__ import annotations

import importlib.metadata
import platform
import time
from collections.abc import Callable

import numpy as np

from rcmqp import dualquaternion as dq
from rcmqp.controllers.base import Controller
from rcmqp.dualquaternion import Array
from rcmqp.errors import OptionError
from rcmqp.insertion import insertion_depth, rcm_error
from rcmqp.reference import view_pose
from rcmqp.run import Run
from rcmqp.scenario import Scenario

PACKAGES = ("rcmqp", "pin", "numpy", "proxsuite", "qpsolvers")


def simulate(
    scenario: Scenario,
    controller: Controller,
    progress: Callable[[int], None] | None = None,
) -> Run:
    """Run a controller on an ideal kinematic arm: each joint does at once what it is told.

    Args:
        scenario: what to do.
        controller: made for the same scenario: its insertion and its period.
        progress: called now and then with the number of cycles done since the last call.

    Raises:
        OptionError: the controller was made for another period or another insertion.
        RcmqpError: whatever the path or the controller refuses.
    """
    insertion, T, n = controller.insertion, scenario.period, scenario.cycles
    _check_made_for(scenario, controller)
    arm, planner = insertion.arm, scenario.planner(insertion.x_rcm)
    q, x, x_d = np.empty((n, arm.nq)), np.empty((n, 8)), np.empty((n, 8))
    angles, v, J = np.empty((n, arm.nv)), np.empty((n, arm.nv)), np.empty((n, 6, arm.nv))
    solve_time = np.empty(n)
    diagnostics: dict[str, Array] = {}

    controller.reset()
    q_k = insertion.q_start
    for k in range(n):
        command = scenario.path.command(k * T, insertion.tip_depth)
        reference = view_pose(insertion.x_rcm, command)
        if planner is not None:
            reference = planner.step(reference)
        state = arm.state(q_k)
        start = time.perf_counter()
        answer = controller.step(state, reference)
        solve_time[k] = time.perf_counter() - start
        q_k = arm.integrate(q_k, answer.v, T)

        q[k], x[k], x_d[k], v[k] = state.q, state.x, reference.x_d, answer.v
        angles[k], J[k] = state.angles, state.J_local
        for name, value in answer.diagnostics.items():
            diagnostics.setdefault(name, np.full(n, np.nan))[k] = value
        if progress is not None and (k % 100 == 99 or k == n - 1):
            progress(k % 100 + 1)

    pivot = np.array(scenario.trocar.pivot)
    tip, tip_d = insertion.tip(x), insertion.tip(x_d)
    return Run(
        scenario=scenario,
        controller=controller.name,
        options=controller.options,
        versions=versions(),
        joints=arm.joints,
        lower=arm.lower,
        upper=arm.upper,
        velocity_limit=arm.velocity,
        time=T * np.arange(n, dtype=float),
        q=q,
        angles=angles,
        v=v,
        x=x,
        x_d=x_d,
        tip=tip,
        tip_d=tip_d,
        tip_error=np.linalg.norm(tip - tip_d, axis=-1),
        effector_error=np.linalg.norm(dq.translation(x) - dq.translation(x_d), axis=-1),
        orientation_error=dq.angle_between(x, x_d),
        rcm_error=rcm_error(x, pivot),
        depth=insertion_depth(x, pivot, insertion.tip_depth),
        singular_value=np.asarray(np.linalg.svd(J, compute_uv=False)[:, -1], dtype=float),
        solve_time=solve_time,
        diagnostics=diagnostics,
    )


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide a run's numbers."""
    found = {name: importlib.metadata.version(name) for name in PACKAGES}
    return {"python": platform.python_version(), **found}


def _check_made_for(scenario: Scenario, controller: Controller) -> None:
    if controller.period != scenario.period:
        raise OptionError(
            f"the controller was made for a period of {controller.period} s, "
            f"the scenario has {scenario.period} s"
        )
    insertion = controller.insertion
    same = (
        insertion.arm.name == scenario.arm
        and insertion.trocar == scenario.trocar
        and insertion.instrument == scenario.instrument
        and np.array_equal(insertion.q_start, insertion.arm.configuration(scenario.angles_start))
    )
    if not same:
        raise OptionError(
            f"the controller was made for another insertion than that of {scenario}; "
            "make it with scenario.insertion()"
        )
