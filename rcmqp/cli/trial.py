"""rcmqp trial: experiment B with people."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rcmqp.cli.console import out, print_note
from rcmqp.cli.live import live_extra, opening
from rcmqp.controllers.settings import FILE_SETTING, controller_of, registered
from rcmqp.errors import OptionError
from rcmqp.files import check_readable
from rcmqp.runs.untrusted import MOST_TEXT

if TYPE_CHECKING:
    from rcmqp.experiments.study.plan import Law
    from rcmqp.experiments.trial.design import Design


def trial(
    scenario: Annotated[
        str | None, typer.Argument(help="camera_task, or a file like it; not needed later.")
    ] = None,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder of the study.")] = Path(
        "trial"
    ),
    identifier: Annotated[
        str | None,
        typer.Option("--id", help="Who comes, such as P07, no name; the next free one without."),
    ] = None,
    arm: Annotated[
        str | None,
        typer.Option(
            "--arm",
            "-a",
            help="Name, or the path of an arm's .toml; the scenario's own without it.",
        ),
    ] = None,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            "-c",
            help="NAME or FILE.py[:CLASS], and :OPTION=VALUE,OPTION=VALUE; may be repeated, each "
            "is a task; hierarchical_qp without it.",
        ),
    ] = None,
    period: Annotated[
        list[float] | None,
        typer.Option(
            help="T in s, of all controllers; or repeated, one for each -c in their order; 0.008 "
            "for dual_quaternion, 0.001 for others, without it."
        ),
    ] = None,
    task: Annotated[
        Path | None, typer.Option(help="TOML file of a task of your own; the paper's without it.")
    ] = None,
    consent: Annotated[
        Path | None, typer.Option(help="Text file that participants agree to.")
    ] = None,
    practice: Annotated[
        float | None, typer.Option(help="How long novices practise, in s; 120 without it.")
    ] = None,
    scale: Annotated[
        float | None, typer.Option(help="How far the tip moves, over the hand; 1 without it.")
    ] = None,
    viscosity: Annotated[
        float | None, typer.Option(help="Of the device, in N s/m; 15 without it.")
    ] = None,
    delete: Annotated[
        str | None, typer.Option(metavar="ID", help="Remove all files of a participant.")
    ] = None,
    port: Annotated[int, typer.Option(help="Port to listen at; any without it.")] = 0,
    no_open: Annotated[
        bool, typer.Option("--no-open", help="Do not open the page in a browser.")
    ] = False,
) -> None:
    """Lead a participant through experiment B in a browser: questions, practice, tasks.

    For example,

      rcmqp trial camera_task --arm panda --out study --consent consent.txt

      rcmqp trial -c my_law.py:MyLaw -c hierarchical_qp --period 0.002 --out study

      rcmqp trial --out study            the next participant

      rcmqp trial -c my_law.py --out study   the same, if a law is your own

      rcmqp trial --out study --id P03   a participant who broke off goes on

      rcmqp trial --out study --delete P03

      rcmqp study study                  tables of what was done

    The order of the controllers is counterbalanced. All files stay in the folder; the page is
    reached from this machine only. The exit code is 1 if the participant broke off.
    """
    from rcmqp.experiments.trial.people import Folder, checked_id

    kept = Folder(folder)
    if delete is not None:
        count = kept.delete(checked_id(delete))
        said = f"removed {count} files: those of {delete}, and tables of all, which rcmqp study"
        out.print(f"{said} makes again", highlight=False, soft_wrap=True)
        return
    numbers = {"practice": practice, "scale": scale, "viscosity": viscosity}
    given = {name: value for name, value in numbers.items() if value is not None}
    more = bool(given) or any(each is not None for each in (arm, period, task, consent))
    design = _going_on(folder, scenario, controller or [], more)
    if design is None:
        design = _design(scenario, arm, controller, period, task, consent, given)
        _check(design)
    with live_extra():
        from rcmqp.live.console import run_trial
    from rcmqp.files import make_folder

    design.keep(make_folder(folder))
    if len({law.period for law in design.laws}) > 1:
        print_note(
            f"the controllers differ in period: {'; '.join(map(str, design.laws))}. To compare "
            "laws alone, give one --period, in a new folder"
        )
    with kept.sitting(identifier) as who, opening() as show:

        def started(address: str) -> None:
            said = f"{address}\nparticipant {who}; Ctrl-C breaks off"
            out.print(said, markup=False, highlight=False, soft_wrap=True)
            if not no_open:
                show(address)

        why = run_trial(design, kept, who, port=port, started=started)
    if why:
        files = "".join(f" -c {file}" for file, _ in design.own_laws.values())
        program = f" {design.scenario}" if design.scenario.endswith(".py") else ""
        again = f"rcmqp trial{program}{files} --out {folder} --id {who} goes on from here"
        out.print(f"{why}; {again}", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1)
    out.print(f"{who} is done: {folder}", markup=False, highlight=False, soft_wrap=True)


def _going_on(
    folder: Path, scenario: str | None, controllers: list[str], more: bool
) -> Design | None:
    """The study that has begun in a folder; None if more is given than its Python files."""
    from rcmqp.experiments.trial.design import FILE, Design

    if (more or scenario or controllers) and not (folder / FILE).exists():
        return None
    kept = Design.load(folder)
    kept.check_files(controllers)
    program = scenario is None or (scenario.endswith(".py") and kept.scenario.endswith(".py"))
    if more or not program or not all(map(FILE_SETTING.fullmatch, controllers)):
        return None
    design = kept.with_files(scenario, controllers)
    design.check_unchanged()
    return design


def _design(
    scenario: str | None,
    arm: str | None,
    controllers: list[str] | None,
    periods: list[float] | None,
    task: Path | None,
    consent: Path | None,
    given: dict[str, Any],
) -> Design:
    """What the options ask for."""
    from rcmqp.experiments.trial.design import Design, scenario_sha256
    from rcmqp.experiments.trial.task import read_task, scenarios_task
    from rcmqp.runs.loading import load_scenario
    from rcmqp.world.loading import arm_names, names_its_flange, new_arm

    if arm and not names_its_flange(arm):
        raise OptionError(
            f"--arm {arm}: give a name, one of {', '.join(arm_names())}, or an arm's .toml, which "
            f"says which frame of a URDF carries the instrument; to write one: {new_arm(arm)}"
        )
    scenario = scenario or "camera_task"
    laws, own_laws = _laws(controllers or ["hierarchical_qp"], periods or [])
    if task is None:
        chosen = scenarios_task(load_scenario(scenario, arm))
    else:
        chosen = read_task(task)
    text = ""
    if consent is not None:
        check_readable(consent, "a text", MOST_TEXT)
        try:
            text = consent.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise OptionError(f"the text of consent {consent} cannot be read: {error}") from error
    sha256 = scenario_sha256(scenario, arm or "")
    given |= {"consent": text, "scenario_sha256": sha256, "own_laws": own_laws}
    return Design(scenario, arm or "", laws, chosen, **given)


def _laws(
    controllers: list[str], periods: list[float]
) -> tuple[tuple[Law, ...], dict[str, tuple[str, str]]]:
    """The controllers with their periods; and those of an own file, see Design.own_laws."""
    from rcmqp.experiments.study.plan import Law
    from rcmqp.experiments.trial.design import file_of, file_sha256

    if len(periods) not in (0, 1, len(controllers)):
        raise OptionError(
            f"--period is given {len(periods)} times for {len(controllers)} controllers; give it "
            "once for all, or once for each in their order"
        )
    each: list[float | None] = [*periods] or [None]
    each *= len(controllers) if len(each) == 1 else 1
    laws, own = [], {}
    for setting, period in zip(controllers, each, strict=True):
        name, options = controller_of(registered(setting))
        laws.append(Law(name, period, tuple(options.items())))
        if FILE_SETTING.fullmatch(setting):
            own[name] = (file_of(setting), file_sha256(setting))
    return tuple(laws), own


def _check(design: Design) -> None:
    """Make what every participant will need, so that a mistake is found before the first comes."""
    for law in design.laws:
        law.controller(design.made(law))
