"""rcmqp reproduce: the paper's experiments."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rcmqp.cli import console
from rcmqp.cli import options as ask
from rcmqp.cli.console import say
from rcmqp.cli.results import run_json
from rcmqp.cli.study import OPERATORS, PRACTICE, SEED, reproduce_b
from rcmqp.errors import OptionError, UnknownName
from rcmqp.runs.metrics import compute_metrics
from rcmqp.show.tables import tables


def reproduce(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for all files.")] = Path(
        "results"
    ),
    experiment: Annotated[str, typer.Option("--experiment", "-e", help="a or b.")] = "a",
    duration: Annotated[
        float | None, typer.Option(help="Only the first seconds of the helix, for a quick look.")
    ] = None,
    operators: Annotated[int | None, OPERATORS] = None,
    seed: Annotated[int | None, SEED] = None,
    jobs: Annotated[int | None, ask.JOBS] = None,
    factors: Annotated[
        bool,
        typer.Option(
            "--factors",
            help="Also every combination of law, period, feed-forward and limits: 12 more trials "
            "for each operator.",
        ),
    ] = False,
    trocar: ask.Trocar = None,
    axis: ask.Axis = None,
    depth: ask.Depth = None,
    cone: ask.Cone = None,
    tolerance: ask.Tolerance = None,
    instrument: ask.InstrumentOption = None,
    practice: Annotated[float | None, PRACTICE] = None,
    as_json: ask.AsJson = False,
) -> None:
    """Run the paper's experiments: runs, figures, table beside the paper's, report.

    Experiment A: the tool tip of a Schunk LWA3 and of a Meka A2 draws a conical helix under the
    paper's controller, at T = 8 ms, which the paper's Table I implies, and at 1 ms. Then the
    controller stands beside hierarchical_qp at 1 ms: with feed-forward and without, and on a
    helix that is too fast for the arms, with speed limits. The folder's index.html shows it all.

    Experiment B: simulated operators steer the endoscope of a Schunk LWA3 to four views, at 8 ms;
    --operators, --seed, --jobs, --factors and --practice are for it.
    """
    if experiment.lower() not in ("a", "b"):
        raise UnknownName("experiment", experiment, ("a", "b"))
    of_b = {"--operators": operators, "--seed": seed, "--jobs": jobs, "--practice": practice}
    of_b["--factors"] = factors or None
    idle = of_b if experiment.lower() == "a" else {"--duration": duration}
    for option, value in idle.items():
        if value is not None:
            raise OptionError(f"{option} is not for experiment {experiment.lower()}")
    port = ask.port_of(trocar, axis, depth, cone, tolerance).get("port")
    if experiment.lower() == "b":
        people = 20 if operators is None else operators
        processes = 1 if jobs is None else jobs
        reproduce_b(
            folder, people, seed or 0, processes, as_json, factors, practice, port, instrument
        )
        return
    from rcmqp.experiments.experiment_a import reproduce_a

    with console.bar(quiet=as_json) as advance:
        found = reproduce_a(
            folder, duration=duration, port=port, instrument=instrument, progress=advance
        )
    if as_json:
        runs = [*found.runs, *found.rivals]
        console.print_json([run_json(each, compute_metrics(each)) for each in runs])
        return
    say(found.table)
    console.print_tables(tables(found.beside))
    for path in found.files:
        console.print_written(path)
