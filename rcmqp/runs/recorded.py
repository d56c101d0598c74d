"""Recordings of positions over time, from CSV files: a way of the tip, a motion of the trocar."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths.tip_trace import TipTrace
from rcmqp.runs.scenario import Scenario
from rcmqp.world.motions import Sampled

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
CLOCKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

COLUMN = re.compile(r"\s*(?P<frame>world )?\s*(?P<name>t|time|x|y|z)\s*(\[(?P<unit>[a-z]+)\])?\s*")
"""Head of a column that counts: ``t [ms]``, ``x [mm]``, ``world x [mm]``."""

HEAD = 't [s], x [m], y [m], z [m], or "world x [m]" and so on for the world\'s axes'

MOST = 1_000_000
"""Samples of a recording."""

FAR = 2.0
"""Way from the first position above which the unit is questioned [m]."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """What a recording says.

    Attributes:
        times: (n,) [s], from 0 on.
        positions: (n, 3) [m].
        world: whether they are in the world's axes, or else in the trocar's.
    """

    times: tuple[float, ...]
    positions: tuple[tuple[float, ...], ...]
    world: bool

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Recorded:
        """Out of a CSV file whose head names columns and units.

        The columns are ``t``, ``x``, ``y``, ``z``, in any order, with a unit in brackets: s, ms,
        us or ns; m, cm, mm or um. Without one it is s, and m. ``world x`` and so on are in the
        world's axes. Other columns, and lines that begin with #, are left out. Times count from
        the first one, whatever clock they are of.

        Raises:
            OptionError: the file cannot be read, or a column, unit or number is not allowed.
        """
        try:
            with open(path, encoding="utf-8-sig", newline="") as stream:
                lines = (line for line in stream if line.strip() and not line.startswith("#"))
                rows = list(itertools.islice(csv.reader(lines), MOST + 2))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise OptionError(f"{path} cannot be read: {error}") from error
        if not 2 < len(rows) < MOST + 2:
            raise OptionError(
                f"{path} has {max(len(rows) - 1, 0)} samples below its head; a recording has 2 to "
                f"{MOST}"
            )
        columns = _columns(str(path), rows[0])
        table = _numbers(str(path), rows[1:], columns)
        times = (table[:, 0] - table[0, 0]) * columns.clock
        if not (np.diff(times) > 0.0).all():
            k = int(np.argmin(np.diff(times) > 0.0)) + 1
            raise OptionError(
                f"{path}: sample {k + 1} is at {times[k]:.6g} s, the one before at "
                f"{times[k - 1]:.6g} s from the first; sort them, and drop those taken twice"
            )
        positions = table[:, 1:] * columns.unit
        far = float(np.abs(positions - positions[0]).max())
        if far > FAR:
            raise OptionError(
                f"{path} goes {far:.4g} m away from its first position; are these millimetres? "
                "Name the unit in the head: x [mm], y [mm], z [mm]"
            )
        return cls(tuple(times.tolist()), tuple(map(tuple, positions.tolist())), columns.world)


@dataclass(frozen=True, slots=True)
class _Columns:
    """Where t, x, y and z are, and in what units."""

    at: tuple[int, ...]
    clock: float
    unit: float
    world: bool


def _columns(path: str, head: Sequence[str]) -> _Columns:
    found = [COLUMN.fullmatch(name.lower()) for name in head]
    at: dict[str, int] = {}
    for i, each in enumerate(found):
        if each is not None:
            name = each["name"][0]
            if name in at:
                raise OptionError(f"{path} has two columns {name}; leave one of them in")
            at[name] = i
    if missing := [name for name in "txyz" if name not in at]:
        raise OptionError(
            f"{path} has no column {', '.join(missing)}, but {', '.join(head)[:200]}; its first "
            f"line must name them: {HEAD}"
        )
    t, *axes = (found[at[name]] for name in "txyz")
    assert t is not None
    clock, units = t["unit"] or "s", {each["unit"] or "m" for each in axes if each is not None}
    if clock not in CLOCKS or len(units) > 1 or not units <= UNITS.keys():
        raise OptionError(
            f"{path} has the units {', '.join([clock, *sorted(units)])}; a time's is one of "
            f"{', '.join(CLOCKS)}, and those of x, y and z are the same one of {', '.join(UNITS)}"
        )
    frames = {bool(each["frame"]) for each in axes if each is not None}
    if len(frames) > 1:
        raise OptionError(
            f"{path} has some of x, y, z in the world's axes; give all or none there"
        )
    places = tuple(at[name] for name in "txyz")
    return _Columns(places, CLOCKS[clock], UNITS[units.pop()], frames.pop())


def _numbers(path: str, rows: Sequence[Sequence[str]], columns: _Columns) -> Array:
    """The numbers (n, 4) of t, x, y and z."""
    table = np.empty((len(rows), 4))
    for k, row in enumerate(rows):
        try:
            table[k] = [float(row[i]) for i in columns.at]
        except (ValueError, IndexError) as error:
            said = ", ".join(row)[:100]
            raise OptionError(f"{path}: sample {k + 1}, {said!r}, is not four numbers") from error
    if not np.isfinite(table).all():
        k = int(np.argmin(np.isfinite(table).all(axis=1)))
        raise OptionError(f"{path}: sample {k + 1} has a number that is not finite; leave it out")
    return table


def along(scenario: Scenario, recording: Recorded) -> Scenario:
    """The scenario with its tip on the way of a recording, to the recording's end.

    Raises:
        RcmqpError: the arm cannot be loaded.
    """
    positions = np.array(recording.positions)
    if recording.world:
        positions = dq.rotate(dq.quaternion_conj(dq.P(scenario.insertion().x_rcm)), positions)
    path = TipTrace(recording.times, tuple(map(tuple, positions.tolist())))
    return dataclasses.replace(scenario, path=path, duration=path.duration)


def moved(scenario: Scenario, recording: Recorded) -> Scenario:
    """The scenario with its trocar moving as a recording says.

    Raises:
        OptionError: the recording is not in the world's axes.
    """
    if not recording.world:
        raise OptionError(
            "a trocar's motion is in the world's axes: name its columns world x, world y, world z"
        )
    return dataclasses.replace(scenario, motion=Sampled(recording.times, recording.positions))  # type: ignore[arg-type]
