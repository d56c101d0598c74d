"""rcmqp run and show: simulate a run, or print the results of one."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from rcmqp.cli import console
from rcmqp.cli import options as ask
from rcmqp.cli.results import print_run
from rcmqp.controllers import CONTROLLERS, make_controller
from rcmqp.controllers.settings import controller_of, options_of, registered
from rcmqp.errors import OptionError, UnknownName
from rcmqp.files import check_writable, make_folder
from rcmqp.runs.head import Head, check_own, opened
from rcmqp.runs.loading import RUN_FILE, load_scenario, scenario_changes
from rcmqp.runs.moved import along, moved
from rcmqp.runs.run import Run
from rcmqp.runs.run_file import RunFile
from rcmqp.runs.simulate import record, simulate
from rcmqp.world.ease import ease_at
from rcmqp.world.loading import arm_names
from rcmqp.world.recorded import Recorded


def run(
    scenario: Annotated[
        str, typer.Argument(help="Name (see rcmqp scenarios), or a .py, .json or .h5 file.")
    ],
    arm: Annotated[
        str | None,
        typer.Option(
            "--arm",
            "-a",
            help="Name (see rcmqp arms), or the path of an arm's .toml or of a URDF; the "
            "scenario's own without it.",
        ),
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(
            "--controller",
            "-c",
            help="Name (see rcmqp controllers), or FILE.py[:CLASS]; without it, that of a run's "
            "file, or dual_quaternion.",
        ),
    ] = None,
    file: Annotated[
        Path | None, typer.Option("--out", "-o", help="HDF5 file to write the run to.")
    ] = None,
    flange: ask.FlangeOption = None,
    acceleration: ask.AccelerationOption = None,
    jerk: ask.JerkOption = None,
    path: Annotated[
        Path | None,
        typer.Option(
            "--path",
            help="CSV of the tip's way: t \\[s], x \\[mm], y \\[mm], z \\[mm], from the start.",
        ),
    ] = None,
    motion: Annotated[
        Path | None,
        typer.Option("--motion", help="CSV of the trocar's: t \\[s], world x \\[mm], and so on."),
    ] = None,
    instrument: ask.InstrumentOption = None,
    trocar: ask.Trocar = None,
    axis: ask.Axis = None,
    depth: ask.Depth = None,
    cone: ask.Cone = None,
    tolerance: ask.Tolerance = None,
    period: Annotated[
        float | None,
        typer.Option(help="Sampling period T in s; the scenario's, 0.001, without it."),
    ] = None,
    gain: Annotated[
        float | None, typer.Option(help="Gain K in 1/s; the controller's, 60, without it.")
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(help="How long to simulate, in s; the path keeps its own speed."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of everything random.")] = None,
    governor: ask.GovernorOption = None,
    planner_from: ask.PlannerOption = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="An option of the controller, such as feed_forward=true; may be repeated.",
        ),
    ] = None,
    as_json: ask.AsJson = False,
) -> None:
    """Run a scenario and print its results.

    For example,

      rcmqp run conical_helix --arm meka_a2 --period 0.008 --out helix.h5

      rcmqp run conical_helix --set feed_forward=true --set velocity_limit=scale --json

      rcmqp run conical_helix --arm my_robot.toml

      rcmqp run conical_helix --arm my_robot.urdf --flange tool0 --acceleration 8 --jerk 400

      rcmqp run circle --arm panda --instrument scope30.toml

      rcmqp run circle --arm panda --trocar 0.45,0.1,0.2 --depth 0.12

      rcmqp run circle --path tip.csv --motion breathing.csv

      rcmqp run fast_helix --controller hierarchical_qp --governor
    """
    if arm == "":
        raise UnknownName("arm", arm, arm_names())
    name, options = _law(scenario, controller, settings or [])
    if gain is not None:
        if "gain" in options:
            raise OptionError("the gain is given twice, by --gain and by --set gain")
        options["gain"] = gain
    given = (
        scenario_changes(
            governor, period=period, duration=duration, seed=seed, planner_from=planner_from
        )
        | ask.limits_of(acceleration, jerk).given()
        | ask.instrument_of(instrument)
        | ask.port_of(trocar, axis, depth, cone, tolerance)
    )
    chosen = load_scenario(scenario, arm, flange=flange, **given)
    if path is not None:
        chosen = dataclasses.replace(along(chosen, Recorded.read(path)), name=path.stem)
        if duration is not None:
            chosen = dataclasses.replace(chosen, duration=duration)
    if motion is not None:
        chosen = moved(chosen, Recorded.read(motion))
    insertion = chosen.insertion()
    if trocar is not None and tolerance is None and not as_json:
        console.err.print(f"start: {ease_at(insertion)}", highlight=False, soft_wrap=True)
    made = make_controller(name, insertion, chosen.period, **options)
    if file is not None:
        if file.resolve() == Path(scenario).resolve():
            raise OptionError(
                f"{file} is the run that is made again; give another file with --out"
            )
        check_own(file, chosen, made)
    with console.bar(quiet=as_json) as advance:

        def progress(done: int) -> None:
            advance(str(chosen), done, chosen.cycles)

        if file is None:
            result = simulate(chosen, made, progress)
        else:
            record(chosen, made, file, progress)
    if file is None:
        print_run(result, as_json, None)
    else:
        _show(file, as_json)


def _law(
    scenario: str, controller: str | None, settings: Sequence[str]
) -> tuple[str, dict[str, Any]]:
    """Name and options of the controller that was asked for, or of the one in a run's file."""
    if controller is not None or not scenario.endswith(RUN_FILE):
        return controller_of(registered(controller or "dual_quaternion"), settings)
    with opened(scenario) as run:
        head = Head.read(run)
    if head.controller not in CONTROLLERS and head.given.file:
        raise OptionError(
            f"{scenario} was made with {head.controller}, a law in a file of its author's; give "
            f"that file: --controller {head.given.file}"
        )
    return head.controller, {**head.options, **options_of(head.controller, settings)}


def show(
    file: Annotated[Path, typer.Argument(help="A run's HDF5 file.")],
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder to draw trajectory and errors into."),
    ] = None,
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            metavar="png|pdf|svg|eps",
            help="Of the figures; may be repeated; PNG and PDF without it.",
        ),
    ] = None,
    width: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Of the figures, such as 88 for a column."),
    ] = None,
    dpi: Annotated[float, typer.Option(help="Dots per inch of a PNG.")] = 160.0,
    as_json: ask.AsJson = False,
) -> None:
    """Show what is in a run's file.

    For example,

      rcmqp show helix.h5 --figures figures --format pdf --format eps --width 88
    """
    written: list[Path] = []
    if figures is not None:
        endings = [f".{each.lower().lstrip('.')}" for each in formats or ("png", "pdf")]
        written = _draw(Run.load(file), figures, file.stem, endings, width, dpi)
    elif formats or width is not None:
        raise OptionError("--format and --width are of figures; say where to: --figures FOLDER")
    _show(file, as_json)
    for path in written if not as_json else []:
        console.print_written(path)


def _show(file: Path, as_json: bool) -> None:
    """Print the results in a run's file."""
    with RunFile(file) as result:
        print_run(result, as_json, file)


def _draw(
    result: Run, folder: Path, stem: str, endings: Sequence[str], width: float | None, dpi: float
) -> list[Path]:
    """Draw trajectory and errors of a run; ``width`` of the figures is in mm."""
    from rcmqp.show import plots  # matplotlib takes long to import

    make_folder(folder)
    check_writable(folder / f"{stem}_errors{endings[0]}")
    inches = None if width is None else width / 25.4
    figures = {
        "trajectory": plots.trajectory_figure([result], width=inches),
        "errors": plots.error_figure([result], width=inches or plots.WIDTH),
    }
    return [
        path
        for name, figure in figures.items()
        for path in plots.save_figure(figure, folder / f"{stem}_{name}", endings=endings, dpi=dpi)
    ]
