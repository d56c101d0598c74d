"""RCM control of serial arms: the trocar as a task, on Pinocchio."""

from rcmqp.arm import Arm, ArmState
from rcmqp.controllers import Command, Controller, make_controller
from rcmqp.errors import RcmqpError
from rcmqp.insertion import Insertion
from rcmqp.instrument import Camera, Instrument, Trocar
from rcmqp.loading import arm_names, load_arm
from rcmqp.metrics import Metrics, compute_metrics
from rcmqp.reference import Reference, ViewCommand, view_pose
from rcmqp.run import Run
from rcmqp.run_file import RunFile
from rcmqp.scenario import Scenario
from rcmqp.scenario_loading import load_scenario, scenario_names
from rcmqp.simulate import record, simulate
from rcmqp.start import find_start

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
