"""rcmqp calibrate: trocar and tool, from recorded poses."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import numpy as np
import pinocchio as pin
import typer

from rcmqp.cli import console
from rcmqp.cli.console import err, out
from rcmqp.cli.options import AsJson, FlangeOption
from rcmqp.errors import OptionError, UnknownName
from rcmqp.files import check_readable
from rcmqp.world.calibration import Calibration, calibrate_tool, calibrate_trocar, weakness
from rcmqp.world.loading import load_arm

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Columns of a pose: position [m], and a unit quaternion."""

KINDS = ("trocar", "tool")

UNIT = 1e-3
"""How far the norm of a recorded quaternion may be from 1."""

MOST_LENGTH = 20.0
"""A position beyond this is not taken for m."""


def calibrate(
    poses: Annotated[Path, typer.Argument(help="CSV file, a pose a line, with a header.")],
    what: Annotated[
        str, typer.Option("--what", "-w", help="trocar or tool: what the motion was about.")
    ] = "trocar",
    arm: Annotated[
        str | None,
        typer.Option("--arm", "-a", help="With joint angles: name, or path of a .toml or URDF."),
    ] = None,
    flange: FlangeOption = None,
    as_json: AsJson = False,
) -> None:
    """Find the trocar, or the tool's tip, from poses of the flange that were recorded.

    For example,

      rcmqp calibrate pivoting.csv --arm my_robot.toml

      rcmqp calibrate tip_on_a_cone.csv --what tool

    For the trocar, move the instrument in it: tilt it about two axes, to any depth. The shaft is
    the flange's z axis. For the tool, hold its tip on one point and tilt the arm about it.

    The columns are x, y, z in m and qw, qx, qy, qz of the flange in the world; or, with --arm, the
    joints' names, in rad and m, in any order. Other columns are passed over.
    """
    if what not in KINDS:
        raise UnknownName("calibration", what, KINDS)
    rows = _rows(poses)
    oMf = _of_poses(poses, rows) if arm is None else _of_joints(poses, rows, arm, flange)
    found = (calibrate_trocar if what == "trocar" else calibrate_tool)(oMf)
    if as_json:
        console.print_json(_json(found))
    else:
        for line in _lines(found):
            out.print(line, markup=False, highlight=False, soft_wrap=True)
    if remark := weakness(found):
        err.print(f"[yellow]warning:[/] {remark}", highlight=False, soft_wrap=True)


def _lines(found: Calibration) -> list[str]:
    """What was found, for people."""
    deviations = 1e3 * np.sqrt(np.diag(found.covariance))
    lines = [
        f"pivot        {_numbers(found.pivot)} m in the world",
        f"uncertainty  {_numbers(deviations, '.3f')} mm, one standard deviation",
        f"residual     {1e3 * found.residual_rms:.3f} mm rms, "
        f"{1e3 * float(found.residuals.max()):.3f} mm max, of {len(found.residuals)} poses",
    ]
    if found.tip is None:
        pivot = ",".join(f"{round(float(x), 5) + 0.0:.5f}" for x in found.pivot)
        tolerance = max(1.0, math.ceil(3e3 * (found.uncertainty + found.residual_rms)))
        return [*lines, f"to use it    --trocar={pivot} --tolerance={tolerance:g}"]
    aside = 1e3 * math.hypot(found.tip[0], found.tip[1])
    return [
        *lines,
        f"tip          {_numbers(found.tip)} m in the flange's frame, {aside:.2f} mm off its z "
        "axis",
    ]


def _json(found: Calibration) -> dict[str, object]:
    return {
        "pivot": found.pivot.tolist(),
        "covariance": found.covariance.tolist(),
        "tip": None if found.tip is None else found.tip.tolist(),
        "tip_covariance": None if found.tip_covariance is None else found.tip_covariance.tolist(),
        "residual_rms": found.residual_rms,
        "residual_max": float(found.residuals.max()),
        "poses": len(found.residuals),
        "warning": weakness(found),
    }


def _numbers(values: Iterable[float], style: str = ".5f") -> str:
    return ", ".join(format(float(x), style) for x in values)


def _rows(file: Path) -> list[dict[str, str]]:
    """The lines of a CSV file by the names of its columns."""
    check_readable(file, "a CSV file")
    try:
        with file.open(encoding="utf-8-sig", newline="") as text:
            reader = csv.DictReader(text, skipinitialspace=True)
            return [{key: value for key, value in row.items() if key} for row in reader]
    except OSError as error:
        raise OptionError(f"{file} cannot be read as CSV: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise OptionError(
            f"{file} is not a CSV file of recorded poses; give one with a column for each joint, "
            "or with x, y, z, qw, qx, qy, qz of the flange"
        ) from error


def _of_poses(file: Path, rows: list[dict[str, str]]) -> list[pin.SE3]:
    """Placements of the flange, of positions and quaternions."""
    found = []
    for line, values in enumerate(_columns(file, rows, POSE), 2):
        x, y, z, *wxyz = values
        length = math.sqrt(sum(each**2 for each in wxyz))
        if abs(length - 1.0) > UNIT:
            raise OptionError(
                f"{file}, line {line}: the quaternion has the norm {length:.5g}, it must be 1; "
                "check that its columns are qw, qx, qy, qz"
            )
        if max(abs(x), abs(y), abs(z)) > MOST_LENGTH:
            raise OptionError(
                f"{file}, line {line}: ({x:g}, {y:g}, {z:g}) is in m; are these millimetres?"
            )
        quaternion = pin.Quaternion(*(each / length for each in wxyz))
        found.append(pin.SE3(quaternion.matrix(), np.array([x, y, z])))
    return found


def _of_joints(
    file: Path, rows: list[dict[str, str]], arm: str, flange: str | None
) -> list[pin.SE3]:
    """Placements of the flange, of joint angles by name."""
    loaded = load_arm(arm, flange).with_effector(pin.SE3.Identity())
    placements = []
    for values in _columns(file, rows, loaded.joints):
        placements.append(loaded.state(loaded.configuration(values)).oMe)
    return placements


def _columns(file: Path, rows: list[dict[str, str]], names: tuple[str, ...]) -> list[list[float]]:
    """The named columns of every line as finite numbers."""
    there = list(rows[0]) if rows else []
    if missing := [name for name in names if name not in there]:
        hint = "" if names != POSE else "; or, with --arm, the joints' names"
        raise OptionError(
            f"{file} has no column {', '.join(missing)}, its header has {', '.join(there)}; "
            f"needed are {', '.join(names)}{hint}"
        )
    found = []
    for line, row in enumerate(rows, 2):
        try:
            values = [float(row[name]) for name in names]
        except (TypeError, ValueError) as error:
            raise OptionError(f"{file}, line {line}: {error}") from error
        if not all(map(math.isfinite, values)):
            raise OptionError(f"{file}, line {line}: not all of {', '.join(names)} are finite")
        found.append(values)
    return found
