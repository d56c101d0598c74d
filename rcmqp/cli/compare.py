"""rcmqp compare: controllers beside each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rcmqp.cli import console
from rcmqp.cli.options import (
    AccelerationOption,
    AsJson,
    Axis,
    Cone,
    Depth,
    FlangeOption,
    GovernorOption,
    JerkOption,
    Jobs,
    Tolerance,
    Trocar,
    governor_change,
    limits_of,
    port_of,
)
from rcmqp.controllers.settings import controller_of, every_setting, with_options
from rcmqp.errors import OptionError, UnknownName
from rcmqp.runs.loading import scenario_module
from rcmqp.show.tables import tables
from rcmqp.world.loading import arm_names, names_its_flange


def compare(
    scenario: Annotated[
        list[str], typer.Option("--scenario", "-s", help="Name or file; may be repeated.")
    ],
    arm: Annotated[
        list[str] | None,
        typer.Option(
            "--arm",
            "-a",
            help="Name, or the path of an arm's .toml or URDF; may be repeated; each scenario's "
            "own without it.",
        ),
    ] = None,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            "-c",
            help="NAME, or NAME:OPTION=VALUE,OPTION=VALUE; may be repeated. Without it, all as "
            "they come, and with feed-forward, speed limits and both, if those are options.",
        ),
    ] = None,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for all files.")] = Path(
        "comparison"
    ),
    flange: FlangeOption = None,
    acceleration: AccelerationOption = None,
    jerk: JerkOption = None,
    trocar: Trocar = None,
    axis: Axis = None,
    depth: Depth = None,
    cone: Cone = None,
    tolerance: Tolerance = None,
    period: Annotated[float | None, typer.Option(help="Sampling period T in s.")] = None,
    duration: Annotated[float | None, typer.Option(help="How long to simulate, in s.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of what is random.")] = None,
    governor: GovernorOption = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="An option, for each of the controllers that has it; may be repeated.",
        ),
    ] = None,
    jobs: Jobs = 1,
    as_json: AsJson = False,
) -> None:
    """Run scenarios x arms x controllers and put what came of it in one table.

    For example,

      rcmqp compare -s fast_helix -s breathing_trocar -a panda --jobs 2

      rcmqp compare -s moving_trocar -c dual_quaternion -c dual_quaternion:feed_forward=true

    The tables say what each controller was given: feed-forward, joint limits, period, gain. The
    folder gets every run, comparison.csv, comparison.md and a figure of the errors for each
    scenario and arm. The numbers, but for times, do not depend on the number of jobs.
    """
    from rcmqp.experiments import compare as comparison  # joblib takes long to import

    changes: dict[str, Any] = {"period": period, "duration": duration, "seed": seed}
    given = settings or []
    laws = with_options(controller or every_setting(fixed=given), given)
    files = [name for name in arm or () if name not in arm_names()]
    for name in files:
        if not Path(name).is_file():
            raise UnknownName("arm", name, arm_names())
    urdfs = [name for name in files if not names_its_flange(name)]
    if flange is not None and not urdfs:
        raise OptionError("--flange is for a URDF, and none of the arms is one")
    for law in laws:
        controller_of(law)
    for name in scenario:
        scenario_module(name)
    if jobs == 0:
        raise OptionError("--jobs 0: give at least 1, or -1 for every core")
    todo = comparison.cases(
        scenario,
        arm or [None],
        laws,
        {name: value for name, value in changes.items() if value is not None}
        | governor_change(governor)
        | limits_of(acceleration, jerk).given()
        | port_of(trocar, axis, depth, cone, tolerance),
        flange,
    )
    with console.bar(quiet=as_json) as advance:
        rows = comparison.compare(
            todo, folder, jobs=jobs, progress=lambda done: advance("runs", done, len(todo))
        )
    if as_json:
        console.print_json([console.row_json(row) for row in rows])
    else:
        console.print_tables(tables(rows))
        console.print_written(folder, ": all columns in comparison.md and comparison.csv")
    if any(row.failure for row in rows):
        raise typer.Exit(1)
