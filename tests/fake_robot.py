"""A clock that tests set, and a robot that does as it is told, for the real-time loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import pytest
from helpers import across
from numpy.typing import ArrayLike

import rcmqp
from rcmqp.controllers import Command, Controller
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.report import LoopReport
from rcmqp.realtime.run import HOLD, Stamped, run_realtime
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState

T = 0.001
TICK = 1e-6
HELD = round(HOLD / T)


class Clock:
    """Each look at it takes a microsecond; sleeping takes as long as asked, and ``extra``."""

    def __init__(self, extra: float = 0.0) -> None:
        self.now, self.extra = 100.0, extra
        self.slept: list[float] = []

    def __call__(self) -> float:
        self.now += TICK
        return self.now

    def sleep(self, duration: float) -> None:
        assert duration > 0.0
        self.slept.append(duration)
        self.now += duration + self.extra


@dataclass
class Arm:
    """Joints that move as commanded; ``on_read`` and ``on_send`` are called with a count."""

    insertion: rcmqp.Insertion
    clock: Clock
    on_read: Callable[[int], None] = lambda k: None
    on_send: Callable[[int], None] = lambda k: None
    spoil: Callable[[int, Array], Array] = lambda k, q: q
    spoil_v: Callable[[int, Array], Array] = lambda k, v: v
    read_at: list[float] = field(default_factory=list)
    sent: list[Array] = field(default_factory=list)
    sent_at: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.q, self.v = np.array(self.insertion.q_start), np.zeros(self.insertion.arm.nv)

    def moving(self, v: Array) -> Arm:
        """The same, already moving."""
        self.v = v
        return self

    def read(self) -> tuple[ArrayLike, ArrayLike]:
        self.read_at.append(self.clock.now)
        self.on_read(len(self.sent))
        k = len(self.sent)
        return self.spoil(k, self.q.copy()), self.spoil_v(k, self.v)

    def send(self, v: Array) -> None:
        self.on_send(len(self.sent))
        assert not v.flags.writeable
        self.sent.append(v.copy())
        self.sent_at.append(self.clock.now)
        self.q, self.v = self.insertion.arm.integrate(self.q, v, T), v


def view(insertion: rcmqp.Insertion, t: float) -> Stamped:
    """Looking ever further to the right, ever faster from t = 0 on, up to 0.3 rad/s."""
    rising = min(t, 0.15)
    command = rcmqp.ViewCommand(alpha=rising**2 + 0.3 * (t - rising), alpha_dot=2.0 * rising)
    return Stamped(rcmqp.view_pose(insertion.x_rcm, command), t)


def careful(insertion: rcmqp.Insertion) -> Controller:
    """A controller that keeps every joint limit."""
    return rcmqp.make_controller("hierarchical_qp", insertion, T)


def run(
    robot: Arm,
    duration: float = 0.02,
    references: Callable[[float], Stamped] | None = None,
    controller: Controller | None = None,
    **options: Any,
) -> LoopReport:
    insertion = robot.insertion
    made = rcmqp.make_controller("dual_quaternion", insertion, T, feed_forward=True)
    return run_realtime(
        robot,
        controller or made,
        references or (lambda t: view(insertion, t)),
        duration,
        clock=robot.clock,
        sleep=robot.clock.sleep,
        **options,
    )


def nan_at(k: int, q: Array) -> Array:
    return q * np.nan if k == 10 else q


@dataclass(frozen=True, eq=False)
class Spoilt(Controller):
    """Answers ``answer`` from its tenth command on, or raises it, past the usual safe stop."""

    name: ClassVar[str] = "spoilt"

    robot: Any = None
    answer: Any = None
    before: Any = None

    def _step(self, state: ArmState, reference: Reference) -> Command:
        if len(self.robot.sent) < 10:
            if self.before is not None:
                return Command(self.before)
            return Command((len(self.robot.sent) + 1) * _along(self.insertion, state))
        if isinstance(self.answer, Exception):
            raise self.answer
        return Command(self.answer)

    step = _step


def _along(insertion: rcmqp.Insertion, state: ArmState) -> Array:
    """About 5 mrad/s of each joint, the shaft's point at the trocar at rest."""
    depth = float(state.oMe.actInv(np.array(insertion.trocar.pivot))[2])
    rows, v = across(state.J_local, depth), np.full(7, 5e-3)
    return np.asarray(v - np.linalg.pinv(rows) @ rows @ v)


def assert_stopped(robot: Arm, report: LoopReport, fault: str) -> None:
    """Ten commands, then down to zero inside the limits, then zero, and a report that says so."""
    assert fault in report.stop.fault
    assert report.stop.at == pytest.approx(10 * T, abs=0.3 * T)
    v, arm = np.array(robot.sent), robot.insertion.arm
    assert np.abs(v[9]).max() > 1e-2
    steps = np.abs(np.diff(v[9:], axis=0))
    assert (steps <= arm.acceleration * T * (1.0 + 1e-9)).all()
    slower = np.diff(np.linalg.norm(v[9:], axis=1))
    assert (slower <= 0.0).all()
    assert slower[0] < 0.0  # not the last command once more
    assert (v[-HELD:] == 0.0).all()
    assert len(v) == 10 + report.braking
    assert report.unsent == 0
    assert robot.sent_at[10] - robot.sent_at[9] < 1.2 * T  # at once, not a cycle later
