"""rcmqp arms, scenarios and controllers: what there is."""

from __future__ import annotations

import inspect
from typing import Annotated, Any

import typer

from rcmqp.cli import console
from rcmqp.cli.console import out
from rcmqp.cli.options import AsJson, FlangeOption
from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.errors import UnknownName
from rcmqp.runs.loading import scenario_module, scenario_names
from rcmqp.world.loading import arm_names, load_arm


def arms(
    name: Annotated[str | None, typer.Argument(help="Only this arm, joint by joint.")] = None,
    flange: FlangeOption = None,
    as_json: AsJson = False,
) -> None:
    """List the arms with joints, reach, limits and licence; or one arm's joints.

    [NAME] may also be the path of an arm's file, my_robot.toml, or of a URDF, with --flange: then
    what was loaded is shown, and what was assumed.
    """
    chosen = [load_arm(each, flange) for each in ([name] if name else arm_names())]
    if as_json:
        console.print_json([console.arm_json(arm) for arm in chosen])
    elif name is None:
        console.print_arms(chosen)
    else:
        console.print_arm(chosen[0])


def scenarios(as_json: AsJson = False) -> None:
    """List the scenarios."""
    about = {name: _first_line(scenario_module(name)) for name in scenario_names()}
    if as_json:
        console.print_json(about)
        return
    console.print_table(("name", "what happens"), about.items())


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


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value) or '""'


def _first_line(thing: object) -> str:
    return (inspect.getdoc(thing) or "").partition("\n")[0]
