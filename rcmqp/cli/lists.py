"""rcmqp arms, scenarios and controllers: list what is available."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable
from typing import Annotated, Any, TypeVar

import typer

from rcmqp.cli import console
from rcmqp.cli.console import out, print_tables, say
from rcmqp.cli.options import AsJson, FlangeOption
from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.errors import PluginError, UnknownName
from rcmqp.runs.loading import scenario_module, scenario_names
from rcmqp.runs.untrusted import one_line
from rcmqp.show.labels import spans
from rcmqp.show.table import Table
from rcmqp.world.arm import Arm
from rcmqp.world.ease import ease_at
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Instrument
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
        console.print_json([arm_json(arm) for arm in chosen])
    elif name is None:
        print_arms(chosen)
    else:
        print_arm(chosen[0])


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
        modules = [inspect.getmodule(CONTROLLERS[each]) for each in names]
        for each, module in zip(names, modules, strict=True):
            about = module if modules.count(module) == 1 else CONTROLLERS[each]
            options = ", ".join(
                f"{option}={_text(default)}"
                for option, default in controller_options(each).items()
            )
            rows.append((each, _first_line(about), options))
        out.print(Table(("name", "what it is", "options"), rows, words=3))
        out.print("rcmqp controllers NAME explains one.", style="dim")


def _usable(names: Iterable[str], load: Callable[[str], T]) -> dict[str, T]:
    """Load all names that can be loaded; print on stderr which plug-ins cannot."""
    loaded = {}
    for name in names:
        try:
            loaded[name] = load(name)
        except PluginError as error:
            console.err.print(f"left out: {error}", markup=False, highlight=False)
    return loaded


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value) or '""'


def _first_line(thing: object) -> str:
    return (inspect.getdoc(thing) or "").partition("\n")[0]


def print_arms(arms: Iterable[Arm]) -> None:
    """Print one line for each arm."""
    rows = [
        (
            arm.name,
            str(arm.nv),
            f"{arm.reach:.2f}",
            spans(arm, arm.upper - arm.lower),
            spans(arm, arm.velocity),
            spans(arm, arm.acceleration).replace("endless", "no limit"),
            spans(arm, arm.jerk).replace("endless", "no limit"),
            "both" if arm.assumed == {"acceleration", "jerk"} else ", ".join(sorted(arm.assumed)),
            arm.licence,
        )
        for arm in arms
    ]
    heads = "name joints reach travel speed acceleration jerk assumed licence".split()
    print_tables([Table(heads, rows, words=len(heads))])
    out.print(
        "In m, deg, deg/s, deg/s^2, deg/s^3; prismatic joints in m, m/s, m/s^2, m/s^3. Assumed: "
        "which of\nacceleration and jerk no source gives; a careful value stands in. rcmqp arms "
        "NAME lists one arm's joints.",
        style="dim",
    )


def print_arm(arm: Arm) -> None:
    """Print one line for each joint."""
    out.print(
        f"{arm.title}: reach {arm.reach:.3f} m, flange {arm.flange}, licence {arm.licence}",
        soft_wrap=True,
        highlight=False,
        markup=False,
    )
    heads = ("joint", "unit", "lower", "upper", "speed", "acceleration", "jerk", "home")
    rows = [
        (
            joint,
            arm.joint_units[i],
            *(f"{column[i]:.4f}" for column in (arm.lower, arm.upper)),
            *(
                _limit(getattr(arm, name)[i], bool(arm.is_assumed(name)[i]))
                for name in ("velocity", "acceleration", "jerk")
            ),
            f"{arm.home[i]:.4f}",
        )
        for i, joint in enumerate(arm.joints)
    ]
    print_tables([Table(heads, rows, words=len(heads))])
    note = "Positions in the joint's unit, speeds in unit/s, accelerations in unit/s^2, jerks in "
    note += "unit/s^3."
    if arm.assumed:
        note += f" Assumed, as no source gives it: {', '.join(sorted(arm.assumed))}."
    if arm.speed_near_limits is not None:
        note += " Near its position limits a joint may move only more slowly."
    out.print(note, style="dim", soft_wrap=True)
    if arm.source is not None and arm.name not in arm_names():
        ease = ease_at(Insertion.on_shaft(arm, Instrument()))
        for line in (*arm.source.notes, f"home: {ease}"):
            say(one_line(line))
        for topic, source in arm.source.sources.items():
            line = one_line(f"source of {topic}: {source}")
            out.print(line, style="dim", soft_wrap=True, highlight=False, markup=False)


def arm_json(arm: Arm) -> dict[str, Any]:
    """The JSON of one arm, for rcmqp arms --json."""
    arrays = ("lower", "upper", "velocity", "acceleration", "jerk", "home")
    return {
        "name": arm.name,
        "title": arm.title,
        "joints": list(arm.joints),
        "joint_units": list(arm.joint_units),
        "reach": arm.reach,
        **{name: getattr(arm, name).tolist() for name in arrays},
        "assumed": sorted(arm.assumed),
        "notes": [] if arm.source is None else list(arm.source.notes),
        "licence": arm.licence,
    }


def _limit(value: float, assumed: bool) -> str:
    """A limit of speed, acceleration or jerk, as text."""
    return "no limit" if math.isinf(value) else f"{value:.4f}{' assumed' if assumed else ''}"
