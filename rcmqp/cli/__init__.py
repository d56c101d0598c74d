"""The command line: rcmqp run, show, compare, and so on."""

from __future__ import annotations

import importlib.metadata
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from typing import Annotated, NoReturn

import typer
from rich.markup import escape

import rcmqp
from rcmqp.cli import (
    calibrate,
    compare,
    doctor,
    lists,
    live,
    loopback,
    new,
    reproduce,
    run,
    study,
    trial,
    viewer,
)
from rcmqp.cli.console import err, out, show_warning
from rcmqp.errors import ArmWarning, RcmqpError
from rcmqp.runs.untrusted import shortened
from rcmqp.world.plugins import place_of

app = typer.Typer(
    name="rcmqp",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Remote-centre-of-motion control of surgical arms.\n\n"
    "Try [bold]rcmqp run conical_helix --arm lwa3[/bold], then [bold]rcmqp reproduce[/bold] "
    "for the paper's experiment A.\n\n"
    "Exit codes: 0 done; 1 refused or failed, with the reason on stderr; 2 wrong usage; "
    "130 interrupted, 143 if by SIGTERM.",
)
DEBUG = "RCMQP_DEBUG"
"""Environment variable that shows the traceback of an error."""

NEXT = (
    ("rcmqp run conical_helix --out helix.h5", "simulate a run, and keep it"),
    ("rcmqp view helix.h5", "look at it in the browser"),
    ("rcmqp compare -s circle -a panda", "every controller, in one table"),
    ("rcmqp reproduce", "the paper's experiment A, with a report"),
    ("rcmqp run conical_helix -a my.urdf --flange tool0", "a robot of your own"),
    ("rcmqp arms; rcmqp scenarios; rcmqp controllers", "what is there"),
    ("rcmqp doctor", "what is installed, and what is missing"),
    ("rcmqp --help", "every command"),
)
"""What rcmqp shows when it is called without anything."""

INTERRUPTED = (130, 143)
"""The exit codes after Ctrl-C and SIGTERM, by a shell's custom."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; any error ends it with a sentence and exit code 1."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        with warnings.catch_warnings():
            warnings.showwarning = show_warning
            warnings.simplefilter("default", ArmWarning)
            app(given)
    except RcmqpError as error:
        _say_and_end(error, str(error))
    except KeyboardInterrupt:  # before the command began
        _say_interrupted(given)
        raise SystemExit(INTERRUPTED[0]) from None
    except SystemExit as end:
        if end.code in INTERRUPTED:
            _say_interrupted(given)
        raise
    except Exception as error:  # noqa: BLE001  (the last resort: no user sees a traceback)
        name = type(error).__name__
        if (place := place_of(error)) is not None:
            _say_and_end(error, f"{place}: {name}: {error}")
        _say_and_end(
            error,
            f"rcmqp failed where it did not expect to: {name}: {error}; please report the command "
            f"and this line {_where_to_report()}; with {DEBUG}=1 set, it shows the traceback",
        )


def _say_interrupted(given: Sequence[str]) -> None:
    goes_on = tuple(given[:1]) in (("study",), ("compare",))
    more = "; the same command goes on from here" if goes_on else ""
    err.print(f"interrupted{more}", highlight=False)
    warnings.filterwarnings("ignore", "coroutine .* was never awaited")  # as the process ends


def _say_and_end(error: Exception, said: str) -> NoReturn:
    """Print what happened, the traceback where it is asked for, and end with exit code 1."""
    if os.environ.get(DEBUG, "0") not in ("", "0"):
        err.print("".join(traceback.format_exception(error)), markup=False, highlight=False)
    err.print(f"[bold red]error:[/] {escape(shortened(said))}", soft_wrap=True, highlight=False)
    sys.exit(1)


def _where_to_report() -> str:
    """The address of the project's issues, as its package says it."""
    try:
        urls = importlib.metadata.metadata("rcmqp").get_all("Project-URL") or []
    except importlib.metadata.PackageNotFoundError:
        urls = []
    addresses = [
        address for name, _, address in (url.partition(",") for url in urls) if name == "Issues"
    ]
    return f"at {addresses[0].strip()}" if addresses else "to whom you have rcmqp from"


def run_file(file: str) -> None:
    """Run a scenario's file as ``rcmqp run`` does; for a file that is run as a program."""
    main(["run", file, *sys.argv[1:]])


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        out.print(rcmqp.__version__, highlight=False)
        raise typer.Exit
    if context.invoked_subcommand is None:
        out.print(f"rcmqp {rcmqp.__version__}: RCM control of surgical arms. What to do next:")
        for line, about in NEXT:
            out.print(f"  {line:51} {about}", markup=False, highlight=False, soft_wrap=True)


for command in (
    run.run,
    run.show,
    lists.arms,
    lists.scenarios,
    lists.controllers,
    doctor.doctor,
    compare.compare,
    study.study,
    study.hands,
    calibrate.calibrate,
    reproduce.reproduce,
    loopback.loopback,
    live.live,
    new.new,
    trial.trial,
    viewer.view,
    viewer.snapshot,
    viewer.video,
    viewer.report,
):
    app.command()(command)
