"""rcmqp compare: controllers beside each other."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from rcmqp.cli import console
from rcmqp.cli import options as ask
from rcmqp.controllers.settings import controller_of, every_setting, registered, with_options
from rcmqp.errors import ArmError, OptionError, UnknownName
from rcmqp.files import absent
from rcmqp.runs.loading import own_arm, scenario_changes
from rcmqp.show.tables import tables
from rcmqp.world.loading import ARM_FILE, URDF_ENDINGS, arm_names, names_its_flange


def compare(
    scenario: Annotated[
        list[str], typer.Option("--scenario", "-s", help="Name or file; may be repeated.")
    ],
    arm: Annotated[
        list[str] | None,
        typer.Option(
            "--arm",
            "-a",
            help="Name, or the path of an arm's .toml or of a URDF with its flange, "
            "FILE.urdf:FLANGE; may be repeated; each scenario's own without it.",
        ),
    ] = None,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            "-c",
            help="NAME or FILE.py[:CLASS], and :OPTION=VALUE,OPTION=VALUE; may be repeated. "
            "Without it, all as they come, and with feed-forward, speed limits and both, if those "
            "are options.",
        ),
    ] = None,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for all files.")] = Path(
        "comparison"
    ),
    flange: ask.FlangeOption = None,
    acceleration: ask.AccelerationOption = None,
    jerk: ask.JerkOption = None,
    instrument: ask.InstrumentOption = None,
    trocar: ask.Trocar = None,
    axis: ask.Axis = None,
    depth: ask.Depth = None,
    cone: ask.Cone = None,
    tolerance: ask.Tolerance = None,
    period: Annotated[float | None, typer.Option(help="Sampling period T in s.")] = None,
    duration: Annotated[float | None, typer.Option(help="How long to simulate, in s.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of what is random.")] = None,
    governor: ask.GovernorOption = None,
    planner_from: ask.PlannerOption = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="An option, for each of the controllers that has it; may be repeated.",
        ),
    ] = None,
    jobs: ask.Jobs = 1,
    as_json: ask.AsJson = False,
) -> None:
    """Run scenarios x arms x controllers and put the results in one table.

    For example,

      rcmqp compare -s fast_helix -s breathing_trocar -a panda --jobs 2

      rcmqp compare -s moving_trocar -c dual_quaternion -c dual_quaternion:feed_forward=true

    The tables say what each controller was given: feed-forward, joint limits, period, gain. The
    folder gets every run, comparison.csv, comparison.md, comparison.tex and a figure of the errors
    for each scenario and arm. The numbers, except for times, do not depend on the number of jobs.

    Tables are written as the runs end. A comparison that is stopped goes on where it was when the
    same command is given again; runs that are in the folder are kept unless code has changed.
    """
    from rcmqp.experiments import compare as comparison  # joblib takes long to import

    given = settings or []
    chosen = [registered(setting) for setting in controller or every_setting(fixed=given)]
    laws = with_options(chosen, given)
    changes = (
        scenario_changes(
            governor, period=period, duration=duration, seed=seed, planner_from=planner_from
        )
        | ask.limits_of(acceleration, jerk).given()
        | ask.instrument_of(instrument)
        | ask.port_of(trocar, axis, depth, cone, tolerance)
    )
    files = [comparison.arm_and_flange(each) for each in arm or () if each not in arm_names()]
    for name, _ in files:
        if name is None or not name.lower().endswith((ARM_FILE, *URDF_ENDINGS)):
            raise UnknownName("arm", str(name), arm_names())
        if not Path(name).is_file():
            raise ArmError(f"{name}: {absent(name)}; give the path of a URDF or of an arm's .toml")
    urdfs = [own for name, own in files if not names_its_flange(str(name))]
    if flange is not None and all(urdfs):
        raise OptionError("--flange is for a URDF without its own, and none of the arms is one")
    for law in laws:
        controller_of(law)
    for name in scenario:
        own_arm(name)
    todo = comparison.cases(scenario, arm or [None], laws, changes, flange)
    notes: list[str] = []
    with console.bar(quiet=as_json) as advance:
        rows = comparison.compare(
            todo,
            folder,
            jobs=jobs,
            progress=lambda done: advance("runs", done, len(todo)),
            note=notes.append,
        )
    for note in notes:
        console.print_note(note)
    if as_json:
        console.print_json([dataclasses.asdict(row) for row in rows])
    else:
        console.print_tables(tables(rows))
        console.print_written(folder, ": all columns in comparison.md and comparison.csv")
    if any(row.failure for row in rows):
        raise typer.Exit(1)
