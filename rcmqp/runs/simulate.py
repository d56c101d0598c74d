"""The control loop: scenario and controller in, recorded run out."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import time
from collections.abc import Callable, Iterator

import numpy as np

from rcmqp._kernel import all_finite
from rcmqp.controllers.base import Command, Controller
from rcmqp.errors import InvalidCommand, InvalidProblem, OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.runs.channels import PART
from rcmqp.runs.cycles import Cycles
from rcmqp.runs.recorder import Recorder
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario

PACKAGES = ("rcmqp", "pin", "numpy", "h5py", "example-robot-data", "proxsuite", "qpsolvers")


def simulate(
    scenario: Scenario,
    controller: Controller,
    progress: Callable[[int], None] | None = None,
) -> Run:
    """Run a controller on the scenario's plant, its trocar moving as the scenario says.

    The controller sees what the plant measures, and so does a steered path, which may end the
    run before its time; the record has the truth beside it, and every error in it is the true
    one. A state's velocity is the last command, not the measured one, and its acceleration the
    last change of the command: limits are for commands, and a measured velocity lags behind.
    Where the controller answers with its safe stop, the run goes on, and the record says when
    and why.

    Args:
        scenario: what to do.
        controller: made for the same scenario: its insertion and its period.
        progress: called now and then with the number of cycles done since the last call.

    Raises:
        OptionError: the controller was made for another period or another insertion, or the
            arguments are exchanged.
        InvalidProblem: an error, such as a task or a limit of a wrong shape, keeps the
            controller from its first step.
        RcmqpError: whatever the path or the controller refuses.
    """
    _check_order("simulate", scenario, controller)
    return Run.joined(parts(scenario, controller, progress), scenario.cycles)


def record(
    scenario: Scenario,
    controller: Controller,
    path: str | os.PathLike[str],
    progress: Callable[[int], None] | None = None,
) -> None:
    """Simulate like simulate(), but stream the run to a file, with one part of it in memory.

    The file is what Run.save() would write; an earlier one is kept until it is there. RunFile
    looks at it in as little memory.

    Args:
        scenario: what to do.
        controller: made for the same scenario.
        path: of the file.
        progress: see simulate().

    Raises:
        RunFileError: the file cannot be written.
        RcmqpError: as simulate() does.
    """
    _check_order("record", scenario, controller)
    with Recorder(path, scenario, controller, versions()) as recorder:
        for part in parts(scenario, controller, progress):
            recorder.write(part)


def parts(
    scenario: Scenario,
    controller: Controller,
    progress: Callable[[int], None] | None = None,
    size: int = PART,
) -> Iterator[Run]:
    """The run of simulate() while it goes on: parts of ``size`` cycles, the last one shorter."""
    _check_made_for(scenario, controller)
    insertion, T = controller.insertion, scenario.period
    arm, clock = insertion.arm, time.perf_counter
    cycles = Cycles(scenario, controller, versions(), size)
    controller.reset()
    drive = scenario.plant.start(arm, insertion.q_start, T, scenario.seed)
    command, seen = drive.v, None
    acceleration = np.zeros(arm.nv)
    path_clock = scenario.clock()
    ask = scenario.references(insertion, path_clock).send
    for k in range(scenario.cycles):
        try:
            reference = ask(seen)
        except StopIteration:
            break
        q, v = drive.q, drive.v
        q_seen, v_seen = drive.measure()
        state = seen = arm.state(q_seen, command, acceleration)
        if q_seen is not q:
            state = arm.state(q, v)
        start = clock()
        answer = controller.step(seen, reference)
        solve_time = clock() - start
        before, command = command, _checked(answer, controller.name, arm.nv, k * T)
        acceleration = (command - before) / T
        if k == 0:
            _check_possible(answer)
        drive.step(command)
        cycles.add(
            solve_time,
            answer.diagnostics,
            answer.stop,
            state.q,
            seen.q,
            state.angles,
            command,
            v,
            v_seen,
            state.x,
            reference.x_d,
            state.J_local,
            path_time=None if path_clock is None else path_clock.time,
        )
        if progress is not None and (k % 100 == 99 or k == scenario.cycles - 1):
            progress(k % 100 + 1)
        if len(cycles) == cycles.size:
            yield cycles.part()
    if len(cycles):
        yield cycles.part()


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide a run's numbers."""
    installed = {name: importlib.metadata.version(name) for name in PACKAGES}
    return {"python": platform.python_version(), **installed}


def _checked(answer: Command, name: str, nv: int, t: float) -> Array:
    """The velocity (nv,) of an answer.

    Raises:
        InvalidCommand: it is not a Command with nv finite numbers.
    """
    v = getattr(answer, "v", None)
    if not (
        isinstance(v, np.ndarray) and v.shape == (nv,) and v.dtype.kind == "f" and all_finite(v)
    ):
        raise InvalidCommand(
            f"controller {name!r} answered {answer} at t = {t:.6g} s; it must be a Command with "
            f"{nv} finite joint velocities"
        )
    return np.ascontiguousarray(v, dtype=float)


def _check_possible(first: Command) -> None:
    """Refuse a controller whose first step fails with an error: later steps would fail too.

    Raises:
        InvalidProblem: from the error.
    """
    error = first.error
    if error is not None:
        reason = str(error) if isinstance(error, InvalidProblem) else first.stop
        raise InvalidProblem(f"the controller cannot make a single step: {reason}") from error


def _check_order(function: str, scenario: object, controller: object) -> None:
    if isinstance(scenario, Controller) and isinstance(controller, Scenario):
        raise OptionError(
            f"the arguments are exchanged; call {function}() with the scenario first, then the "
            "controller"
        )


def _check_made_for(scenario: Scenario, controller: Controller) -> None:
    if controller.period != scenario.period:
        raise OptionError(
            f"the controller was made for a period of {controller.period} s, "
            f"the scenario has {scenario.period} s"
        )
    insertion = controller.insertion
    start = np.zeros(insertion.arm.nv)  # of a wrist's joints that the scenario leaves out
    start[: len(scenario.angles_start)] = scenario.angles_start[: len(start)]
    same = (
        insertion.arm.name == scenario.arm
        and scenario.flange in (None, insertion.arm.flange)
        and insertion.trocar == scenario.trocar
        and insertion.instrument == scenario.instrument
        and insertion.obstacles == scenario.obstacles
        and np.array_equal(insertion.q_start, insertion.arm.configuration(start))
    )
    if not same:
        raise OptionError(
            f"the controller was made for another insertion than that of {scenario}; "
            "make it with scenario.insertion()"
        )
    if not scenario.has_limits_of(insertion.bare):
        raise OptionError(
            f"the controller's arm has other joint limits than that of {scenario}; make the "
            "controller with scenario.insertion(), or the scenario with Scenario.of(name, "
            "insertion, path), which keeps the limits of the insertion's arm"
        )
