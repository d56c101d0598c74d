"""RCM control of serial arms: the trocar as a task, on Pinocchio."""

from rcmqp.controllers import Command, Controller, make_controller
from rcmqp.errors import RcmqpError
from rcmqp.references.view import Reference, ViewCommand, view_pose
from rcmqp.runs.loading import load_scenario, scenario_names
from rcmqp.runs.metrics import Metrics, compute_metrics
from rcmqp.runs.run import Run
from rcmqp.runs.run_file import RunFile
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import record, simulate
from rcmqp.world.arm import Arm, ArmState
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Camera, Instrument, Trocar
from rcmqp.world.loading import arm_names, load_arm
from rcmqp.world.start import find_start

__version__ = "0.1.0"

__all__ = [
    "Arm",
    "ArmState",
    "Camera",
    "Command",
    "Controller",
    "Insertion",
    "Instrument",
    "Metrics",
    "RcmqpError",
    "Reference",
    "Run",
    "RunFile",
    "Scenario",
    "Trocar",
    "ViewCommand",
    "arm_names",
    "compute_metrics",
    "find_start",
    "load_arm",
    "load_scenario",
    "make_controller",
    "record",
    "scenario_names",
    "simulate",
    "view_pose",
]
