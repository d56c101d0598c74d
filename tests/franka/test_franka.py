"""Franka's own client drives the open simulator of its interface, limits enforced.

Run by ``make franka``, which installs the client; ``make test`` leaves this folder out.
"""

from __future__ import annotations

import dataclasses
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from demands import DEMANDS, Demand, smooth_turn, view_steps
from fci import HOME, URDF, Account, Fci, fr3
from simulator import FOLDER, Simulator, simulator

from rcmqp import ViewCommand

RCM_MM = 0.005
"""How far the commanded shaft may be off the trocar [mm]."""


@pytest.fixture(scope="module")
def running() -> Iterator[Simulator]:
    with simulator() as started:
        yield started


@pytest.fixture(scope="module")
def connection(running: Simulator) -> Fci:
    """The one that there is: a robot has one client."""
    return Fci(running.address)


@pytest.fixture
def robot(connection: Fci) -> Fci:
    """A robot that is at home."""
    connection.go_to(HOME)
    return connection


def story(account: Account, running: Simulator) -> str:
    return "\n".join([str(account), "the simulator says:", *running.complaints()[-5:]])


# The arm -----------------------------------------------------------------------------------


def test_the_arm_is_the_simulators(robot: Fci) -> None:
    state = robot.robot.read_once()
    wrist = fr3().with_effector(pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.107])))
    found = wrist.state(np.array(state.q)).oMe.homogeneous  # without a hand it tells joint 7's
    expected = np.array(state.O_T_EE).reshape(4, 4).T
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-5)


def test_the_limits_are_the_simulators() -> None:
    served = next(FOLDER.glob("lib/python*/site-packages/franka_sim/models/fr3.urdf"))
    assert _limits(URDF) == _limits(served)
    assert len(_limits(URDF)) == 7


def _limits(urdf: Path) -> list[dict[str, float]]:
    """Of each joint that turns: everything that its two elements of limits say."""
    joints = ET.parse(urdf).getroot().iterfind("joint[@type='revolute']")
    elements = ("limit", "position_based_velocity_limits")
    return [
        {key: float(value) for name in elements for key, value in joint.find(name).items()}  # type: ignore[union-attr]
        for joint in joints
    ]


# The checks are at work --------------------------------------------------------------------


def test_without_a_jerk_limit_the_robot_stops(robot: Fci, running: Simulator) -> None:
    account = robot.drive(fr3(jerk=math.inf), view_steps())
    assert len(account.reflexes) == 1, story(account, running)
    assert "joint_motion_generator_acceleration_discontinuity" in account.reflexes[0]


def test_a_smooth_turn_passes_and_so_it_does_with_a_command_lost(
    robot: Fci, running: Simulator
) -> None:
    demands = smooth_turn()
    account = robot.drive(fr3(), demands)
    assert account.reflexes == [], story(account, running)
    demands[700] = dataclasses.replace(demands[700], dropped=True)
    account = robot.drive(fr3(), demands)
    assert account.reflexes == [], story(account, running)
    assert (account.dropped, account.unanswered >= 1) == (1, True)
    assert account.rcm_max_mm < RCM_MM


# Our controller ----------------------------------------------------------------------------


@pytest.mark.parametrize("made", DEMANDS.values(), ids=DEMANDS)
def test_the_robot_never_stops_by_itself(
    made: Callable[[], list[Demand]], robot: Fci, running: Simulator
) -> None:
    account = robot.drive(fr3(), made())
    assert account.reflexes == [], story(account, running)
    assert account.rcm_max_mm <= RCM_MM, story(account, running)


# Last, as the simulator goes on naming what it stopped for here ------------------------------


def test_twenty_commands_lost_in_a_row_stop_the_robot(robot: Fci) -> None:
    view = ViewCommand()
    demands = [Demand(view, dropped=200 <= k < 220) for k in range(500)]
    account = robot.drive(fr3(), demands)
    assert len(account.reflexes) == 1
    assert "communication_constraints_violation" in account.reflexes[0]
