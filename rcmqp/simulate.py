"""The control loop: scenario and controller in, recorded run out."""

from __future__ import annotations

import importlib.metadata
import platform
import time
from collections.abc import Callable, Generator

import numpy as np

from rcmqp._kernel import all_finite
from rcmqp.arm import ArmState
from rcmqp.controllers.base import SAFE_STOP, Command, Controller
from rcmqp.derived import Derived
from rcmqp.dualquaternion import Array
from rcmqp.errors import InvalidCommand, OptionError
from rcmqp.reference import Reference
from rcmqp.run import Run
from rcmqp.scenario import Scenario

PACKAGES = ("rcmqp", "pin", "numpy", "h5py", "example-robot-data", "proxsuite", "qpsolvers")


def simulate(
    scenario: Scenario,
    controller: Controller,
    progress: Callable[[int], None] | None = None,
) -> Run:
    """Run a controller on the scenario's plant, its trocar moving as the scenario says.

    The controller sees what the plant measures, and so does a steered path, which may end the
    run before its time; the record has the truth beside it, and every error in it is the true
    one. A state's velocity is the last command, not the measured one: it is commands that limits
    on the acceleration are for, and a measured velocity lags behind. Where the controller answers
    with its safe stop, the run goes on, and the record says when and why.

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
    arm, nv = insertion.arm, insertion.arm.nv
    q, q_measured = np.empty((2, n, arm.nq))
    angles, v, v_actual, v_measured = np.empty((4, n, arm.nv))
    x, x_d = np.empty((2, n, 8))
    J, solve_time = np.empty((n, 6, arm.nv)), np.empty(n)
    diagnostics: dict[str, Array] = {}
    stops: dict[str, list[int]] = {}

    controller.reset()
    drive = scenario.plant.start(arm, insertion.q_start, T, scenario.seed)
    command = drive.v
    source, seen = scenario.references(insertion), None
    for k in range(n):
        reference = _next(source, seen)
        if reference is None:
            n = k
            break
        q_seen, v_seen = drive.measure()
        state = seen = arm.state(q_seen, command)
        if q_seen is not drive.q:
            state = arm.state(drive.q, drive.v)
        v_actual[k] = drive.v
        start = time.perf_counter()
        answer = controller.step(seen, reference)
        solve_time[k] = time.perf_counter() - start
        _check_answer(answer, controller.name, nv, k * T)
        drive.step(answer.v)
        command = answer.v

        q[k], x[k], x_d[k], v[k] = state.q, state.x, reference.x_d, answer.v
        q_measured[k], v_measured[k] = seen.q, v_seen
        angles[k], J[k] = state.angles, state.J_local
        for name, value in answer.diagnostics.items():
            if name not in diagnostics:
                diagnostics[name] = np.full(n, np.nan)
            diagnostics[name][k] = value
        if answer.stop:
            stops.setdefault(answer.stop, []).append(k)
        if progress is not None and (k % 100 == 99 or k == n - 1):
            progress(k % 100 + 1)

    q, q_measured, v, v_actual, v_measured = (
        array[:n] for array in (q, q_measured, v, v_actual, v_measured)
    )
    derived = Derived(scenario, insertion).of({"x": x[:n], "x_d": x_d[:n], "J": J[:n]})
    return Run(
        scenario=scenario,
        controller=controller.name,
        options=controller.options,
        versions=versions(),
        joints=arm.joints,
        lower=arm.lower,
        upper=arm.upper,
        velocity_limit=arm.velocity,
        acceleration_limit=arm.acceleration,
        q=q,
        q_measured=q_measured,
        angles=angles[:n],
        v=v,
        v_actual=v_actual,
        v_measured=v_measured,
        **derived,
        solve_time=solve_time[:n],
        diagnostics={name: values[:n] for name, values in diagnostics.items()},
        about_diagnostics={**SAFE_STOP, **controller.diagnostics},
        stops=stops,
        urdf_sha256=arm.sha256,
    )


def _next(
    source: Generator[Reference, ArmState | None], seen: ArmState | None
) -> Reference | None:
    """The next reference, given what was measured at the last one; None at the end."""
    try:
        return source.send(seen)
    except StopIteration:
        return None


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide a run's numbers."""
    found = {name: importlib.metadata.version(name) for name in PACKAGES}
    return {"python": platform.python_version(), **found}


def _check_answer(answer: Command, name: str, nv: int, t: float) -> None:
    v = np.asarray(getattr(answer, "v", None))
    if v.shape != (nv,) or v.dtype.kind != "f" or not all_finite(v):
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
        and insertion.obstacles == scenario.obstacles
        and np.array_equal(insertion.q_start, insertion.arm.configuration(scenario.angles_start))
    )
    if not same:
        raise OptionError(
            f"the controller was made for another insertion than that of {scenario}; "
            "make it with scenario.insertion()"
        )
