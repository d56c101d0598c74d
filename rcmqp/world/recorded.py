"""Recordings of positions, or poses, over time, from CSV files: of a hand, a tip, a trocar."""

from __future__ import annotations

import csv
import itertools
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcmqp.errors import OptionError
from rcmqp.files import check_readable
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.instrument import Vector3

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
CLOCKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

COLUMN = re.compile(r"\s*(?P<frame>world )?\s*(?P<name>t|time|x|y|z)\s*(\[(?P<unit>[a-z]+)\])?\s*")
"""Head of a column that counts: ``t [ms]``, ``x [mm]``, ``world x [mm]``."""

HEAD = 't [s], x [m], y [m], z [m], or "world x [m]" and so on for the world\'s axes'

QUATERNION = ("qw", "qx", "qy", "qz")
"""Columns of an orientation, in any order."""

NEAR_UNIT = 0.01
"""How far from 1 the norm of a quaternion may be."""

MOST = 1_000_000
"""Samples of a recording."""

FAR = 2.0
"""Way from the first position above which the unit is questioned [m]."""

LONG, SLOW = 60.0, 1e-3
"""Length [s] and largest speed [m/s] of a recording whose clock's unit is questioned."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recorded motion: times, positions and, if given, orientations.

    Attributes:
        times: (n,) [s], from 0 on.
        positions: (n, 3) [m].
        world: whether they are in the world's axes, or else in the trocar's or the device's.
        engaged: (n,) whether a handle drove the camera; empty if the file does not say.
        quaternions: (n, 4) unit quaternions, w first, of the tip's orientation, in the same axes;
            empty if the file has none.
    """

    times: tuple[float, ...]
    positions: tuple[Vector3, ...]
    world: bool = False
    engaged: tuple[bool, ...] = ()
    quaternions: tuple[tuple[float, ...], ...] = ()

    @classmethod
    def read(cls, path: str | os.PathLike[str], *, scale: float = 1.0) -> Recorded:
        """Read a CSV file whose head names columns and units.

        The columns are ``t`` (or ``time``), ``x``, ``y``, ``z``, in any order, with a unit in
        brackets: s, ms, us or ns; m, cm, mm or um. Without a unit, times are in s and positions in
        ``scale`` metres. ``world x`` and so on are in the world's axes. ``engaged`` (0 or 1) may
        stand beside them, and ``qw``, ``qx``, ``qy``, ``qz`` of an orientation; other columns, and
        lines that begin with #, are left out. Times count from the first one, so they may be of
        any clock. Quaternions a little off unit length are made so.

        Args:
            path: of the file.
            scale: metres in the file's unit of length, if the head does not name it.

        Raises:
            OptionError: the file cannot be read, or a column, unit or number is not allowed.
        """
        check_readable(path, "a CSV file")
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
        columns = _columns(str(path), rows[0], scale)
        table = _numbers(str(path), rows[1:], columns.at)
        times = (table[:, 0] - table[0, 0]) * columns.clock
        if not (np.diff(times) > 0.0).all():
            k = int(np.argmin(np.diff(times) > 0.0)) + 1
            raise OptionError(
                f"{path}: sample {k + 1} is at {times[k]:.6g} s, the one before at "
                f"{times[k - 1]:.6g} s from the first; sort them, and drop those taken twice"
            )
        positions = table[:, 1:4] * columns.unit
        if columns.clock == CLOCKS["s"]:
            _check_clock(str(path), times, positions)
        far = float(np.abs(positions - positions[0]).max())
        if far > FAR:
            raise OptionError(
                f"{path} goes {far:.4g} m away from its first position; are these millimetres? "
                "Name the unit in the head: x [mm], y [mm], z [mm]"
            )
        more = dict(zip(columns.more, table[:, 4:].T, strict=True))
        engaged = tuple(map(bool, more.get("engaged", ())))
        points = tuple((x, y, z) for x, y, z in positions.tolist())
        turned: Array = np.empty((0, 4))
        if "qw" in more:
            turned = _unit(str(path), np.column_stack([more[name] for name in QUATERNION]))
        orientations = tuple(map(tuple, turned.tolist()))
        return cls(tuple(times.tolist()), points, columns.world, engaged, orientations)


def _check_clock(path: str, times: Array, positions: Array) -> None:
    """Question a recording that takes long and hardly moves: its times may be milliseconds.

    Raises:
        OptionError: it is slower than anybody moves.
    """
    fastest = float((np.linalg.norm(np.diff(positions, axis=0), axis=1) / np.diff(times)).max())
    if times[-1] > LONG and 0.0 < fastest < SLOW:
        raise OptionError(
            f"{path} takes {times[-1]:.6g} s and never moves faster than {1e3 * fastest:.3g} "
            "mm/s; are its times milliseconds? Name the unit in the head: t [ms]"
        )


@dataclass(frozen=True, slots=True)
class _Columns:
    """Where t, x, y, z, and after them ``more``, stand; and the units."""

    at: tuple[int, ...]
    more: tuple[str, ...]
    clock: float
    unit: float
    world: bool


def _columns(path: str, head: Sequence[str], scale: float) -> _Columns:
    columns = [COLUMN.fullmatch(name.lower()) for name in head]
    at: dict[str, int] = {}
    for i, each in enumerate(columns):
        if each is not None:
            name = each["name"][0]
            if name in at:
                raise OptionError(f"{path} has two columns {name}; leave one of them in")
            at[name] = i
    if missing := [name for name in "txyz" if name not in at]:
        for sign, name in ((";", "semicolons"), ("\t", "tabs")):
            if sign in "".join(head):
                raise OptionError(
                    f"{path}: its columns are separated by {name}; separate them by commas, and "
                    "write numbers with a point: 0.5"
                )
        raise OptionError(
            f"{path} has no column {', '.join(missing)}, but {', '.join(head)[:200]}; its first "
            f"line must name them: {HEAD}"
        )
    t, *axes = (columns[at[name]] for name in "txyz")
    assert t is not None
    clock, units = t["unit"] or "s", {each["unit"] or "" for each in axes if each is not None}
    if clock not in CLOCKS or len(units) > 1 or not units <= {*UNITS, ""}:
        named = ", ".join(filter(None, [clock, *sorted(units)]))
        raise OptionError(
            f"{path} has the units {named}; a time's is one of "
            f"{', '.join(CLOCKS)}, and those of x, y and z are the same one of {', '.join(UNITS)}"
        )
    frames = {bool(each["frame"]) for each in axes if each is not None}
    if len(frames) > 1:
        raise OptionError(
            f"{path} has some of x, y, z in the world's axes; give all or none there"
        )
    names = [name.strip().lower() for name in head]
    more = tuple(name for name in ("engaged", *QUATERNION) if name in names)
    if len({*more, "engaged"}) not in (1, 5) or "q0" in names or "q1" in names:
        raise OptionError(
            f"{path} has the columns {', '.join(name for name in names if name[:1] == 'q')} of an "
            f"orientation; they must be {', '.join(QUATERNION)}, in any order, qw the real part"
        )
    places = (*(at[name] for name in "txyz"), *map(names.index, more))
    unit = {**UNITS, "": scale}[units.pop()]
    return _Columns(places, more, CLOCKS[clock], unit, frames.pop())


def _unit(path: str, quaternions: Array) -> Array:
    """Quaternions (n, 4) of length 1."""
    norms = np.linalg.norm(quaternions, axis=1)
    wrong = np.flatnonzero(np.abs(norms - 1.0) > NEAR_UNIT)
    if wrong.size:
        raise OptionError(
            f"{path}: the quaternion of sample {wrong[0] + 1} has the norm {norms[wrong[0]]:.4g}, "
            f"it must be 1; check that its columns are {', '.join(QUATERNION)}"
        )
    return np.asarray(quaternions / norms[:, None])


def _numbers(path: str, rows: Sequence[Sequence[str]], at: Sequence[int]) -> Array:
    """The numbers (n, len(at)) of some columns."""
    table = np.empty((len(rows), len(at)))
    for k, row in enumerate(rows):
        try:
            table[k] = [float(row[i]) for i in at]
        except (ValueError, IndexError) as error:
            cells = ", ".join(row)[:100]
            raise OptionError(
                f"{path}: sample {k + 1}, {cells!r}, is not {len(at)} numbers"
            ) from error
    if not np.isfinite(table).all():
        k = int(np.argmin(np.isfinite(table).all(axis=1)))
        raise OptionError(f"{path}: sample {k + 1} has a number that is not finite; leave it out")
    return table
