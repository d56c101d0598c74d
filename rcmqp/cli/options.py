"""What several commands ask for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rcmqp.errors import OptionError
from rcmqp.references.governor import Governor
from rcmqp.world.arm_limits import ArmLimits

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
PlannerOption = Annotated[
    str | None,
    typer.Option(
        "--planner-from",
        metavar="reference|measured",
        help="Where the path planner starts: at the last reference, or at the measured pose; the "
        "scenario's, without it.",
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


def scenario_changes(governor: bool | None, **changes: Any) -> dict[str, Any]:
    """The changes of a scenario that were asked for; None is none.

    Args:
        governor: whether there is to be one.
        changes: fields of Scenario.
    """
    given = {name: value for name, value in changes.items() if value is not None}
    return given if governor is None else given | {"governor": Governor() if governor else None}


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
