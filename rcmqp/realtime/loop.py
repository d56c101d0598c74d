"""A control loop at a fixed period against anything that can be read and commanded."""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import math
import signal
import time
from collections.abc import Callable, Iterator
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from rcmqp.controllers.base import Controller
from rcmqp.controllers.braking import Brake, braking
from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.realtime.checks import (
    CommandCheck,
    LoopFault,
    as_reading,
    check_speed,
    check_stamp,
)
from rcmqp.realtime.deadlines import Deadlines
from rcmqp.realtime.report import LoopReport, Stop
from rcmqp.realtime.signals import KeptSignals
from rcmqp.references.view import Stamped
from rcmqp.world.arm import ArmState

__all__ = ["LoopFault", "Robot", "Stamped", "Watching", "run_realtime"]

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


@runtime_checkable
class Watching(Protocol):
    """References that depend on what the arm does, such as rcmqp.references.governor.Governed."""

    def see(self, state: ArmState) -> None:
        """Take the state that was measured when the last reference was asked for."""
        ...


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

    Every run ends in the safe stop ``brake``: at the end of ``duration``, on Ctrl-C, SIGTERM or
    SIGHUP, and at once where a reading or a command is not finite, a command is beyond the joint's
    limits of speed, acceleration or jerk or would let it no longer stop before its position
    limit, the reference is stale, a command would be late or took to send by more than
    ``lateness``, or anything raises an exception. From the last velocity sent the joints slow
    down as fast as their limits of acceleration and jerk allow, the shaft staying on the trocar,
    see braking(); a joint that comes near its position limit stops by itself as fast as it may.
    Zero is then held for 0.2 s. No command is sent twice. That a reading is old the
    loop cannot tell: read() has to raise where its newest one is.

    In the main thread a signal is noted, and the loop looks for it once a cycle; during the stop
    it changes nothing. Where read(), send(), the reference or the controller hangs for longer
    than ``lateness``, it is left by a KeyboardInterrupt. The report, which is returned all the
    same, tells of it: to end the program is for the caller. SIGQUIT (Ctrl-backslash) is left
    alone: it ends the program where it is, and no stop is sent.

    The controller is told the velocity that was sent last, as simulate() does: a measured one lags
    behind, and is used at the start only. Where the controller itself answers with its safe stop,
    to a reference that is no pose, for one, the loop goes on, brakes with it, and counts.

    The garbage collector is kept out of the way while the loop runs.

    Args:
        robot: what is read and commanded.
        controller: its insertion's arm is the robot's, its period that of the loop.
        references: gives, at a time from the start [s], the newest reference. If it has a method
            see(state), as Governed has, each cycle then shows it the state that was measured.
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
        OptionError: a time is not allowed, or an acceleration or jerk limit of the arm is only
            assumed or infinite: see load_arm(..., acceleration=..., jerk=...).
        RcmqpError: before the loop, while nothing moves: what would end it is refused in the
            warm-up, and so is a joint that is faster than it may be.
    """
    period = controller.period
    lateness = LATENESS * period if lateness is None else lateness
    times = {"duration": duration, "reference_age": reference_age, "lateness": lateness}
    for name, value in times.items():
        if not 0.0 < value < math.inf:
            raise OptionError(f"{name} = {value} s, it must be positive and finite")
    if not 0.0 <= spin <= period:
        raise OptionError(f"spin = {spin} s, it must lie between 0 and the period, {period} s")
    controller.insertion.arm.check_limits_known()
    timing = Deadlines(period, spin, clock, sleep)
    loop = _Loop(robot, controller, references, timing, reference_age, lateness)
    loop.warm_up()
    with loop.signals.kept(), _no_garbage_collection():
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
        self.watching = references if isinstance(references, Watching) else None
        self.timing = timing
        self.reference_age, self.lateness = reference_age, lateness
        self.signals = KeptSignals(lateness)
        self.arm = controller.insertion.arm
        self.v, self.angles, self.read_at = np.zeros(self.arm.nv), self.arm.home, 0.0
        self.a = np.zeros(self.arm.nv)
        self.pivot = np.array(controller.insertion.trocar.pivot)
        self.check = CommandCheck(Brake(controller.insertion, timing.period), controller.name)
        self.controller_stops = self.unsent = 0

    def warm_up(self) -> None:
        """Let everything run once that the loop and its stop will, but for sending."""
        for _ in range(WARM_UP):
            q, self.v = as_reading(self.robot.read(), self.arm)  # measured: nothing is commanded
            check_speed(self.v, self.arm, "moves before the loop begins", "let the arm rest")
            self._command(0.0, q)
        insertion, slow = self.controller.insertion, 0.1 * self.arm.velocity
        next(braking(insertion, self.angles, slow, self.timing.period, self.pivot))
        self.controller.reset()
        self.controller_stops = 0

    def run(self, duration: float) -> LoopReport:
        """Cycles until ``duration`` [s], a fault or a signal, then the safe stop."""
        timing, signals = self.timing, self.signals
        timing.begin()
        self.read_at = -timing.period  # the reading of the warm-up
        stop = Stop(duration, "")
        try:
            while timing.due < duration:
                timing.wait()
                if signals.caught:
                    raise KeyboardInterrupt
                self._cycle()
        except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  (the report has it)
            stop = Stop(timing.now(), _reason(error, signals.caught), error)
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
            stop=dataclasses.replace(stop, signal=signals.caught),
        )

    def _cycle(self) -> None:
        timing, call = self.timing, self.signals.call
        now = timing.now()
        q, _ = as_reading(call(self.robot.read), self.arm)
        v = call(self._command, now, q)
        late = timing.now() - timing.due
        if late > self.lateness:
            raise LoopFault(f"a command was {late:.4g} s late, allowed {self.lateness:.4g} s")
        call(self.robot.send, v)
        self.v, self.a = v, (v - self.v) / timing.period
        held = timing.now() - timing.due
        timing.sent()
        if held > self.lateness:
            raise LoopFault(f"send() took until {held:.4g} s, allowed {self.lateness:.4g} s")

    def _command(self, now: float, q: Array) -> Array:
        """What the controller answers to a reading of q (nq,), not older than ``now`` [s]."""
        period = self.timing.period
        newest = check_stamp(self.references(now), now, self.reference_age, ahead=period)
        state = self.controller.insertion.state(q, self.v, self.a)
        answer = self.controller.step(state, newest.reference)
        command = self.check.passed(answer.v, state.angles, self.v, self.a)
        self.angles, self.read_at = state.angles, now
        if self.watching is not None:
            self.watching.see(state)
        if np.isfinite(newest.reference.pivot).all():
            self.pivot = np.asarray(newest.reference.pivot, dtype=float)
        self.controller_stops += answer.diagnostics.get("safe_stop", 0.0) > 0.0
        return command

    def _brake(self) -> int:
        """The safe stop, sent whatever else fails; in how many cycles."""
        before, reads = self.timing.cycles, True
        for v in self._to_rest():
            with contextlib.suppress(BaseException):  # what cannot wait must still stop
                self.timing.wait()
            if reads:  # to keep in touch, as long as that does not hold up what is to be sent
                reads = self._keeps_in_touch()
            try:
                self.signals.call(self.robot.send, v)
            except BaseException:  # noqa: BLE001  (the next may get through)
                self.unsent += 1
            with contextlib.suppress(BaseException):
                self.timing.sent()
        return self.timing.cycles - before

    def _keeps_in_touch(self) -> bool:
        """Read, whatever comes of it; whether that was quick."""
        with contextlib.suppress(BaseException):
            began = self.timing.now()
            with contextlib.suppress(BaseException):
                self.signals.call(self.robot.read)
            return self.timing.now() - began <= self.lateness
        return False

    def _to_rest(self) -> Iterator[Array]:
        """Velocities (nv,) of the safe stop; zero at once if they cannot be found."""
        timing, insertion = self.timing, self.controller.insertion
        zero, angles = np.zeros(self.arm.nv), self.angles
        zero.setflags(write=False)
        with contextlib.suppress(Exception):  # to stop comes first
            leaves = max(timing.now(), timing.due)  # the first one; until then the joints go on
            angles = angles + (leaves - timing.period - self.read_at) * self.v
        with contextlib.suppress(Exception):
            yield from braking(insertion, angles, self.v, timing.period, self.pivot, self.a)
        yield from [zero] * math.ceil(HOLD / timing.period)


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


def _reason(error: BaseException, caught: int) -> str:
    if isinstance(error, KeyboardInterrupt):
        return f"interrupted ({signal.Signals(caught).name})" if caught else "interrupted"
    return f"{type(error).__name__}: {error}"
