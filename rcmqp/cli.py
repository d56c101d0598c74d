"""The command line: rcmqp run, show, compare, and so on; view and its kin are the viewer's."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

import rcmqp
from rcmqp import console
from rcmqp.console import err, out
from rcmqp.controllers import CONTROLLERS, controller_options, make_controller
from rcmqp.errors import OptionError, RcmqpError, UnknownName
from rcmqp.loading import arm_names, load_arm
from rcmqp.metrics import compute_metrics
from rcmqp.report import cli as report_cli
from rcmqp.run import Run, check_writable, make_folder
from rcmqp.run_file import RunFile
from rcmqp.scenario import load_scenario, scenario_module, scenario_names
from rcmqp.simulate import record, simulate
from rcmqp.study import command as study_command
from rcmqp.viewer.cli import register

app = typer.Typer(
    name="rcmqp",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Remote-centre-of-motion control of surgical arms.\n\n"
    "Try [bold]rcmqp run conical_helix --arm lwa3[/bold], then [bold]rcmqp reproduce[/bold] "
    "for the paper's experiment A.\n\n"
    "Exit codes: 0 done; 1 refused or failed, with the reason on stderr; 2 wrong usage; "
    "130 interrupted.",
)
INTERRUPTED = 130
"""The exit code after Ctrl-C, by a shell's custom."""

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
ArmOption = Annotated[
    str | None,
    typer.Option("--arm", "-a", help="Name (see rcmqp arms), or a URDF's path; lwa3 without it."),
]
FlangeOption = Annotated[
    str | None, typer.Option(help="With a URDF: the frame that carries the instrument.")
]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; an RcmqpError ends it with its message and exit code 1."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        app(given)
    except RcmqpError as error:
        err.print(f"[bold red]error:[/] {escape(str(error))}", soft_wrap=True, highlight=False)
        sys.exit(1)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            more = "; the same command goes on from here" if "study" in given[:1] else ""
            err.print(f"interrupted{more}", highlight=False)
        raise


def run_file(file: str) -> None:
    """What a scenario's file does when it is run by itself: rcmqp run, with that file."""
    main(["run", file, *sys.argv[1:]])


@app.callback(invoke_without_command=True)
def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        out.print(rcmqp.__version__, highlight=False)
        raise typer.Exit


@app.command()
def run(
    scenario: Annotated[
        str, typer.Argument(help="Name (see rcmqp scenarios), or a .py or .json file.")
    ],
    arm: ArmOption = None,
    controller: Annotated[
        str, typer.Option("--controller", "-c", help="Name (see rcmqp controllers).")
    ] = "dual_quaternion",
    file: Annotated[
        Path | None, typer.Option("--out", "-o", help="HDF5 file to write the run to.")
    ] = None,
    flange: FlangeOption = None,
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
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="An option of the controller, such as feed_forward=true; may be repeated.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a scenario and print what came of it.

    For example,

      rcmqp run conical_helix --arm meka_a2 --period 0.008 --out helix.h5

      rcmqp run conical_helix --set feed_forward=true --set velocity_limit=scale --json

      rcmqp run conical_helix --arm my_robot.urdf --flange tool0
    """
    options = _options(controller, settings or [])
    if gain is not None:
        if "gain" in options:
            raise OptionError("the gain is given twice, by --gain and by --set gain")
        options["gain"] = gain
    changes = {"period": period, "duration": duration, "seed": seed}
    chosen = load_scenario(
        scenario, arm, flange=flange, **{k: x for k, x in changes.items() if x is not None}
    )
    made = make_controller(controller, chosen.insertion(), chosen.period, **options)
    if file is not None:
        check_writable(file)
    with console.bar(quiet=as_json) as advance:

        def progress(done: int) -> None:
            advance(str(chosen), done, chosen.cycles)

        if file is None:
            result = simulate(chosen, made, progress)
        else:
            record(chosen, made, file, progress)
    if file is None:
        console.print_run(result, as_json, None)
    else:
        _show(file, as_json)


@app.command()
def show(
    file: Annotated[Path, typer.Argument(help="A run's HDF5 file.")],
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder to draw trajectory and errors into, as PNG and PDF."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show what is in a run's file."""
    written = [] if figures is None else _draw(Run.load(file), figures, file.stem)
    _show(file, as_json)
    for path in written if not as_json else []:
        out.print(f"wrote {path}", highlight=False, soft_wrap=True)


@app.command()
def arms(
    name: Annotated[str | None, typer.Argument(help="Only this arm, joint by joint.")] = None,
    flange: FlangeOption = None,
    as_json: AsJson = False,
) -> None:
    """List the arms with joints, reach, limits and licence; or one arm's joints.

    [NAME] may also be the path of a URDF, with --flange.
    """
    chosen = [load_arm(each, flange) for each in ([name] if name else arm_names())]
    if as_json:
        console.print_json([console.arm_json(arm) for arm in chosen])
    elif name is None:
        console.print_arms(chosen)
    else:
        console.print_arm(chosen[0])


@app.command()
def scenarios(as_json: AsJson = False) -> None:
    """List the scenarios."""
    about = {name: _first_line(scenario_module(name)) for name in scenario_names()}
    if as_json:
        console.print_json(about)
        return
    console.print_table(("name", "what happens"), about.items())


@app.command()
def controllers(
    name: Annotated[str | None, typer.Argument(help="Only this one, explained.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the controllers with their options (for --set) and defaults; or explain one."""
    names = list(CONTROLLERS) if name is None else [name.replace("-", "_")]
    for each in names:
        if each not in CONTROLLERS:
            raise UnknownName("controller", each, CONTROLLERS)
    if as_json:
        console.print_json({each: controller_options(each) for each in names})
    elif name is not None:
        out.print(inspect.getdoc(CONTROLLERS[names[0]]), markup=False, highlight=False)
    else:
        rows = []
        for each in names:
            options = ", ".join(
                f"{option}={_text(default)}"
                for option, default in controller_options(each).items()
            )
            rows.append((each, _first_line(inspect.getmodule(CONTROLLERS[each])), options))
        console.print_table(("name", "what it is", "options"), rows)
        out.print("rcmqp controllers NAME explains one.", style="dim")


@app.command()
def compare(
    scenario: Annotated[
        list[str], typer.Option("--scenario", "-s", help="Name or file; may be repeated.")
    ],
    arm: Annotated[
        list[str] | None,
        typer.Option(
            "--arm",
            "-a",
            help="Name, or a URDF's path; may be repeated; each scenario's own without it.",
        ),
    ] = None,
    controller: Annotated[
        list[str] | None,
        typer.Option("--controller", "-c", help="Name; may be repeated; all without it."),
    ] = None,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for all files.")] = Path(
        "comparison"
    ),
    flange: FlangeOption = None,
    period: Annotated[float | None, typer.Option(help="Sampling period T in s.")] = None,
    duration: Annotated[float | None, typer.Option(help="How long to simulate, in s.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of what is random.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="An option, for each of the controllers that has it; may be repeated.",
        ),
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", "-j", help="Processes; -1 for every core.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Run scenarios x arms x controllers and put what came of it in one table.

    For example,

      rcmqp compare -s fast_helix -s breathing_trocar -a panda --jobs 2

    The folder gets every run, comparison.csv, comparison.md and a figure of the errors for each
    scenario and arm. The numbers, but for times, do not depend on the number of jobs.
    """
    from rcmqp import compare as comparison  # joblib and matplotlib take long to import

    changes = {"period": period, "duration": duration, "seed": seed}
    laws = [name.replace("-", "_") for name in controller or CONTROLLERS]
    urdfs = [name for name in arm or () if name not in arm_names()]
    for name in urdfs:
        if not Path(name).is_file():
            raise UnknownName("arm", name, arm_names())
    if flange is not None and not urdfs:
        raise OptionError("--flange is for a URDF, and none of the arms is one")
    for name in laws:
        if name not in CONTROLLERS:
            raise UnknownName("controller", name, CONTROLLERS)
    for name in scenario:
        scenario_module(name)
    if jobs == 0:
        raise OptionError("--jobs 0: give at least 1, or -1 for every core")
    todo = comparison.cases(
        scenario,
        arm or [None],
        laws,
        {name: value for name, value in changes.items() if value is not None},
        _shared(laws, settings or []),
        flange,
    )
    with console.bar(quiet=as_json) as advance:
        rows = comparison.compare(
            todo, folder, jobs=jobs, progress=lambda done: advance("runs", done, len(todo))
        )
    if as_json:
        console.print_json([console.row_json(row) for row in rows])
    else:
        out.print(comparison.as_markdown(rows), markup=False, highlight=False, soft_wrap=True)
        out.print(f"wrote {folder}", highlight=False, soft_wrap=True)
    if any(row.failure for row in rows):
        raise typer.Exit(1)


app.command()(study_command.study)


@app.command()
def reproduce(
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for all files.")] = Path(
        "results"
    ),
    experiment: Annotated[str, typer.Option("--experiment", "-e", help="a or b.")] = "a",
    duration: Annotated[
        float | None, typer.Option(help="Only the first seconds of the helix, for a quick look.")
    ] = None,
    operators: study_command.Operators = 20,
    seed: study_command.Seed = 0,
    jobs: study_command.Jobs = 1,
    as_json: AsJson = False,
) -> None:
    """Run the paper's experiments: runs, figures, table beside the paper's, report.

    Experiment A: the tool tip of a Schunk LWA3 and of a Meka A2 draws a conical helix under the
    paper's controller, at T = 8 ms, which the paper's Table I implies, and at 1 ms; and, to end
    with, under hierarchical_qp at 1 ms. The folder's index.html shows it all, with a viewer an
    arm.

    Experiment B: simulated operators steer the endoscope of a Schunk LWA3 to four views, at 8 ms;
    --operators, --seed and --jobs are for it.
    """
    if experiment.lower() == "b":
        study_command.reproduce_b(folder, operators, seed, jobs, as_json)
        return
    if experiment.lower() != "a":
        raise UnknownName("experiment", experiment, ("a", "b"))
    from rcmqp.reproduce import reproduce_a

    with console.bar(quiet=as_json) as advance:
        found = reproduce_a(folder, duration=duration, progress=advance)
    if as_json:
        runs = [*found.runs, *found.rivals]
        console.print_json([console.run_json(each, compute_metrics(each)) for each in runs])
        return
    for table in (found.table, found.versus):
        out.print(table, markup=False, highlight=False, soft_wrap=True)
    for path in found.files:
        out.print(f"wrote {path}", highlight=False, soft_wrap=True)


@app.command()
def loopback(
    minutes: Annotated[float, typer.Option("--minutes", "-m", help="How long.")] = 0.2,
    arm: Annotated[str, typer.Option("--arm", "-a", help="Name (see rcmqp arms).")] = "panda",
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
) -> None:
    """Control a simulated arm in another process in real time, at 1 kHz, over UDP.

    For example,

      rcmqp loopback --minutes 10 --busy --priority

    Prints what the loop and the arm counted: deadlines missed, delays, and where every command
    went. Ends with exit code 1 where the loop stopped before its time.
    """
    from rcmqp.loopback import run_loopback

    options = _options(controller, settings or [])
    report = run_loopback(
        60.0 * minutes, arm=arm, controller=controller, busy=busy, priority=priority, **options
    )
    out.print(report.as_markdown(), markup=False, highlight=False, soft_wrap=True)
    if report.loop.stop.fault:
        raise typer.Exit(1)


register(app)
report_cli.register(app)


def _options(controller: str, settings: Sequence[str]) -> dict[str, Any]:
    """Controller options out of NAME=VALUE texts, of the type that their defaults have."""
    name = controller.replace("-", "_")
    if name not in CONTROLLERS:
        raise UnknownName("controller", name, CONTROLLERS)
    given = controller_options(name)  # an option without a default of its own is Python's
    defaults = {option: value for option, value in given.items() if value is not None}
    options: dict[str, Any] = {}
    for setting in settings:
        option, equals, text = setting.partition("=")
        if not equals:
            raise OptionError(f"--set {setting}: write NAME=VALUE, such as feed_forward=true")
        if option in given and option not in defaults:
            raise OptionError(f"--set {setting}: {option} of {name} can be given only from Python")
        if option not in defaults:
            raise UnknownName(f"option of {name}", option, defaults)
        options[option] = _value(option, text, type(defaults[option]))
    return options


def _shared(laws: Sequence[str], settings: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Options of each controller out of NAME=VALUE texts for all of them that know the name."""
    known = {law: controller_options(law) for law in laws}
    for setting in settings:
        name = setting.partition("=")[0]
        if not any(name in options for options in known.values()):
            raise UnknownName(
                f"option of {', '.join(laws)}", name, {x for each in known.values() for x in each}
            )
    return {
        law: _options(law, [text for text in settings if text.partition("=")[0] in options])
        for law, options in known.items()
    }


def _value(option: str, text: str, kind: type) -> Any:
    if kind is bool:
        if text.lower() not in ("true", "false"):
            raise OptionError(f"--set {option}={text}: it must be true or false")
        return text.lower() == "true"
    try:
        return kind(text)
    except ValueError as error:
        raise OptionError(f"--set {option}={text}: it must be a number") from error


def _show(file: Path, as_json: bool) -> None:
    """What is in a run's file."""
    with RunFile(file) as result:
        console.print_run(result, as_json, file)


def _draw(result: Run, folder: Path, stem: str) -> list[Path]:
    """Trajectory and errors of a run, as PNG and PDF."""
    from rcmqp import plots  # matplotlib takes long to import

    make_folder(folder)
    check_writable(folder / f"{stem}_errors.pdf")
    return [
        *plots.save_figure(plots.trajectory_figure([result]), folder / f"{stem}_trajectory"),
        *plots.save_figure(plots.error_figure([result]), folder / f"{stem}_errors"),
    ]


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value) or '""'


def _first_line(thing: object) -> str:
    return (inspect.getdoc(thing) or "").partition("\n")[0]
