"""The result of a trial: the numbers of Table I and some more, and thinned-out traces."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcmqp.experiments.study.plan import Law, Trial
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.operators import camera_trial, recognition_times
from rcmqp.references.operators.camera_task import reached
from rcmqp.references.paths import HandTrace, Search
from rcmqp.runs.metrics import compute_metrics
from rcmqp.runs.run import Run
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.setup import given_cells
from rcmqp.world.obstacles import clearance

TRACE_TIME = 8e-3
"""Least time between two samples of a trace [s]; the numbers of an Outcome use every cycle."""

SLOW = 0.01
"""Speed of the camera below which it counts as standing still [m/s]."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The numbers of a trial; NaN in a trial that failed.

    The vocabulary says what each number means, see TRIALS there. ``feed_forward``,
    ``roll``, ``limits_enforced``, ``gain``, ``assumed`` and ``setup`` are as given_cells() has
    them.
    ``failure`` says why a trial has no run; it is empty if there is a run.
    """

    operator: int | str
    group: str
    arm: str
    controller: str
    period: float
    feed_forward: str = ""
    roll: str = ""
    limits_enforced: str = ""
    gain: str = ""
    assumed: str = ""
    setup: str = ""
    finished: bool = False
    completion_s: float = np.nan
    reached_s: tuple[float, ...] = ()
    looking_s: float = np.nan
    tip_rms_mm: float = np.nan
    tip_max_mm: float = np.nan
    effector_rms_mm: float = np.nan
    effector_max_mm: float = np.nan
    rcm_rms_mm: float = np.nan
    rcm_max_mm: float = np.nan
    obstacle_tip_mm: float = np.nan
    obstacle_shaft_mm: float = np.nan
    collided: bool = False
    tip_speed_rms_mm_s: float = np.nan
    slow_share: float = np.nan
    rcm_rms_moving_mm: float = np.nan
    speed_ratio_max: float = np.nan
    limit_margin_min_rad: float = np.nan
    late_share: float = np.nan
    behind_s: float = np.nan
    behind_share: float = np.nan
    digest: str = ""
    failure: str = ""


def outcome_of(trial: Trial, run: Run) -> tuple[Outcome, dict[str, Array]]:
    """Sum up the run of a simulated operator's trial.

    Returns:
        The numbers; and the traces by name, see TRACES.
    """
    scenario = run.scenario
    path = camera_trial(scenario.path, scenario.name)
    outcome, traces = sum_up(run, trial.operator, path.operator.group, trial.law)
    done = [t for t in outcome.reached_s if not np.isnan(t)]
    starts = (0.0, *done[:-1])
    looking = recognition_times(path.operator, len(done), scenario.seed, path.learning, starts)
    return dataclasses.replace(outcome, looking_s=float(sum(looking))), traces


def task_of(scenario: Scenario) -> Search:
    """What is to be found in a scenario.

    Raises:
        OptionError: the path is neither a Search nor a CameraTrial.
    """
    if isinstance(scenario.path, Search):
        return scenario.path
    task = camera_trial(scenario.path, scenario.name).task
    return Search(task.targets, task.spheres, task.obstacle, task.tolerance)


def sum_up(
    run: Run, operator: int | str, group: str, law: Law
) -> tuple[Outcome, dict[str, Array]]:
    """Compute the numbers of a trial's run, steered by a person or by a simulated operator.

    A recorded hand has no task: nothing is found, and no obstacle is there.

    Returns:
        The numbers, without ``looking_s``; and the traces by name, see TRACES.
    """
    scenario = run.scenario
    insertion = scenario.insertion()
    task = None if isinstance(scenario.path, HandTrace) else task_of(scenario)
    back = dq.quaternion_conj(dq.P(insertion.x_rcm))
    pivot = np.array(scenario.trocar.pivot)
    tip, tip_d = (dq.rotate(back, points - pivot) for points in (run.tip, run.tip_d))
    shaft = insertion.instrument.length * dq.rotate(dq.P(run.x), np.array([0.0, 0.0, 1.0]))
    mount = dq.rotate(back, run.tip - shaft - pivot)
    camera = surface = np.full(len(tip), np.nan)
    if task is not None and (ball := task.obstacle) is not None:
        camera = np.linalg.norm(tip - np.array(ball.centre), axis=-1) - ball.radius
        surface = clearance(tip, mount, ball) - insertion.instrument.radius
    times = np.empty(0)
    if task is not None:
        times = reached(run.time, tip, np.array(task.places), task.tolerance)
    found = compute_metrics(run)
    slow = np.linalg.norm(np.diff(tip, axis=0, prepend=tip[:1]), axis=-1) < SLOW * run.period
    moving = float(np.sqrt(np.mean(run.rcm_error[~slow] ** 2))) if not slow.all() else np.nan
    values: dict[str, Any] = {name: getattr(found, name) for name in _FROM_METRICS}
    values |= given_cells(run.head)
    del values["period_ms"]  # the outcome has the period in seconds
    outcome = Outcome(
        operator,
        group,
        scenario.arm,
        str(law),
        scenario.period,
        finished=task is not None and not np.isnan(times[-1]),
        completion_s=float(times[-1]) if task is not None else np.nan,
        reached_s=tuple(map(float, times)),
        obstacle_tip_mm=1e3 * float(camera.min()),
        obstacle_shaft_mm=1e3 * float(surface.min()),
        collided=bool(surface.min() < 0.0),
        slow_share=float(np.mean(slow)),
        rcm_rms_moving_mm=1e3 * moving,
        digest=run.digest,
        **values,
    )
    thin = slice(None, None, max(1, round(TRACE_TIME / run.period)))
    traces = {
        "time": run.time,
        "tip": tip,
        "tip_d": tip_d,
        "tip_error": run.tip_error,
        "effector_error": run.effector_error,
        "rcm_error": run.rcm_error,
        "obstacle": surface,
    }
    return outcome, {name: values[thin].astype(np.float32) for name, values in traces.items()}


def failed_outcome(trial: Trial, scenario: Scenario, reason: str) -> Outcome:
    """Of a trial that came to no end."""
    path = camera_trial(scenario.path, scenario.name)
    group, law = path.operator.group, str(trial.law)
    return Outcome(trial.operator, group, scenario.arm, law, scenario.period, failure=reason)


TRACES: Mapping[str, tuple[str, str]] = {
    "time": ("s", "(n,) sampling instants kept"),
    "tip": ("m", "(n, 3) tip, from the trocar in the axes of x_d(0)"),
    "tip_d": ("m", "(n, 3) desired tip, likewise"),
    "tip_error": ("m", "(n,) distance of the tip from the desired one"),
    "effector_error": ("m", "(n,) distance of the effector from the desired one"),
    "rcm_error": ("m", "(n,) distance of the trocar from the shaft's axis"),
    "obstacle": ("m", "(n,) distance of the shaft's surface from the obstacle's"),
}
"""Unit and meaning of each trace; float32, every 8 ms."""

_FROM_METRICS = tuple(
    item.name
    for item in dataclasses.fields(Outcome)
    if item.name.endswith(("_rms_mm", "_max_mm", "rms_mm_s", "ratio_max", "min_rad"))
    or item.name.startswith(("late_", "behind_"))
)
