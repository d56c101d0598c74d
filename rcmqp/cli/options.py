"""Options that several commands share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from rcmqp.errors import OptionError
from rcmqp.world.arm_limits import ArmLimits
from rcmqp.world.instrument import Vector3, vector3
from rcmqp.world.instrument_file import load_instrument
from rcmqp.world.port import Port

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
        "one for each; inf for none, in simulation only.",
    ),
]
JerkOption = Annotated[
    str | None,
    typer.Option(
        metavar="NUMBER[,NUMBER...]",
        help="Jerk limits in rad/s^3 in place of the arm's own: one for all joints, or one for "
        "each; inf for none, in simulation only.",
    ),
]
Trocar = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z",
        help="Where the incision is, in the world, in m; a start is searched, unless --tolerance "
        "is given.",
    ),
]
Axis = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z",
        help="With --trocar: direction into the patient; straight down without it, or with "
        "--tolerance the shaft's own.",
    ),
]
Depth = Annotated[
    float | None,
    typer.Option(metavar="M", help="How far inside the tip starts, in m; the scenario's."),
]
Cone = Annotated[
    float | None,
    typer.Option(metavar="DEG", help="How far the shaft may tilt from the axis; the scenario's."),
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        metavar="MM",
        help="With --trocar: the arm stays at its start, and the trocar may be measured up to "
        "this far off the shaft.",
    ),
]
InstrumentOption = Annotated[
    str | None,
    typer.Option(
        "--instrument",
        metavar="FILE",
        help="An instrument's .toml: mount, sizes, camera and wrist; or large_needle_driver; the "
        "scenario's, without it.",
    ),
]
RADIANS = math.pi / 2.0
"""An angle in degrees below this may be in radians."""

JOBS = typer.Option("--jobs", "-j", help="Processes; -1 for every core; 1 without it.")
Jobs = Annotated[int, JOBS]
Files = Annotated[list[Path], typer.Argument(metavar="RUN...", help="Runs' HDF5 files.")]


def instrument_of(file: str | None) -> dict[str, Any]:
    """The instrument of a file, as load_scenario() takes it."""
    return {} if file is None else {"instrument": load_instrument(file)}


def port_of(
    trocar: str | None,
    axis: str | None,
    depth: float | None,
    cone: float | None,
    tolerance: float | None,
) -> dict[str, Any]:
    """Make the port of load_scenario() from texts, degrees and mm; empty if none was given."""
    if all(each is None for each in (trocar, axis, depth, cone, tolerance)):
        return {}
    if cone is not None and not 0.0 < cone < 180.0:
        raise OptionError(f"--cone {cone:g}: give an angle between 0 and 180 degrees")
    if cone is not None and cone < RADIANS:
        raise OptionError(
            f"--cone {cone:g}: it is in degrees; are these radians? Then give "
            f"{math.degrees(cone):.3g}"
        )
    if depth is not None and not 0.0 < depth < 1.0:
        raise OptionError(f"--depth {depth:g}: it is in m; give one below 1, such as 0.1")
    port = Port(
        pivot=None if trocar is None else vector("trocar", trocar, 10.0),
        axis=None if axis is None else vector("axis", axis, math.inf),
        depth=depth,
        cone=None if cone is None else math.radians(cone),
        tolerance=None if tolerance is None else 1e-3 * tolerance,
    )
    return {"port": port}


def vector(name: str, text: str, most: float) -> Vector3:
    """Read three numbers; any above ``most`` is refused, as it is probably in mm."""
    try:
        values = vector3(name, [float(part) for part in text.split(",")])
    except (ValueError, OptionError) as error:
        raise OptionError(f"--{name} {text}: give three numbers, such as 0.4,0,0.1") from error
    if max(map(abs, values)) > most:
        raise OptionError(f"--{name} {text}: it is in m; are these millimetres?")
    return values


def limits_of(acceleration: str | None, jerk: str | None) -> ArmLimits:
    """Read the limits that were given."""
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
