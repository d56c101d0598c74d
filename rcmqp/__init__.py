"""RCM control of serial arms: the trocar as a task, on Pinocchio."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rcmqp.controllers import (
        CONTROLLERS,
        Command,
        Controller,
        DualQuaternion,
        HierarchicalQP,
        make_controller,
    )
    from rcmqp.errors import RcmqpError
    from rcmqp.experiments.study.perform import perform
    from rcmqp.experiments.study.plan import Law, Study
    from rcmqp.limits import Constraint, JointLimits, Limit
    from rcmqp.realtime.run import run_realtime
    from rcmqp.references.hand import DeviceState, HandMapping, HandView
    from rcmqp.references.paths import Circle, HandTrace, ViewMoves
    from rcmqp.references.planner import Planner
    from rcmqp.references.view import Reference, Stamped, ViewCommand, view_pose
    from rcmqp.runs.loading import load_scenario, scenario_names
    from rcmqp.runs.metrics import Metrics, compute_metrics
    from rcmqp.runs.run import Run
    from rcmqp.runs.run_file import RunFile
    from rcmqp.runs.scenario import Scenario
    from rcmqp.runs.simulate import record, simulate
    from rcmqp.tasks import RcmTask, Residual, Task, TipTask
    from rcmqp.world.arm import Arm, ArmState
    from rcmqp.world.insertion import Insertion, rcm_error
    from rcmqp.world.instrument import Camera, Instrument, Trocar
    from rcmqp.world.loading import arm_names, load_arm
    from rcmqp.world.start import find_start

__version__ = "0.2.0"

_HOMES = {
    "controllers": "CONTROLLERS Command Controller DualQuaternion HierarchicalQP make_controller",
    "errors": "RcmqpError",
    "experiments.study.perform": "perform",
    "experiments.study.plan": "Law Study",
    "limits": "Constraint JointLimits Limit",
    "realtime.run": "run_realtime",
    "references.hand": "DeviceState HandMapping HandView",
    "references.paths": "Circle HandTrace ViewMoves",
    "references.planner": "Planner",
    "references.view": "Reference Stamped ViewCommand view_pose",
    "runs.loading": "load_scenario scenario_names",
    "runs.metrics": "Metrics compute_metrics",
    "runs.run": "Run",
    "runs.run_file": "RunFile",
    "runs.scenario": "Scenario",
    "runs.simulate": "record simulate",
    "tasks": "RcmTask Residual Task TipTask",
    "world.arm": "Arm ArmState",
    "world.insertion": "Insertion rcm_error",
    "world.instrument": "Camera Instrument Trocar",
    "world.loading": "arm_names load_arm",
    "world.start": "find_start",
}
"""Names by the module that has them, which is imported when one of them is used."""

_MODULES = {name: f"rcmqp.{home}" for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "CONTROLLERS",
    "Arm",
    "ArmState",
    "Camera",
    "Circle",
    "Command",
    "Constraint",
    "Controller",
    "DeviceState",
    "DualQuaternion",
    "HandMapping",
    "HandTrace",
    "HandView",
    "HierarchicalQP",
    "Insertion",
    "Instrument",
    "JointLimits",
    "Law",
    "Limit",
    "Metrics",
    "Planner",
    "RcmTask",
    "RcmqpError",
    "Reference",
    "Residual",
    "Run",
    "RunFile",
    "Scenario",
    "Stamped",
    "Study",
    "Task",
    "TipTask",
    "Trocar",
    "ViewCommand",
    "ViewMoves",
    "arm_names",
    "compute_metrics",
    "find_start",
    "load_arm",
    "load_scenario",
    "make_controller",
    "perform",
    "rcm_error",
    "record",
    "run_realtime",
    "scenario_names",
    "simulate",
    "view_pose",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'rcmqp' has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(_MODULES[name]), name)
    return found
