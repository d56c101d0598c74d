"""rcmqp live: a console in the browser, at the camera."""

from __future__ import annotations

import contextlib
import html
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from rcmqp.cli import options as ask
from rcmqp.cli.console import err, out
from rcmqp.controllers.settings import FILE_SETTING, controller_of, registered
from rcmqp.errors import ToolMissing
from rcmqp.live import LOCAL
from rcmqp.runs.loading import load_scenario

PAGE = """<!doctype html>
<meta charset="utf-8"><meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0; url={address}">
<p><a href="{address}">rcmqp</a></p>
"""
"""Leads to an address at once."""


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

    with live_extra():
        from rcmqp.live.console import run_live
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


@contextlib.contextmanager
def live_extra() -> Iterator[None]:
    """Import in the block what needs rcmqp[live].

    Raises:
        ToolMissing: it is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("starlette", "uvicorn", "websockets"):
            raise
        raise ToolMissing(error.name or "starlette", "pip install 'rcmqp[live]'") from error


@contextlib.contextmanager
def opening() -> Iterator[Callable[[str], None]]:
    """Yield a function that opens an address in the browser, until the block ends.

    Everybody can read the arguments of a process, so the browser is given a file that only this
    user can read, and which leads to the address.
    """
    with tempfile.TemporaryDirectory(prefix="rcmqp-") as folder:

        def show(address: str) -> None:
            file = Path(folder) / "open.html"
            file.touch(0o600)
            file.write_text(PAGE.format(address=html.escape(address)), encoding="utf-8")
            webbrowser.open(file.as_uri())

        yield show
