"""The control loop: scenario and controller in, recorded run out."""

from __future__ import annotations

import importlib.metadata
import platform
import time
from collections.abc import Callable

import numpy as np

from rcmqp import dualquaternion as dq
from rcmqp.controllers.base import Command, Controller
from rcmqp.dualquaternion import Array
from rcmqp.errors import InsertionError, InvalidCommand, OptionError
from rcmqp.insertion import Insertion, insertion_depth, rcm_error, tilt
from rcmqp.reference import ViewCommand, view_pose
from rcmqp.run import Run
from rcmqp.scenario import Scenario

PACKAGES = ("rcmqp", "pin", "numpy", "h5py", "example-robot-data", "proxsuite", "qpsolvers")


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
        _check_reach(insertion, command, k * T)
        reference = view_pose(insertion.x_rcm, command)
        if planner is not None:
            reference = planner.step(reference)
        state = arm.state(q_k)
        start = time.perf_counter()
        answer = controller.step(state, reference)
        solve_time[k] = time.perf_counter() - start
        _check_answer(answer, controller.name, arm.nv, k * T)
        q_k = arm.integrate(q_k, answer.v, T)

        q[k], x[k], x_d[k], v[k] = state.q, state.x, reference.x_d, answer.v
        angles[k], J[k] = state.angles, state.J_local
        for name, value in answer.diagnostics.items():
            if name not in diagnostics:
                diagnostics[name] = np.full(n, np.nan)
            diagnostics[name][k] = value
        if progress is not None and (k % 100 == 99 or k == n - 1):
            progress(k % 100 + 1)

    pivot = np.array(scenario.trocar.pivot)
    x = _continuous(x)
    x_d = dq.align_sign(x_d, x)
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
        tilt=tilt(x, np.array(scenario.trocar.axis)),
        singular_value=np.asarray(np.linalg.svd(J, compute_uv=False)[:, -1], dtype=float),
        solve_time=solve_time,
        diagnostics=diagnostics,
        about_diagnostics=controller.diagnostics,
        urdf_sha256=arm.sha256,
    )


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide a run's numbers."""
    found = {name: importlib.metadata.version(name) for name in PACKAGES}
    return {"python": platform.python_version(), **found}


def _continuous(x: Array) -> Array:
    """Poses (n, 8) with signs such that each is on the side of the one before."""
    same = np.sum(x[1:, :4] * x[:-1, :4], axis=1) >= 0.0
    signs = np.concatenate([[1.0], np.cumprod(np.where(same, 1.0, -1.0))])
    return signs[:, None] * x


def _check_reach(insertion: Insertion, command: ViewCommand, t: float) -> None:
    depth, length = insertion.tip_depth + command.t_z, insertion.instrument.length
    if depth > length:
        raise InsertionError(
            f"at t = {t:.6g} s the view asks for the tip {1e3 * depth:.1f} mm inside, the shaft "
            f"is only {1e3 * length:.1f} mm long; make the path shallower or the shaft longer"
        )


def _check_answer(answer: Command, name: str, nv: int, t: float) -> None:
    v = np.asarray(getattr(answer, "v", None))
    if v.shape != (nv,) or v.dtype.kind != "f" or not np.isfinite(v).all():
        raise InvalidCommand(
            f"controller {name!r} answered {answer} at t = {t:.6g} s; it must be a Command with "
            f"{nv} finite joint velocities"
        )


def _check_made_for(scenario: Scenario, controller: Controller) -> None:
    if controller.period != scenario.period:
        raise OptionError(
            f"the controller was made for a period of {controller.period} s, "
            f"the scenario has {scenario.period} s"
        )
    insertion = controller.insertion
    same = (
        insertion.arm.name == scenario.arm
        and scenario.flange in (None, insertion.arm.flange)
        and insertion.trocar == scenario.trocar
        and insertion.instrument == scenario.instrument
        and np.array_equal(insertion.q_start, insertion.arm.configuration(scenario.angles_start))
    )
    if not same:
        raise OptionError(
            f"the controller was made for another insertion than that of {scenario}; "
            "make it with scenario.insertion()"
        )
