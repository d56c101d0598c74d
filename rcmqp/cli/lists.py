"""rcmqp arms, scenarios and controllers: what there is."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from typing import Annotated, Any, TypeVar

import typer

from rcmqp.cli import console
from rcmqp.cli.console import out
from rcmqp.cli.options import AsJson, FlangeOption
from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.errors import PluginError, UnknownName
from rcmqp.runs.loading import scenario_module, scenario_names
from rcmqp.show.table import Table
from rcmqp.world.loading import arm_names, load_arm

T = TypeVar("T")


def arms(
    name: Annotated[str | None, typer.Argument(help="Only this arm, joint by joint.")] = None,
    flange: FlangeOption = None,
    as_json: AsJson = False,
) -> None:
    """List the arms with joints, reach, limits and licence; or one arm's joints.

    [NAME] may also be the path of an arm's file, my_robot.toml, or of a URDF, with --flange: then
    what was loaded is shown, and what was assumed.
    """
    if name is None:
        chosen = list(_usable(arm_names(), lambda each: load_arm(each, flange)).values())
    else:
        chosen = [load_arm(name, flange)]
    if as_json:
        console.print_json([console.arm_json(arm) for arm in chosen])
    elif name is None:
        console.print_arms(chosen)
    else:
        console.print_arm(chosen[0])


def scenarios(as_json: AsJson = False) -> None:
    """List the scenarios."""
    modules = _usable(scenario_names(), scenario_module)
    about = {name: _first_line(module) for name, module in modules.items()}
    if as_json:
        console.print_json(about)
        return
    out.print(Table(("name", "what happens"), list(about.items()), words=2))


def controllers(
    name: Annotated[str | None, typer.Argument(help="Only this one, explained.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the controllers with their options (for --set) and defaults; or explain one."""
    if name is None:
        names = list(_usable(CONTROLLERS, CONTROLLERS.__getitem__))
    else:
        names = [name.replace("-", "_")]
        if names[0] not in CONTROLLERS:
            raise UnknownName("controller", names[0], CONTROLLERS)
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
        out.print(Table(("name", "what it is", "options"), rows, words=3))
        out.print("rcmqp controllers NAME explains one.", style="dim")


def _usable(names: Iterable[str], load: Callable[[str], T]) -> dict[str, T]:
    """What can be loaded, by name; standard error says which plug-ins cannot be."""
    found = {}
    for name in names:
        try:
            found[name] = load(name)
        except PluginError as error:
            console.err.print(f"left out: {error}", markup=False, highlight=False)
    return found


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value) or '""'


def _first_line(thing: object) -> str:
    return (inspect.getdoc(thing) or "").partition("\n")[0]
