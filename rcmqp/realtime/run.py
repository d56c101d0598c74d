"""A control loop at a fixed period against anything that can be read and commanded."""

from __future__ import annotations

import contextlib
import gc
import time
from collections.abc import Callable, Iterator

from rcmqp.controllers.base import Controller
from rcmqp.maths.options import allowed, from_to
from rcmqp.realtime.checks import Halting, LoopFault, Robot, Watching
from rcmqp.realtime.latency import Deadlines
from rcmqp.realtime.loop import HOLD, WARM_UP, RealtimeLoop
from rcmqp.realtime.report import CycleRecorder, LoopReport
from rcmqp.realtime.system import LoopHung
from rcmqp.references.view import Stamped

__all__ = [
    "HOLD",
    "WARM_UP",
    "CycleRecorder",
    "Halting",
    "LoopFault",
    "LoopHung",
    "RealtimeLoop",
    "Robot",
    "Stamped",
    "Watching",
    "run_realtime",
]


def run_realtime(
    robot: Robot,
    controller: Controller,
    references: Callable[[float], Stamped],
    duration: float,
    *,
    reference_age: float = 0.05,
    lateness: float | None = None,
    hung: float | None = None,
    spin: float = 200e-6,
    record: CycleRecorder | None = None,
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
    Zero is then held for 0.2 s. No command is sent twice.

    The loop does not start where the shaft is farther off the trocar than 1 mm, or than the
    insertion's tolerance; and it ends where a reading is outside the position limits or farther
    from the last one than the joints can have moved: readings in degrees, or in another order.
    It cannot tell that a reading is old: read() has to raise then.

    In the main thread a signal is noted, and the loop looks for it once a cycle; during the stop
    it changes nothing. Where read(), send(), the reference or the controller hangs for longer
    than ``lateness``, it is left by a KeyboardInterrupt. The report is returned all the same and
    says so; the caller decides whether to end the program. SIGQUIT (Ctrl-backslash) is left alone:
    it ends the program where it is, and no stop is sent.

    If the robot has a method halt(), a watch-dog in a thread of its own calls it where no cycle
    has ended for ``hung``: a read() or a send() that hangs does not leave the arm at its last
    velocity. Nothing is sent afterwards, and the loop ends with a LoopHung in the report. In the
    main thread, a call that hangs in Python or in a system call is left at once; anywhere else
    the loop ends when the call returns. A call that hangs and keeps Python's lock, or a process
    that is stopped as a whole, only the robot itself can notice.

    The controller is told the velocity that was sent last, as simulate() does: a measured one lags
    behind, and is used at the start only. Where the controller itself answers with its safe stop,
    for example to a reference that is not a pose, the loop goes on, brakes with it, and counts.

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
        hung: how long after the end of the last cycle the next one must have ended [s], or the
            robot is halted; ten periods more than ``lateness``, if not given.
        spin: the last bit of the wait that is spun, not slept [s]: sleeping wakes late. 0 leaves
            the core to others and costs punctuality.
        record: keeps what each cycle read, asked and sent, the safe stop included; such as
            rcmqp.runs.loop_record.LoopRecorder, which writes a run's file beside the loop. The
            report says what was kept.
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
    allowed("spin", spin, from_to(0.0, period, "s"))
    timing = Deadlines(period, spin, clock, sleep)
    loop = RealtimeLoop(
        robot,
        controller,
        references,
        duration,
        reference_age=reference_age,
        lateness=lateness,
        hung=hung,
        record=record,
        timing=timing,
    )
    loop.warm_up()
    try:
        with loop.signals.kept(), _no_garbage_collection():
            loop.run()
    finally:
        loop.finish_record()
    return loop.report()


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
