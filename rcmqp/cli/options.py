"""What several commands ask for, and a controller's options out of NAME=VALUE."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from rcmqp.arm_limits import ArmLimits
from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.errors import OptionError, UnknownName
from rcmqp.governor import Governor

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
FlangeOption = Annotated[
    str | None, typer.Option(help="With a URDF: the frame that carries the instrument.")
]
GovernorOption = Annotated[
    bool | None,
    typer.Option(
        "--governor/--no-governor",
        help="Slow the path down where the tip falls behind, or not; the scenario's, without it.",
    ),
]
AccelerationOption = Annotated[
    str | None,
    typer.Option(
        metavar="NUMBER[,NUMBER...]",
        help="Acceleration limits in rad/s^2 in place of the arm's own: one for all joints, or "
        "one for each; inf for none.",
    ),
]
JerkOption = Annotated[
    str | None,
    typer.Option(
        metavar="NUMBER[,NUMBER...]",
        help="Jerk limits in rad/s^3 in place of the arm's own: one for all joints, or one for "
        "each; inf for none.",
    ),
]
JOBS = typer.Option("--jobs", "-j", help="Processes; -1 for every core; 1 without it.")
Jobs = Annotated[int, JOBS]
Files = Annotated[list[Path], typer.Argument(metavar="RUN...", help="Runs' HDF5 files.")]


def governor_change(governor: bool | None) -> dict[str, Any]:
    """The change of a scenario that --governor or --no-governor asks for."""
    return {} if governor is None else {"governor": Governor() if governor else None}


def options_of(controller: str, settings: Sequence[str]) -> dict[str, Any]:
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
        if option in options:
            raise OptionError(f"--set {setting}: {option} is given twice")
        options[option] = _value(option, text, type(defaults[option]))
    return options


def shared_options(laws: Sequence[str], settings: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Options of each controller out of NAME=VALUE texts for all of them that know the name."""
    known = {law: controller_options(law) for law in laws}
    for setting in settings:
        name = setting.partition("=")[0]
        if not any(name in options for options in known.values()):
            raise UnknownName(
                f"option of {', '.join(laws)}", name, {x for each in known.values() for x in each}
            )
    return {
        law: options_of(law, [text for text in settings if text.partition("=")[0] in options])
        for law, options in known.items()
    }


def limits_of(acceleration: str | None, jerk: str | None) -> ArmLimits:
    """The limits that were given, out of their texts."""
    return ArmLimits(acceleration=_limit("acceleration", acceleration), jerk=_limit("jerk", jerk))


def _limit(name: str, text: str | None) -> float | tuple[float, ...] | None:
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise OptionError(
            f"--{name} {text}: give a number, such as 8, or one for each joint: 8,8,8,10,10,10"
        ) from error
    return values[0] if len(values) == 1 else values


def _value(option: str, text: str, kind: type) -> Any:
    if kind is bool:
        if text.lower() not in ("true", "false"):
            raise OptionError(f"--set {option}={text}: it must be true or false")
        return text.lower() == "true"
    try:
        return kind(text)
    except ValueError as error:
        raise OptionError(f"--set {option}={text}: it must be a number") from error
