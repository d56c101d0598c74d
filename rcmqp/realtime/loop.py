"""The cycles of a real-time loop and of its safe stop, one call each."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Self

import numpy as np

from rcmqp.controllers.base import Controller
from rcmqp.controllers.braking import Brake, braking
from rcmqp.errors import OptionError
from rcmqp.maths.dualquaternion import Array
from rcmqp.maths.options import allowed, positive
from rcmqp.realtime.checks import (
    CommandCheck,
    Halting,
    LoopFault,
    ReadingCheck,
    Robot,
    Watching,
    as_reading,
    check_speed,
    check_stamp,
)
from rcmqp.realtime.latency import Deadlines, Ticks
from rcmqp.realtime.report import Asked, CycleRecorder, LoopReport, Notes, Stop
from rcmqp.realtime.system import KeptSignals, LoopHung, Watchdog, time_waited
from rcmqp.references.view import Stamped

BUSY = "the machine may be too busy: leave it a core, and run with real-time priority"
"""What to do about a loop that is late."""

WARM_UP = 20
"""Steps before the loop, not sent: the first may compile, load or allocate."""

LATENESS = 20
"""Periods that a command may be late by."""

HUNG = 10
"""Periods beyond ``lateness`` after which a cycle that has not ended is taken for hung."""

HOLD = 0.2
"""How long zero velocity is sent after the joints have stopped [s]: a lost packet is no matter."""


class RealtimeLoop:
    """The loop of run_realtime(), stepped by an executor of one's own.

    In the block, call cycle() once a period until it returns False; the arm is then at rest::

        with RealtimeLoop(robot, controller, references, duration) as loop:
            executor.run_every(controller.period, loop.cycle)
        print(loop.report().as_markdown())

    The checks, the safe stop and the watch-dog are those of run_realtime(). The executor keeps
    the time: a cycle is due when cycle() is called, and one that is called more than ``lateness``
    too late ends in the safe stop. Signals and the garbage collector are the executor's, too.

    Attributes:
        ended: the safe stop is over, or the robot was halted.
    """

    def __init__(
        self,
        robot: Robot,
        controller: Controller,
        references: Callable[[float], Stamped],
        duration: float,
        *,
        reference_age: float = 0.05,
        lateness: float | None = None,
        hung: float | None = None,
        record: CycleRecorder | None = None,
        timing: Deadlines | None = None,
    ) -> None:
        """Arguments as of run_realtime(); ``timing`` is run_realtime()'s own.

        Raises:
            OptionError: as run_realtime().
        """
        period = controller.period
        lateness = LATENESS * period if lateness is None else lateness
        times = {"duration": duration, "reference_age": reference_age, "lateness": lateness}
        for name, value in times.items():
            allowed(name, value, positive("s"))
        hung = lateness + HUNG * period if hung is None else hung
        if not lateness < hung < math.inf:
            raise OptionError(
                f"hung = {hung} s, it must be finite and more than lateness, {lateness} s"
            )
        controller.insertion.arm.check_limits_known()
        self.robot, self.controller, self.references = robot, controller, references
        self.watching = references if isinstance(references, Watching) else None
        self.timing = timing or Ticks(period, 0.0, time.perf_counter, time.sleep)
        self.duration, self.reference_age, self.lateness = duration, reference_age, lateness
        self.signals, self.ended = KeptSignals(lateness), False
        self.watchdog: Watchdog | None = None
        if isinstance(robot, Halting):
            self.watchdog = Watchdog(robot.halt, hung, self._where, self._leave)
        self.arm = controller.insertion.arm
        self.v, self.angles, self.read_at = np.zeros(self.arm.nv), self.arm.home, 0.0
        self.a = np.zeros(self.arm.nv)
        self.pivot = np.array(controller.insertion.trocar.pivot)
        self.check = CommandCheck(Brake(controller.insertion, period), controller.name)
        self.reading = ReadingCheck(controller.insertion, period)
        self.controller_stops = self.unsent = self._before_stop = 0
        self._stop: Stop | None = None
        self._rest: Iterator[Array] = iter(())
        self._braking: Array | None = None
        self._reads, self._stop_asked = True, False
        self._thread, self._waited_before, self._waited = 0, math.nan, math.nan
        self._notes, self._recorded = Notes(record, self.arm), ""

    def __enter__(self) -> Self:
        """Warm up; nothing moves yet.

        Raises:
            RcmqpError: what would end the loop is refused, and so is a joint that is too fast.
        """
        self.warm_up()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Bring the arm to rest from here, if it is not."""
        if error is not None and self._stop is None:
            self._begin_stop(error)
        self.stop()
        while self.timing.cycles and self.cycle():
            with contextlib.suppress(BaseException):  # what cannot wait must still stop
                time.sleep(self.timing.period)
        self._end()
        self.finish_record()

    def warm_up(self) -> None:
        """Call once all that the loop and its stop will call, except send()."""
        self._notes.start()
        try:
            self._warm_up()
        except BaseException:
            self._notes.close("")
            raise

    def _warm_up(self) -> None:
        for _ in range(WARM_UP):
            q, self.v = as_reading(self.robot.read(), self.arm)  # measured: nothing is commanded
            check_speed(self.v, self.arm, "moves before the loop begins", "let the arm rest")
            self._command(0.0, q)
        insertion, slow = self.controller.insertion, 0.1 * self.arm.velocity
        next(braking(insertion, self.angles, slow, self.timing.period, self.pivot))
        self.controller.reset()
        self.controller_stops = 0

    def stop(self) -> None:
        """Ask for the safe stop, from any thread; the next cycle begins it."""
        self._stop_asked = True

    def cycle(self) -> bool:
        """Run the cycle that is due now, of the loop or of its safe stop.

        A call less than half a period after the last one does nothing: the joints could not
        follow two commands at once.

        Returns:
            Whether there is more to run; if not, the loop has ended.
        """
        if isinstance(self.timing, Ticks) and self.timing.early():
            return not self.ended
        return self._advance()

    def run(self) -> LoopReport:
        """Run cycles until the duration is over, a fault or a signal; then the safe stop."""
        self.timing.begin()
        try:
            while self._advance():
                pass
        finally:  # on sys.exit(), too
            while self._advance():
                pass
        return self.report()

    def finish_record(self) -> None:
        """Wait, once the arm is at rest, until what was recorded is kept."""
        self._recorded += self._notes.close("" if self._stop is None else self._stop.fault)

    def report(self) -> LoopReport:
        """The report so far; ``stop`` says how the loop ended, if it has."""
        timing, watchdog = self.timing, self.watchdog
        stop = self._stop or Stop(timing.now(), "")
        return LoopReport(
            controller=self.controller.name,
            period=timing.period,
            cycles=timing.cycles,
            braking=timing.cycles - self._before_stop if self._stop else 0,
            missed=timing.missed,
            skipped=timing.skipped,
            controller_stops=self.controller_stops,
            unsent=self.unsent,
            wake=timing.wake.latency(),
            answer=timing.answer.latency(),
            stop=dataclasses.replace(stop, signal=self.signals.caught),
            halted=watchdog is not None and watchdog.halted,
            waited=self._waited,
            recorded=self._recorded,
            off_trocar=self.reading.off_trocar,
        )

    def _advance(self) -> bool:
        """Wait for the next cycle and run it; whether there is another."""
        if self.ended:
            return False
        timing, before = self.timing, self.timing.cycles
        if not self._thread:
            self._begin()
        if self._stop is None:
            try:
                timing.wait()
                if self.signals.caught or self._stop_asked:
                    raise KeyboardInterrupt
                self._cycle()
                if timing.due >= self.duration:
                    self._begin_stop(None)
            except BaseException as error:
                self._begin_stop(error)
                if not isinstance(error, (Exception, KeyboardInterrupt)):
                    raise
            if self._stop is None or timing.cycles > before:
                self._beat()
                return True
        self._brake()
        return not self.ended

    def _begin(self) -> None:
        """Prepare the first cycle."""
        self._thread, self._waited_before = threading.get_ident(), time_waited()
        self.read_at = -self.timing.period  # the reading of the warm-up
        self._beat()

    def _end(self) -> None:
        """The arm is at rest."""
        if not self.ended:
            self.ended = True
            if self._thread == threading.get_ident():
                self._waited = time_waited() - self._waited_before
            if self.watchdog is not None:
                self.watchdog.close()

    def _beat(self) -> None:
        if self.watchdog is not None:
            self.watchdog.beat()

    def _begin_stop(self, error: BaseException | None) -> None:
        """From here on the safe stop is sent; its first command is looked for now."""
        hung = self._hung()
        if hung is not None:
            error = hung
        at = self.duration if error is None else self.timing.now()
        caught = self.signals.caught
        if self._stop_asked and isinstance(error, KeyboardInterrupt) and not caught:
            error, reason = None, "asked to stop"
        else:
            reason = "" if error is None else _reason(error, caught)
        self._before_stop, self._rest = self.timing.cycles, self._to_rest()
        halted = self._settled()
        if hung is not None and self.watchdog is not None and not halted:
            reason += f", which failed: {self.watchdog.failure or 'it has not returned'}"
        self._stop = Stop(at, reason, error)
        self._braking = None if halted else next(self._rest, None)

    def _hung(self) -> LoopHung | None:
        return self.watchdog.hung if self.watchdog is not None else None

    def _settled(self) -> bool:
        """Whether the watch-dog has halted the robot: nothing may be sent any more."""
        return self._hung() is not None and self.watchdog is not None and self.watchdog.settled()

    def _where(self) -> str:
        """Say which call the loop is in, for the watch-dog's message."""
        name = self.signals.where()
        if name == "_command":
            return "the reference or the controller hangs"
        return f"{name}() hangs" if name else "the loop does not run"

    def _leave(self) -> None:
        """Get the main thread out of a call that hangs."""
        hung = self._hung()
        if hung is not None and self._thread == threading.main_thread().ident:
            self.signals.leave(hung)

    def _cycle(self) -> None:
        timing, call = self.timing, self.signals.call
        now = timing.now()
        q, v_read = as_reading(call(self.robot.read), self.arm)
        v = call(self._command, now, q)
        late = timing.now() - timing.due + timing.slip
        if (hung := self._hung()) is not None:
            raise hung
        if late > self.lateness:
            raise LoopFault(
                f"a command was {late:.4g} s late, allowed {self.lateness:.4g} s; {BUSY}"
            )
        call(self.robot.send, v)
        self.v, self.a = v, (v - self.v) / timing.period
        due, slip, sent = timing.due, timing.slip, timing.now()
        held = sent - due
        timing.sent()
        self._notes.sent(due - slip, now, sent, (q, v_read), v)
        if held > self.lateness:
            raise LoopFault(
                f"send() took until {held:.4g} s, allowed {self.lateness:.4g} s; {BUSY}"
            )

    def _command(self, now: float, q: Array) -> Array:
        """Ask the controller for the command at q (nq,), read at ``now`` [s] or later."""
        period = self.timing.period
        newest = check_stamp(self.references(now), now, self.reference_age, ahead=period)
        state = self.controller.insertion.state(q, self.v, self.a)
        self.reading.passed(state.angles, now)
        if math.isnan(self.reading.off_trocar):
            self.reading.start(state, newest.reference.pivot)
        start = time.perf_counter()
        answer = self.controller.step(state, newest.reference)
        solve_time = time.perf_counter() - start
        command = self.check.passed(answer.v, state.angles, self.v, self.a)
        self.angles, self.read_at = state.angles, now
        if self.watching is not None:
            self.watching.see(state)
        if np.isfinite(newest.reference.pivot).all():
            self.pivot = np.asarray(newest.reference.pivot, dtype=float)
        self.controller_stops += answer.diagnostics.get("safe_stop", 0.0) > 0.0
        self._notes.asked = Asked(newest, self.pivot, answer, solve_time)
        return command

    def _brake(self) -> None:
        """One cycle of the safe stop, sent whatever else fails."""
        timing, self._notes.reading = self.timing, None
        with contextlib.suppress(BaseException):  # what cannot wait must still stop
            timing.wait()
        if self._reads and self._braking is not None and self._hung() is None:
            self._reads = self._keeps_in_touch()  # as long as that does not hold up the stop
        if self._braking is None or self._settled():
            self._note_hung()
            self._end()
            return
        sent = True
        try:
            self.signals.call(self.robot.send, self._braking)
        except BaseException:  # noqa: BLE001  (the next may get through)
            sent, self.unsent = False, self.unsent + 1
        due = timing.due - timing.slip
        with contextlib.suppress(BaseException):
            timing.sent()
        if sent:
            with contextlib.suppress(BaseException):
                fault = self._stop.fault if self._stop is not None else ""
                self._notes.braked(due, timing, self._braking, fault)
        self._beat()
        self._braking = next(self._rest, None)
        if self._braking is None:
            self._end()

    def _note_hung(self) -> None:
        """Note in the report that the watch-dog ended the stop."""
        stop, hung = self._stop, self._hung()
        if stop is not None and hung is not None and stop.error is not hung:
            reasons = (stop.fault, _reason(hung, 0))
            fault = "; in the stop, ".join(reason for reason in reasons if reason)
            self._stop = dataclasses.replace(stop, fault=fault, error=hung)

    def _keeps_in_touch(self) -> bool:
        """Read and ignore any error; return whether that was quick enough."""
        with contextlib.suppress(BaseException):
            began = self.timing.now()
            with contextlib.suppress(BaseException):
                self._notes.reading = as_reading(self.signals.call(self.robot.read), self.arm)
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


def _reason(error: BaseException, caught: int) -> str:
    if isinstance(error, KeyboardInterrupt):
        return f"interrupted ({signal.Signals(caught).name})" if caught else "interrupted"
    return f"{type(error).__name__}: {error}"
