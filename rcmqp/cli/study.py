"""The command line of studies: rcmqp study, and experiment B of rcmqp reproduce."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rcmqp.cli import console
from rcmqp.cli.console import out
from rcmqp.cli.options import (
    AccelerationOption,
    Axis,
    Cone,
    Depth,
    FlangeOption,
    InstrumentOption,
    JerkOption,
    Jobs,
    Tolerance,
    Trocar,
    instrument_of,
    limits_of,
    port_of,
    scenario_changes,
)
from rcmqp.controllers import own_file
from rcmqp.controllers.settings import controller_of
from rcmqp.errors import OptionError
from rcmqp.references.operators import Learning

if TYPE_CHECKING:
    from rcmqp.experiments.study.outcome import Outcome
    from rcmqp.world.port import Port

STUDY = Path("study")
"""Folder of a study without --out."""

OPERATORS = typer.Option(help="How many simulated people, 20 without it; novices take turns.")
SEED = typer.Option(help="Of everything random; 0 without it.")
PRACTICE = typer.Option(
    help="Seconds of practice that novices had, the paper's 120 or others; with it they also "
    "learn during the trial. Without it nobody learns."
)
Operators = Annotated[int, OPERATORS]
Seed = Annotated[int, SEED]


def study(
    scenario: Annotated[
        str,
        typer.Argument(
            help="camera_task, a file like it, a trial's .h5, or a folder of rcmqp trial."
        ),
    ],
    operators: Annotated[
        int | None,
        typer.Option(
            help="How many simulated people; novices take turns. 20 without it, or none with a "
            "folder of rcmqp trial."
        ),
    ] = None,
    seed: Seed = 0,
    arm: Annotated[
        list[str] | None,
        typer.Option("--arm", "-a", help="Name; may be repeated; the scenario's own without it."),
    ] = None,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            "-c",
            help="NAME or FILE.py[:CLASS], and :OPTION=VALUE,OPTION=VALUE; may be repeated; "
            "dual_quaternion without it.",
        ),
    ] = None,
    gain: Annotated[
        list[float] | None, typer.Option(help="K in 1/s; may be repeated: each is a controller.")
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(help="T in s; 0.008 for dual_quaternion, 0.001 for others, without it."),
    ] = None,
    flange: FlangeOption = None,
    acceleration: AccelerationOption = None,
    jerk: JerkOption = None,
    trocar: Trocar = None,
    axis: Axis = None,
    depth: Depth = None,
    cone: Cone = None,
    tolerance: Tolerance = None,
    instrument: InstrumentOption = None,
    practice: Annotated[float | None, PRACTICE] = None,
    hand: Annotated[
        list[Path] | None,
        typer.Option(
            help="CSV file of a recorded hand, columns t, x, y, z, units in the head such as "
            "x [mm]; may be repeated. Each is replayed with every controller."
        ),
    ] = None,
    jobs: Jobs = 1,
    folder: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for all files; study without it.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print every trial as JSON.")] = False,
) -> None:
    """Let simulated operators do a task, or sum up what people did: people x arms x controllers.

    For example,

      rcmqp study camera_task --operators 20 --seed 1 --jobs 2

      rcmqp study camera_task -a lwa3 -a panda -c dual_quaternion -c hierarchical_qp

      rcmqp study camera_task -c dual_quaternion -c dual_quaternion:feed_forward=true

    Each trial is a file of its own in the folder; a study that is stopped goes on where it was
    when the same command is given again. The table does not depend on the number of jobs.

    A trial's file holds its numbers and no run. To look at one, simulate it again, whole:

      rcmqp study study/runs/dual_quaternion_8ms_operator0003.h5 --out again

    With a folder that rcmqp trial filled, people are summed up, and as many simulated operators
    as are asked for do the same task beside them; all files go to that folder:

      rcmqp study my_study --operators 20 --hand surgeon.csv
    """
    from rcmqp.experiments.study.perform import perform  # joblib and SciPy take long to import
    from rcmqp.experiments.study.plan import Law, Study
    from rcmqp.experiments.study.replay import replay, study_conditions
    from rcmqp.experiments.study.report import write_figures, write_tables

    if scenario.endswith(".h5"):
        _remake(Path(scenario), folder or STUDY)
        return
    if (Path(scenario) / "study.json").is_file():  # see experiments.trial.design
        others: tuple[object, ...] = (arm, controller, gain, period, flange, acceleration)
        others += (jerk, trocar, axis, depth, cone, tolerance, instrument, practice, folder)
        if any(each is not None for each in others):
            raise OptionError(
                f"{scenario} says what people did and with which controllers, and has all files; "
                "with it, give no more than --operators, --hand, --seed, --jobs and --json"
            )
        _people(Path(scenario), operators or 0, hand or [], seed, jobs, as_json)
        return
    operators = 20 if operators is None else operators
    given = scenario_changes(None, period=period)
    laws = [
        Law(name, options=tuple(options.items()), **given)
        for name, options in _settings(controller or ["dual_quaternion"], gain or [])
    ]
    arms = tuple(arm or [""])
    limits = limits_of(acceleration, jerk)
    learning = learning_of(practice)
    chosen = Study(
        scenario,
        operators,
        seed,
        arms,
        tuple(laws),
        flange,
        limits,
        learning,
        **port_of(trocar, axis, depth, cone, tolerance),
        **instrument_of(instrument),
    )
    with console.bar(quiet=as_json) as advance:
        performed = perform(chosen, folder or STUDY, jobs=jobs, progress=advance)
    recorded = replay(hand, study_conditions(chosen), performed.folder) if hand else []
    text, files = write_tables(performed, recorded=recorded)
    files += write_figures(performed)
    outcomes = [*performed.outcomes, *(each.outcome for each in recorded)]
    _print(outcomes, performed.notes, [text], files, as_json)


def _settings(
    controllers: Sequence[str], gains: Sequence[float]
) -> list[tuple[str, dict[str, Any]]]:
    """Name and options of each controller, once with each gain."""
    made = [controller_of(own_file.known(setting)) for setting in controllers]
    for name, options in made:
        if gains and "gain" in options:
            raise OptionError(f"the gain of {name} is given twice, by --gain and by -c")
    if not gains:
        return made
    return [(name, options | {"gain": k}) for name, options in made for k in gains]


def reproduce_b(
    folder: Path,
    operators: int,
    seed: int,
    jobs: int,
    as_json: bool,
    factors: bool,
    practice: float | None,
    port: Port | None = None,
    instrument: str | None = None,
) -> None:
    """The paper's experiment B: its law at T = 8 ms, on the LWA3."""
    from rcmqp.experiments.study import experiment_b  # joblib and SciPy take long to import

    with console.bar(quiet=as_json) as advance:
        found = experiment_b.reproduce_b(
            folder,
            operators=operators,
            seed=seed,
            jobs=jobs,
            factors=factors,
            learning=learning_of(practice),
            port=port,
            **instrument_of(instrument),
            progress=advance,
        )
    studies = [found.performed, *([found.factorial] if found.factorial else [])]
    outcomes = [outcome for each in studies for outcome in each.outcomes]
    notes = [note for each in studies for note in each.notes]
    texts = [found.table, *([found.factor_table] if found.factorial else [])]
    _print(outcomes, notes, texts, found.files, as_json)


def learning_of(practice: float | None) -> Learning | None:
    """What --practice asks for."""
    return None if practice is None else Learning(practice)


def _people(
    folder: Path, operators: int, hands: Sequence[Path], seed: int, jobs: int, as_json: bool
) -> None:
    """Sum up a study with people."""
    from rcmqp.experiments.trial.report import write_figures, write_results
    from rcmqp.experiments.trial.results import read_results

    with console.bar(quiet=as_json) as advance:
        found = read_results(
            folder, operators=operators, hands=hands, seed=seed, jobs=jobs, progress=advance
        )
    text, files = write_results(found)
    files.append(write_figures(found))
    drawn = found.simulated
    outcomes = [*found.outcomes, *(drawn.outcomes if drawn else [])]
    outcomes += [each.outcome for each in found.recorded]
    notes = [*found.remarks, *(drawn.notes if drawn else [])]
    _print(outcomes, notes, [text], files, as_json)


def _print(
    outcomes: Sequence[Outcome],
    notes: Sequence[str],
    texts: Sequence[str],
    files: Sequence[Path],
    as_json: bool,
) -> None:
    from rcmqp.experiments.study.trial_file import plain

    for note in notes:
        console.print_note(note)
    if as_json:
        console.print_json([plain(outcome) for outcome in outcomes])
    else:
        for text in texts:
            out.print(text, markup=False, highlight=False, soft_wrap=True)
        for file in files:
            out.print(f"wrote {file}", markup=False, highlight=False, soft_wrap=True)
    if any(outcome.failure for outcome in outcomes):
        raise typer.Exit(1)


def _remake(trial: Path, folder: Path) -> None:
    """Simulate a trial again and keep its run."""
    from rcmqp.experiments.study.perform import remake
    from rcmqp.experiments.study.plan import Law
    from rcmqp.experiments.study.trial_file import TrialFile
    from rcmqp.files import make_folder
    from rcmqp.runs.head import check_own
    from rcmqp.runs.scenario import Scenario

    file = make_folder(folder) / trial.name
    if file.resolve() == trial.resolve():
        raise OptionError(f"{file} is the trial itself; give another folder with --out")
    record = TrialFile.load(trial)
    scenario = Scenario.from_json(record.scenario)
    check_own(file, scenario, Law.from_json(record.law).controller(scenario))
    run = remake(trial)
    run.save(file)
    if run.digest != record.outcome.digest:
        console.err.print(
            "note: its digest is not the trial's: other versions, another controller of that name "
            "or another URDF ran that",
            soft_wrap=True,
        )
    out.print(f"wrote {file}: rcmqp view {file}", markup=False, highlight=False, soft_wrap=True)
