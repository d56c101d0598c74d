"""A control loop at a fixed period against anything that can be read and commanded."""

from __future__ import annotations

import contextlib
import gc
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.braking import braking
from rcmqp.controllers.base import Controller
from rcmqp.deadlines import Deadlines
from rcmqp.dualquaternion import Array
from rcmqp.errors import InvalidCommand, OptionError, RcmqpError
from rcmqp.loop_report import LoopReport, Stop
from rcmqp.reference import Reference

WARM_UP = 20
"""Steps before the loop, not sent: the first may compile, load or allocate."""

LATENESS = 20
"""Periods that a command may be late by."""

HOLD = 0.2
"""How long zero velocity is sent after the joints have stopped [s]: a lost packet is no matter."""


class Robot(Protocol):
    """What drives the joints; each call must return well within a period."""

    def read(self) -> tuple[ArrayLike, ArrayLike]:
        """Configuration q (nq,) and joint velocity v (nv,) [rad/s] as measured now."""
        ...

    def send(self, v: Array) -> None:
        """Command a joint velocity v (nv,) [rad/s], read-only, until the next one."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Stamped:
    """A reference, and when it was made.

    Attributes:
        reference: what the controller is told.
        at: the time that it is for, from the start of the loop [s].
    """

    reference: Reference
    at: float


class LoopFault(RcmqpError):
    """A reference is too old, or a command too late, to be followed."""


def run_realtime(
    robot: Robot,
    controller: Controller,
    references: Callable[[float], Stamped],
    duration: float,
    *,
    reference_age: float = 0.05,
    lateness: float | None = None,
    spin: float = 200e-6,
    clock: Callable[[], float] = time.perf_counter,
    sleep: Callable[[float], None] = time.sleep,
) -> LoopReport:
    """Run a controller in real time, and end it at rest.

    Cycle k is due at k periods after the start, by the clock, whatever the cycles before it
    took: read, reference, control, send. A command that leaves after the next cycle is due has
    missed its deadline; cycles that are over by then are skipped, not made up for.

    Every run ends in the safe stop ``brake``: at the end of ``duration``, on Ctrl-C or SIGTERM,
    and at once where a reading or a command is not finite, the reference is stale, a command
    would be late or took to send by more than ``lateness``, or anything raises an exception. From
    the last velocity sent the joints slow down as fast as their acceleration limits allow, the
    shaft staying on the trocar, see braking(); where that would carry one over a position limit,
    each slows down by itself as fast as it may. Zero is then held for 0.2 s. No command is sent
    twice. That a reading is old the loop cannot tell: read() has to raise where its newest one is.

    The controller is told the velocity that was sent last, as simulate() does: a measured one lags
    behind, and is used at the start only. Where the controller itself answers with its safe stop,
    to a reference that is no pose, for one, the loop goes on, brakes with it, and counts.

    The garbage collector is kept out of the way while the loop runs.

    Args:
        robot: what is read and commanded.
        controller: its insertion's arm is the robot's, its period that of the loop.
        references: gives, at a time from the start [s], the newest reference.
        duration: how long to run [s], without the stop.
        reference_age: how old the newest reference may be [s].
        lateness: how long after its own cycle was due a command may still be sent [s]; twenty
            periods, if not given, which is what a Franka takes before it stops by itself.
        spin: the last bit of the wait that is spun, not slept [s]: sleeping wakes late. 0 leaves
            the core to others and costs punctuality.
        clock: seconds, never going back.
        sleep: waits for some seconds.

    Returns:
        What happened; ``stop.fault`` says why the loop ended early, if it did.

    Raises:
        OptionError: a time is not allowed.
        RcmqpError: before the loop, while nothing moves: whatever reading, reference or
            controller refuse in the warm-up.
    """
    period = controller.period
    lateness = LATENESS * period if lateness is None else lateness
    times = {"duration": duration, "reference_age": reference_age, "lateness": lateness}
    for name, value in times.items():
        if not 0.0 < value < math.inf:
            raise OptionError(f"{name} = {value} s, it must be positive and finite")
    if not 0.0 <= spin <= period:
        raise OptionError(f"spin = {spin} s, it must lie between 0 and the period, {period} s")
    timing = Deadlines(period, spin, clock, sleep)
    loop = _Loop(robot, controller, references, timing, reference_age, lateness)
    loop.warm_up()
    with _no_garbage_collection(), _on_signals(TERMINATES):
        return loop.run(duration)


class _Loop:
    """One run of run_realtime()."""

    def __init__(
        self,
        robot: Robot,
        controller: Controller,
        references: Callable[[float], Stamped],
        timing: Deadlines,
        reference_age: float,
        lateness: float,
    ) -> None:
        self.robot, self.controller, self.references = robot, controller, references
        self.timing = timing
        self.reference_age, self.lateness = reference_age, lateness
        self.arm = controller.insertion.arm
        self.v, self.angles = np.zeros(self.arm.nv), self.arm.home
        self.pivot = np.array(controller.insertion.trocar.pivot)
        self.controller_stops = self.unsent = 0

    def warm_up(self) -> None:
        """Let everything run once that the loop will, but for sending."""
        for _ in range(WARM_UP):
            q, self.v = self._read()  # nothing is commanded yet, so the measured velocity
            self._command(0.0, q)
        self.controller.reset()
        self.controller_stops = 0

    def run(self, duration: float) -> LoopReport:
        """Cycles until ``duration`` [s], a fault or Ctrl-C, then the safe stop."""
        timing = self.timing
        timing.begin()
        stop = Stop(duration, "")
        try:
            while timing.due < duration:
                timing.wait()
                self._cycle()
        except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  (the report has it)
            stop = Stop(timing.now(), _reason(error), error)
        finally:  # on sys.exit(), too
            braking_cycles = self._brake()
        return LoopReport(
            controller=self.controller.name,
            period=timing.period,
            cycles=timing.cycles,
            braking=braking_cycles,
            missed=timing.missed,
            skipped=timing.skipped,
            controller_stops=self.controller_stops,
            unsent=self.unsent,
            wake=timing.wake.latency(),
            answer=timing.answer.latency(),
            stop=stop,
        )

    def _cycle(self) -> None:
        v = self._command(self.timing.now(), self._read()[0])
        late = self.timing.now() - self.timing.due
        if late > self.lateness:
            raise LoopFault(f"a command was {late:.4g} s late, allowed {self.lateness:.4g} s")
        self.robot.send(v)
        self.v = v
        held = self.timing.now() - self.timing.due
        self.timing.sent()
        if held > self.lateness:
            raise LoopFault(f"send() took until {held:.4g} s, allowed {self.lateness:.4g} s")

    def _read(self) -> tuple[Array, Array]:
        """Configuration (nq,) and joint velocity (nv,) [rad/s] as measured now.

        Raises:
            InvalidCommand: one is not finite.
        """
        q, v = (np.array(values, dtype=float) for values in self.robot.read())
        for name, values in (("configuration q", q), ("joint velocity v", v)):
            if not np.isfinite(values).all():
                raise InvalidCommand(f"{name} is not finite, as it was read: {values}")
        return q, v

    def _command(self, now: float, q: Array) -> Array:
        """What the controller answers to a reading of q (nq,) and the newest reference."""
        newest = self.references(now)
        if not isinstance(newest, Stamped):
            raise InvalidCommand(
                f"references({now:.4g}) answered a {type(newest).__name__}; it must be "
                "Stamped(reference, at)"
            )
        if not now - newest.at <= self.reference_age:
            raise LoopFault(
                f"the newest reference is {now - newest.at:.4g} s old, allowed "
                f"{self.reference_age:.4g} s"
            )
        if newest.at - now > self.timing.period:
            raise LoopFault(
                f"the newest reference is stamped {newest.at - now:.4g} s in the future; stamp "
                "references with the time that the loop asks with, counted from its start"
            )
        state = self.controller.insertion.state(q, self.v)
        answer = self.controller.step(state, newest.reference)
        command = np.array(answer.v, dtype=float)
        if command.shape != self.v.shape or not np.isfinite(command).all():
            raise InvalidCommand(f"{self.controller.name} answered {command}, not {self.v.shape}")
        command.setflags(write=False)
        self.angles = state.angles
        if np.isfinite(newest.reference.pivot).all():
            self.pivot = np.asarray(newest.reference.pivot, dtype=float)
        self.controller_stops += answer.diagnostics.get("safe_stop", 0.0) > 0.0
        return command

    def _brake(self) -> int:
        """The safe stop, sent whatever else fails; in how many cycles."""
        before = self.timing.cycles
        with _on_signals(IGNORED):
            for v in self._to_rest():
                with contextlib.suppress(Exception):  # what cannot wait must still stop
                    self._wait_through()
                with contextlib.suppress(Exception, KeyboardInterrupt):  # not what moves the arm
                    self.robot.read()
                try:
                    self.robot.send(v)
                except (Exception, KeyboardInterrupt):  # noqa: BLE001  (the next may get through)
                    self.unsent += 1
                with contextlib.suppress(Exception, KeyboardInterrupt):
                    self.timing.sent()
        return self.timing.cycles - before

    def _to_rest(self) -> Iterator[Array]:
        """Velocities (nv,) of the safe stop; zero at once if they cannot be found."""
        insertion, T = self.controller.insertion, self.timing.period
        zero = np.zeros(self.arm.nv)
        zero.setflags(write=False)
        with contextlib.suppress(Exception, KeyboardInterrupt):  # to stop comes first
            yield from braking(insertion, self.angles, self.v, T, self.pivot)
        yield from [zero] * math.ceil(HOLD / T)

    def _wait_through(self) -> None:
        """Wait for the next cycle, whatever the user presses."""
        while True:
            try:
                self.timing.wait()
                return
            except KeyboardInterrupt:
                continue


@contextlib.contextmanager
def _on_signals(handlers: Mapping[signal.Signals, Any]) -> Iterator[None]:
    """What signals do in here, where this is the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _terminate(number: int, frame: object) -> None:
    """Leave as on sys.exit(), by way of the safe stop."""
    raise SystemExit(128 + number)


TERMINATES = {signal.SIGTERM: _terminate}

IGNORED = {signal.SIGINT: signal.SIG_IGN, signal.SIGTERM: signal.SIG_IGN}
"""While the arm is being stopped."""


@contextlib.contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Collect now, then not until the end; what is alive now is never looked at."""
    enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if enabled:
            gc.enable()


def _reason(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted by the user"
    return f"{type(error).__name__}: {error}"
