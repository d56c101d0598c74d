"""The command line of studies: rcmqp study, hands, and experiment B of rcmqp reproduce."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rcmqp.cli import console
from rcmqp.cli import options as ask
from rcmqp.cli.console import print_written, say
from rcmqp.controllers.settings import FILE_SETTING, controller_of, registered
from rcmqp.errors import OptionError
from rcmqp.runs.loading import scenario_changes, scenario_names

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
        typer.Option(
            "--arm",
            "-a",
            help="Name, or the path of an arm's .toml or of a URDF; may be repeated; the "
            "scenario's own without it.",
        ),
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
    flange: ask.FlangeOption = None,
    acceleration: ask.AccelerationOption = None,
    jerk: ask.JerkOption = None,
    trocar: ask.Trocar = None,
    axis: ask.Axis = None,
    depth: ask.Depth = None,
    cone: ask.Cone = None,
    tolerance: ask.Tolerance = None,
    instrument: ask.InstrumentOption = None,
    practice: Annotated[float | None, PRACTICE] = None,
    hand: Annotated[
        list[Path] | None,
        typer.Option(
            help="CSV file of a recorded hand, columns t, x, y, z, units in the head such as "
            "x \\[mm], metres without; may be repeated. Each is replayed with every controller."
        ),
    ] = None,
    jobs: ask.Jobs = 1,
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

    No file that the folder names is run. If a controller of the study is your own, --operators
    and --hand need it again: -c my_law.py.
    """
    from rcmqp.experiments.study.perform import perform  # joblib and SciPy take long to import
    from rcmqp.experiments.study.plan import Law, Study, learning_of
    from rcmqp.experiments.study.replay import read_hands, replay, study_conditions
    from rcmqp.experiments.study.report import write_figures, write_tables

    if scenario.endswith(".h5"):
        _remake(Path(scenario), folder or STUDY)
        return
    if (Path(scenario) / "study.json").is_file():  # see experiments.trial.design
        others: tuple[object, ...] = (arm, gain, period, flange, acceleration)
        others += (jerk, trocar, axis, depth, cone, tolerance, instrument, practice, folder)
        own = controller or []
        files = all(map(FILE_SETTING.fullmatch, own)) and (not own or operators or hand)
        if not files or any(each is not None for each in others):
            raise OptionError(
                f"{scenario} says what people did and with which controllers, and has all files; "
                "with it, give no more than --operators, --hand, --seed, --jobs and --json, and "
                "with --operators or --hand also -c FILE.py for each controller of your own"
            )
        _people(Path(scenario), operators or 0, hand or [], seed, jobs, as_json, own)
        return
    _check_known(scenario)
    operators = 20 if operators is None else operators
    given = scenario_changes(None, period=period)
    laws = [
        Law(name, options=tuple(options.items()), **given)
        for name, options in _settings(controller or ["dual_quaternion"], gain or [])
    ]
    arms = tuple(arm or [""])
    limits = ask.limits_of(acceleration, jerk)
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
        **ask.port_of(trocar, axis, depth, cone, tolerance),
        **ask.instrument_of(instrument),
    )
    hands = read_hands(hand or [])
    with console.bar(quiet=as_json) as advance:
        performed = perform(chosen, folder or STUDY, jobs=jobs, progress=advance)
    recorded = replay(hands, study_conditions(chosen), performed.folder) if hands else []
    text, files = write_tables(performed, recorded=recorded)
    files += write_figures(performed)
    outcomes = {"simulated": performed.outcomes, "recorded": [each.outcome for each in recorded]}
    _print(outcomes, performed.notes, [text], files, as_json)


def _check_known(scenario: str) -> None:
    """Refuse what is neither a scenario's name, nor its file, nor a folder of rcmqp trial."""
    if scenario.endswith((".py", ".json")) or scenario.replace("-", "_") in scenario_names():
        return
    if Path(scenario).is_dir():
        raise OptionError(
            f"{scenario}: the folder has no study.json; give a folder that rcmqp trial made"
        )
    close = difflib.get_close_matches(scenario, scenario_names(), n=1, cutoff=0.7)
    raise OptionError(
        f"{scenario} is neither a folder made by rcmqp trial nor the name of a scenario"
        + (f"; did you mean {close[0]}?" if close else "; rcmqp scenarios lists the scenarios")
    )


def _settings(
    controllers: Sequence[str], gains: Sequence[float]
) -> list[tuple[str, dict[str, Any]]]:
    """Name and options of each controller, once with each gain."""
    laws = [controller_of(registered(setting)) for setting in controllers]
    for name, options in laws:
        if gains and "gain" in options:
            raise OptionError(f"the gain of {name} is given twice, by --gain and by -c")
    if not gains:
        return laws
    return [(name, options | {"gain": k}) for name, options in laws for k in gains]


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
    from rcmqp.experiments.study.plan import learning_of

    with console.bar(quiet=as_json) as advance:
        experiment = experiment_b.reproduce_b(
            folder,
            operators=operators,
            seed=seed,
            jobs=jobs,
            factors=factors,
            learning=learning_of(practice),
            port=port,
            **ask.instrument_of(instrument),
            progress=advance,
        )
    studies = [experiment.performed, *([experiment.factorial] if experiment.factorial else [])]
    outcomes = [outcome for each in studies for outcome in each.outcomes]
    notes = [note for each in studies for note in each.notes]
    texts = [experiment.table, *([experiment.factor_table] if experiment.factorial else [])]
    _print({"simulated": outcomes}, notes, texts, experiment.files, as_json)


def _people(
    folder: Path,
    operators: int,
    hands: Sequence[Path],
    seed: int,
    jobs: int,
    as_json: bool,
    own: Sequence[str],
) -> None:
    """Sum up a study with people."""
    from rcmqp.experiments.trial.report import write_figures, write_results
    from rcmqp.experiments.trial.results import read_results

    with console.bar(quiet=as_json) as advance:
        results = read_results(
            folder,
            operators=operators,
            hands=hands,
            seed=seed,
            jobs=jobs,
            progress=advance,
            controllers=own,
        )
    text, files = write_results(results)
    files.append(write_figures(results))
    drawn = results.simulated
    outcomes = {
        "people": results.outcomes,
        "simulated": drawn.outcomes if drawn else [],
        "recorded": [each.outcome for each in results.recorded],
    }
    notes = [*results.remarks, *(drawn.notes if drawn else [])]
    _print(outcomes, notes, [text], files, as_json)


def _print(
    outcomes: Mapping[str, Sequence[Outcome]],
    notes: Sequence[str],
    texts: Sequence[str],
    files: Sequence[Path],
    as_json: bool,
) -> None:
    """Print tables and files, or the outcomes by whose they are as JSON."""
    from rcmqp.experiments.study.trial_file import plain

    each = [(whose, outcome) for whose, of in outcomes.items() for outcome in of]
    for note in notes:
        console.print_note(note)
    if as_json:
        console.print_json([{"whose": whose} | plain(outcome) for whose, outcome in each])
    else:
        for text in texts:
            say(text)
        for file in files:
            console.print_written(file)
    if any(outcome.failure for _, outcome in each):
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
    say(f"wrote {file}: rcmqp view {file}")


def hands(
    recordings: Annotated[
        list[Path],
        typer.Argument(metavar="RECORDING...", help="CSV files with the columns t, x, y, z."),
    ],
    scale: Annotated[
        float, typer.Option(help="Metres in the files' unit of length; 0.001 for mm.")
    ] = 1.0,
    operators: Operators = 20,
    seed: Seed = 0,
    practice: Annotated[float | None, PRACTICE] = None,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for all files.")] = Path(
        "hands"
    ),
) -> None:
    """Compare recorded hands or tools with the operator model's: spectra, smoothness.

    For example, rcmqp hands surgeon.csv --scale 0.001 --out hands. The table and the figure show
    speed spectra, SPARC and LDLJ; nothing of the model was fitted to them.
    """
    from rcmqp.experiments.study.hands import compare_hands  # SciPy and joblib take long to import
    from rcmqp.experiments.study.plan import learning_of

    comparison = compare_hands(
        recordings,
        folder,
        scale=scale,
        operators=operators,
        seed=seed,
        learning=learning_of(practice),
    )
    say(comparison.table)
    for path in comparison.files:
        print_written(path)
