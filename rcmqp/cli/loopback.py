"""rcmqp loopback: the real-time loop against a simulated arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rcmqp.cli.console import print_note, say
from rcmqp.controllers import Controller
from rcmqp.controllers.settings import options_of
from rcmqp.errors import OptionError
from rcmqp.runs.head import check_own
from rcmqp.world.loading import arm_names, names_its_flange


def loopback(
    minutes: Annotated[float, typer.Option("--minutes", "-m", help="How long.")] = 0.2,
    arm: Annotated[str, typer.Option("--arm", "-a", help="Name, or an arm's .toml.")] = "panda",
    controller: Annotated[
        str, typer.Option("--controller", "-c", help="Name (see rcmqp controllers).")
    ] = "dual_quaternion",
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="An option of the controller."),
    ] = None,
    busy: Annotated[bool, typer.Option("--busy", help="Keep one core busy meanwhile.")] = False,
    priority: Annotated[
        bool, typer.Option("--priority", help="Ask for real-time priority (SCHED_FIFO).")
    ] = False,
    file: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to record the run into, HDF5.")
    ] = None,
) -> None:
    """Control a simulated arm in another process in real time, at 1 kHz, over UDP.

    For example,

      rcmqp loopback --minutes 10 --busy --priority

      rcmqp loopback --priority --out real.h5, and then rcmqp show real.h5, rcmqp view real.h5

    Prints what the loop and the arm counted: deadlines missed, delays, and where every command
    went. Ends with exit code 1 where the loop stopped before its time, and after Ctrl-C or
    SIGTERM, which stop the arm first, with 130 or 143.
    """
    from rcmqp.realtime.loopback import run_loopback
    from rcmqp.runs.loop_record import LoopRecorder

    if not names_its_flange(arm):
        raise OptionError(
            f"--arm {arm}: give a name, one of {', '.join(arm_names())}, or an arm's file, "
            "my_robot.toml, which says which frame of a URDF carries the instrument"
        )
    options = options_of(controller, settings or [])
    if file is not None:
        check_own(file)

    def recorder(made: Controller) -> LoopRecorder | None:
        return None if file is None else LoopRecorder(file, made, "loopback")

    report = run_loopback(
        60.0 * minutes,
        arm=arm,
        controller=controller,
        busy=busy,
        priority=priority,
        record=recorder,
        **options,
    )
    say(report.as_markdown())
    stop = report.loop.stop
    if stop.fault and report.loop.skipped and not priority:
        print_note(
            f"this machine was too busy for {report.loop.skipped} of the cycles, which may be why "
            "the loop stopped; close other programs, or use --priority, as root or with rtprio "
            "raised in /etc/security/limits.conf"
        )
    if stop.signal or stop.fault:
        raise typer.Exit(128 + stop.signal if stop.signal else 1)
