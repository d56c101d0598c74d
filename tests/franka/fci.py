"""Franka's own client at work: a controller's joint velocities, a cycle of 1 ms each."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self
from xml.etree import ElementTree

import numpy as np
import pylibfranka
from demands import PERIOD, TIP_DEPTH, Demand
from numpy.typing import ArrayLike

from rcmqp import (
    Arm,
    Insertion,
    Instrument,
    Reference,
    ViewCommand,
    load_arm,
    make_controller,
    view_pose,
)
from rcmqp.controllers.base import Controller
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm_limits import SpeedNearLimits
from rcmqp.world.insertion import rcm_error

URDF = Path(__file__).with_name("fr3.urdf")

HOME = (0.0, -0.6, 0.0, -2.05, 0.0, 1.45, 0.7854)
"""The shaft points straight down [rad]."""

MARGIN = 1e-3
"""Franka's client keeps that much inside each limit, in its unit, for what is cut off."""

LOST_IN_A_ROW = 3
"""The robot goes on with the last acceleration where a command is lost: so many may be, near a
speed limit. Franka's client allowed for three on the arm before this one."""

SETTLE = 50
"""Cycles at rest after a stop."""


def fr3(*, jerk: float = 5000.0) -> Arm:
    """Franka Research 3 with the limits that its controller checks.

    Args:
        jerk: its limit [rad/s^3]; infinite to leave it out.
    """
    acceleration = 10.0 - MARGIN
    kept = MARGIN + LOST_IN_A_ROW * PERIOD * acceleration
    limits = [
        {name: value for part in joint for name, value in part.attrib.items()}
        for joint in ElementTree.parse(URDF).iterfind("joint[@type='revolute']")
    ]
    lower, upper, speed, offset, deceleration = (
        [float(limit[name]) for limit in limits]
        for name in ("lower", "upper", "velocity", "velocity_offset", "deceleration_limit")
    )
    return load_arm(
        URDF,
        "fr3_link8",
        home=HOME,
        velocity=[each - kept for each in speed],
        acceleration=acceleration,
        jerk=jerk - 1.0,  # the robot tells its velocity in single precision
        speed_near_limits=SpeedNearLimits(
            tuple(each + kept for each in offset), tuple(deceleration), tuple(lower), tuple(upper)
        ),
    )


@dataclass
class Account:
    """What came of it.

    Attributes:
        cycles: that the robot counted.
        reflexes: what the robot stopped for, each time.
        unanswered: cycles that had no command in time, the dropped ones among them.
        dropped: commands that were left out on purpose.
        stops: safe stops.
        rcm_max_mm: largest distance of the commanded shaft from the trocar [mm].
        jerk_max: largest jerk commanded [rad/s^3].
        acceleration_max: largest acceleration commanded [rad/s^2].
        speed_max: largest share of a joint's speed limit.
    """

    cycles: int = 0
    reflexes: list[str] = field(default_factory=list)
    unanswered: int = 0
    dropped: int = 0
    stops: int = 0
    rcm_max_mm: float = 0.0
    jerk_max: float = 0.0
    acceleration_max: float = 0.0
    speed_max: float = 0.0

    def add(self, other: Account) -> None:
        """Count another motion in: of what is the largest, the larger one remains."""
        for name, value in vars(other).items():
            mine = getattr(self, name)
            setattr(self, name, max(mine, value) if "_max" in name else mine + value)


class Fci:
    """A connection to a robot, or to its simulator."""

    def __init__(self, address: str) -> None:
        self.robot = pylibfranka.Robot(address, pylibfranka.RealtimeConfig.kIgnore)

    def go_to(self, angles: ArrayLike) -> None:
        """Move the joints to ``angles`` (7,) [rad], smoothly, at rest at both ends."""
        with Motion(self.robot) as motion:
            way = np.asarray(angles) - np.array(motion.read()[0].q_d)
            s = np.linspace(0.0, 1.0, round(max(0.5, 1.5 * _largest(way)) / PERIOD))
            for ds in np.diff(s**3 * (10.0 - 15.0 * s + 6.0 * s**2)):
                motion.send(ds / PERIOD * way)
                motion.read()
            motion.finish()

    def drive(
        self,
        arm: Arm,
        demands: Sequence[Demand],
        *,
        controller: str = "hierarchical_qp",
    ) -> Account:
        """Let a controller follow what is asked, from where the arm is, and end at rest.

        The controller is told what the robot says of its own command: where a command was lost,
        the robot has gone on with the acceleration of the last one.

        Args:
            arm: with the limits that are to be kept.
            demands: what happens in each cycle; a safe stop follows.
            controller: its name.

        Returns:
            What came of it; a reflex of the robot ends it early.
        """
        account = Account()
        try:
            with Motion(self.robot) as motion, _no_garbage_collection():
                start = np.array(motion.read()[0].q_d)
                insertion = Insertion.on_shaft(arm, Instrument(), start, depth=TIP_DEPTH)
                made = make_controller(controller, insertion, PERIOD)
                _warm_up(made)
                _Drive(motion, made, account).run(demands)
                motion.finish()
        except pylibfranka.ControlException as error:
            account.reflexes.append(str(error))
            self.robot.automatic_error_recovery()
        return account


class Motion:
    """A motion by joint velocities; the client begins no other until this one is left."""

    def __init__(self, robot: pylibfranka.Robot) -> None:
        mode = pylibfranka.ControllerMode.JointImpedance
        self._control = robot.start_joint_velocity_control(mode)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        del self._control

    def read(self) -> tuple[pylibfranka.RobotState, int]:
        """The robot's next state, and how many cycles after the one before it."""
        state, since = self._control.readOnce()
        return state, round(since.to_sec() / PERIOD)

    def send(self, v: Array, *, last: bool = False) -> None:
        """Answer a state with a joint velocity (7,) [rad/s]."""
        command = pylibfranka.JointVelocities(v.tolist())
        command.motion_finished = last
        self._control.writeOnce(command)

    def finish(self) -> None:
        """End the motion of an arm that is at rest."""
        self.read()
        self.send(np.zeros(7), last=True)


class _Drive:
    """A motion under a controller."""

    def __init__(self, motion: Motion, controller: Controller, account: Account) -> None:
        self.motion, self.controller, self.account = motion, controller, account
        self.insertion = controller.insertion
        self.pivot = np.array(controller.insertion.trocar.pivot)

    def run(self, demands: Sequence[Demand]) -> None:
        """All of them, then a safe stop."""
        resting = 0
        for demand in demands:
            if demand.stop:
                self.account.stops += 1
                resting = SETTLE
            at_rest = self._cycle(demand, stop=resting > 0)
            if resting > 0 and at_rest:
                resting -= 1
                if resting == 0:
                    self.controller.reset()
        resting = SETTLE
        while resting > 0:
            resting -= self._cycle(Demand(None), stop=True)

    def _cycle(self, demand: Demand, *, stop: bool) -> bool:
        """Read, control, send; whether what was sent is rest."""
        account, insertion = self.account, self.insertion
        read, passed = self.motion.read()
        state = insertion.state(read.q_d, read.dq_d, read.ddq_d)
        if stop:
            v = self.controller.safe_stop(state, "asked to").v
        else:
            v = self.controller.step(state, self._reference(demand.view)).v
        if not demand.dropped:
            self.motion.send(v)
        passed = passed if account.cycles else 1  # nothing counts before the first command
        acceleration = (v - state.v) / PERIOD
        account.cycles += passed
        account.unanswered += max(0, passed - 1) + demand.dropped
        account.dropped += demand.dropped
        account.rcm_max_mm = max(account.rcm_max_mm, 1e3 * float(rcm_error(state.x, self.pivot)))
        account.acceleration_max = max(account.acceleration_max, _largest(acceleration))
        account.jerk_max = max(account.jerk_max, _largest(acceleration - state.a) / PERIOD)
        account.speed_max = max(account.speed_max, _largest(v / insertion.arm.velocity))
        return not v.any()

    def _reference(self, view: ViewCommand | None) -> Reference:
        insertion = self.insertion
        if view is not None:
            return view_pose(insertion.x_rcm, view)
        lost, nowhere = np.full(8, np.nan), np.full(3, np.nan)
        return Reference(lost, lost, nowhere, nowhere)


def _warm_up(controller: Controller) -> None:
    """Let everything run once that the loop will."""
    insertion = controller.insertion
    state = insertion.state(insertion.q_start)
    for _ in range(20):
        controller.step(state, view_pose(insertion.x_rcm, ViewCommand(0.01)))
        controller.safe_stop(state, "to warm up")
    controller.reset()


@contextlib.contextmanager
def _no_garbage_collection() -> Iterator[None]:
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _largest(values: Array) -> float:
    return float(np.abs(values).max())
