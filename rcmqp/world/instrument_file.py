"""An instrument's file: what it may say, and reading it."""

from __future__ import annotations

import dataclasses
import importlib.resources
import os
import tomllib
from pathlib import Path
from typing import Any

from rcmqp.errors import OptionError, RcmqpError, UnknownName
from rcmqp.files import absent, why
from rcmqp.world.instrument import Camera, Instrument, Mount, Wrist, WristJoint
from rcmqp.world.wrist import wrist_of_urdf

PARTS: dict[str, type] = {"camera": Camera, "mount": Mount, "wrist": Wrist}
"""Tables of the file, and what each is made into."""

INSTRUMENTS = ("large_needle_driver",)
"""Names of the instruments that rcmqp has."""

IN_URDF = ("urdf", "shaft", "tip")
"""Keys of [wrist] where a URDF has it."""

SOURCES = "sources"
"""A table that only says where the numbers come from."""

MOST_FILE = 100_000
"""Bytes."""


def load_instrument(path: str | os.PathLike[str]) -> Instrument:
    """Read an instrument's file, which is TOML, or one of INSTRUMENTS by its name.

    For example,

        length = 0.31
        radius = 0.005

        [mount]
        xyz = [0.0, 0.05, 0.03]
        rpy = [0.0, 0.7854, 0.0]

        [camera]
        angle = 0.5236

    Its keys are the attributes of Instrument, its tables [mount], [camera] and [wrist] those of
    Mount, Camera and Wrist, and each [[wrist.joints]] those of a WristJoint: lengths in m, angles
    in rad. What is left out is as Instrument has it. [sources] may
    say where the numbers come from. A wrist may be in a URDF, the robot's or the instrument's own:

        [wrist]
        urdf = "my_robot.urdf"
        shaft = "instrument_base"
        tip = "tool_tip"

    are the file, from this one's folder, and two of its links; see wrist_of_urdf(). The length of
    the shaft is there, too.

    Raises:
        OptionError: the file is missing, is not TOML, or a value is not allowed.
        UnknownName: a key is not known.
        ArmError: the URDF, or the wrist in it, cannot be used.
        FrameNotFound: the URDF has no such link.
    """
    own = importlib.resources.files("rcmqp.world") / "instruments" / f"{path}.toml"
    path = Path(str(own) if path in INSTRUMENTS else path)
    try:
        if not path.is_file():
            raise OptionError(
                f"{path}: {absent(path)}; give the path of an instrument's .toml, or one of "
                f"{', '.join(INSTRUMENTS)}"
            )
        if (size := path.stat().st_size) > MOST_FILE:
            raise OptionError(f"{path} has {size} bytes, an instrument's file {MOST_FILE} at most")
        entry = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OptionError(f"cannot read the instrument {path}: {why(error)}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise OptionError(f"{path} is not TOML: {error}") from error
    entry.pop(SOURCES, None)
    _check_keys(path, "", Instrument, entry)
    for table, kind in PARTS.items():
        if table in entry:
            if not isinstance(entry[table], dict):
                raise OptionError(
                    f"{path}: {table} = {entry[table]!r:.50}, it must be a table: [{table}]"
                )
            if "urdf" not in entry[table] or table != "wrist":
                _check_keys(path, f" [{table}]", kind, entry[table])
    if "wrist" in entry and "urdf" not in entry["wrist"]:
        _check_joints(path, entry["wrist"].get("joints"))
    try:
        if "urdf" in entry.get("wrist", {}):
            _read_wrist(path, entry)
        return Instrument(**entry)
    except RcmqpError as error:
        raise error.of(path)  # noqa: B904  (it is the same one)


def _read_wrist(path: Path, entry: dict[str, Any]) -> None:
    """Put the wrist of a URDF into an entry, and the length of the shaft before it."""
    table = entry["wrist"]
    if sorted(table) != sorted(IN_URDF) or not all(isinstance(x, str) for x in table.values()):
        raise OptionError(
            f"{path}: [wrist] with a urdf has {', '.join(IN_URDF)}, each a text, and nothing else"
        )
    if "length" in entry:
        raise OptionError(f"{path}: the URDF of [wrist] says how long the shaft is; no length")
    offset = Instrument(mount_offset=entry.get("mount_offset", 0.0)).mount_offset
    end, entry["wrist"] = wrist_of_urdf(path.parent / table["urdf"], table["shaft"], table["tip"])
    entry["length"] = end - offset


def _check_joints(path: Path, joints: Any) -> None:
    """Check that a wrist has joints, and that each has what it must have."""
    if not isinstance(joints, list) or not joints or not all(isinstance(x, dict) for x in joints):
        raise OptionError(f"{path}: a wrist needs a table [[wrist.joints]] for each of its joints")
    needed = [x.name for x in dataclasses.fields(WristJoint) if x.default is dataclasses.MISSING]
    for i, joint in enumerate(joints, 1):
        _check_keys(path, " [[wrist.joints]]", WristJoint, joint)
        if missing := [name for name in needed if name not in joint]:
            raise OptionError(
                f"{path}: joint {i} of [[wrist.joints]] has no {missing[0]}; it needs "
                f"{', '.join(needed)}"
            )


def _check_keys(path: Path, table: str, kind: type, entry: dict[str, Any]) -> None:
    """Check that every key is an attribute."""
    known = [field.name for field in dataclasses.fields(kind)]
    for key in entry:
        if key not in known:
            raise UnknownName(f"key in {path}{table}", key, known)
