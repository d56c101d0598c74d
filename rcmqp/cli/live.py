"""rcmqp live: a console in the browser, at the camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from rcmqp.cli import options as ask
from rcmqp.cli.console import err, out
from rcmqp.cli.opening import opening
from rcmqp.controllers.settings import FILE_SETTING, controller_of, registered
from rcmqp.errors import ToolMissing
from rcmqp.live import LOCAL
from rcmqp.runs.loading import load_scenario


def live(
    scenario: Annotated[
        str, typer.Argument(help="Name (see rcmqp scenarios), or a .py, .json or .h5 file.")
    ] = "camera_task",
    arm: Annotated[
        str | None,
        typer.Option(
            "--arm",
            "-a",
            help="Name (see rcmqp arms), or the path of an arm's .toml or of a URDF; the "
            "scenario's without it.",
        ),
    ] = None,
    controller: Annotated[
        str,
        typer.Option(
            "--controller", "-c", help="Name (see rcmqp controllers), or FILE.py[:CLASS]."
        ),
    ] = "hierarchical_qp",
    flange: ask.FlangeOption = None,
    acceleration: ask.AccelerationOption = None,
    jerk: ask.JerkOption = None,
    instrument: ask.InstrumentOption = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="An option of the controller."),
    ] = None,
    scale: Annotated[float, typer.Option(help="How far the tip moves, over the hand.")] = 1.0,
    viscosity: Annotated[
        float, typer.Option(help="Viscosity of the device, in N s/m: a fast hand is slowed down.")
    ] = 15.0,
    file: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to record the session into, HDF5.")
    ] = None,
    host: Annotated[
        str, typer.Option(help="Interface to listen on; other machines reach any but this one.")
    ] = LOCAL[0],
    port: Annotated[int, typer.Option(help="Port to listen at; any without it.")] = 0,
    no_open: Annotated[
        bool, typer.Option("--no-open", help="Do not open the page in a browser.")
    ] = False,
) -> None:
    """Steer a simulated arm in real time, in a browser, by mouse, touch, keys or gamepad.

    The page has buttons for a headset, a space mouse and a Haply Inverse3.

    For example,

      rcmqp live

      rcmqp live camera_task --arm panda --out session.h5, and then rcmqp view session.h5

      rcmqp live -c my_law.py

      rcmqp live --arm my_robot.urdf --flange tool0 --acceleration 8 --jerk 400

    The arm moves only while you hold on. Ctrl-C ends the session, with the arm at rest, and
    prints what was counted. Ends with exit code 1 where the loop stopped by itself.
    """
    from rcmqp.experiments.trial.design import file_of

    try:
        from rcmqp.live.console import run_live
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("starlette", "uvicorn", "websockets"):
            raise
        raise ToolMissing(error.name or "starlette", "pip install 'rcmqp[live]'") from error
    name, options = controller_of(registered(controller), settings or [])
    law_file = file_of(controller) if FILE_SETTING.fullmatch(controller) else None
    given = ask.limits_of(acceleration, jerk).given() | ask.instrument_of(instrument)
    chosen = load_scenario(scenario, arm, flange=flange, **given)
    if host not in LOCAL:
        err.print(
            f"[bold yellow]warning:[/] {escape(host)} can be reached from other machines, and "
            "nothing is encrypted: anybody who sees the address can steer",
            soft_wrap=True,
            highlight=False,
        )

    with opening() as show:

        def started(address: str) -> None:
            said = f"{address}\nCtrl-C ends the session"
            out.print(said, markup=False, highlight=False, soft_wrap=True)
            if not no_open:
                show(address)

        report = run_live(
            chosen,
            name,
            options,
            law_file=law_file,
            scale=scale,
            viscosity=viscosity,
            host=host,
            port=port,
            out=file,
            started=started,
        )
    out.print(report.text, markup=False, highlight=False, soft_wrap=True)
    if report.fault:
        raise typer.Exit(1)
