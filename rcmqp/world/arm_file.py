"""The file that describes an arm: robots/<name>/robot.toml, or one of the user's own."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from rcmqp.errors import ArmError, UnknownName
from rcmqp.files import absent
from rcmqp.world.arm import find_frame
from rcmqp.world.urdf import RAIL_JOINT, Urdf, model_of

MOST_FILE = 1_000_000
"""Bytes of an arm's file."""

FAR = {"flange": 2.0, "base": 30.0}
"""How far a placement may be [m]: what is farther is in millimetres."""

LONG_RAIL = 10.0
"""How far a rail may go [m]."""

LIMITS = ("position", "velocity", "acceleration", "jerk")

KEYS = {
    "": (
        "title",
        "licence",
        "like",
        "urdf",
        "packages",
        "home",
        *LIMITS,
        "speed_near_limits",
        "srs_offsets",
        "flange",
        "base",
        "rail",
        "locked",
        "sources",
    ),
    "flange": ("frame", "xyz", "rpy"),
    "base": ("xyz", "rpy"),
    "rail": ("axis", "lower", "upper", "velocity"),
}
"""What an arm's file may say, and what its tables may."""

TABLES = ("flange", "base", "rail", "locked", "sources")

_EXAMPLE_ROBOT_DATA = "example-robot-data"


@dataclass(frozen=True, slots=True, eq=False)
class ArmFile:
    """What an arm's file says; see docs/own-arm.md.

    Attributes:
        path: the file.
        entry: its keys.
        urdf: the URDF that it names.
        packages: folders in which the meshes of package:// are looked for.
        like: what the file of the registered arm says that it is like; empty without one.
    """

    path: Path
    entry: Mapping[str, Any]
    urdf: Path
    packages: tuple[Path, ...]
    like: Mapping[str, Any]

    def placement(self, table: str) -> pin.SE3:
        """Of [flange] in its frame, or of [base] in the world: xyz [m] and rpy [rad]."""
        given = self.entry.get(table, {})
        xyz, rpy = (self._vector(table, key, given.get(key, [0.0] * 3)) for key in ("xyz", "rpy"))
        return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)

    def rail(self) -> dict[str, str] | None:
        """The rail that the base stands on, as attributes of a URDF's joint; None without one."""
        given = self.entry.get("rail")
        if given is None:
            return None
        if missing := [key for key in KEYS["rail"] if key not in given]:
            raise ArmError(
                f"{self.path}: [rail] has no {missing[0]}; it needs all of its keys: "
                f"{', '.join(KEYS['rail'])}"
            )
        axis = self._vector("rail", "axis", given["axis"])
        texts = {key: self._number(f"rail.{key}", given[key]) for key in KEYS["rail"][1:]}
        if (stroke := given["upper"] - given["lower"]) > LONG_RAIL:
            raise ArmError(
                f"{self.path}: the rail goes over {stroke:g} m, more than {LONG_RAIL:g} m; are "
                "these millimetres? An arm's file has metres: multiply by 0.001"
            )
        return {"axis": " ".join(map(repr, axis.tolist())), **texts}

    def _vector(self, table: str, key: str, values: Any) -> Any:
        good = isinstance(values, Sequence) and len(values) == 3 and all(map(_is_number, values))
        if not good:
            raise ArmError(
                f"{self.path}: {table}.{key} = {values!r:.80}, it must be three numbers, such as "
                "[0.0, 0.0, 1.5]; lengths in m, angles in rad"
            )
        if key == "rpy" and max(map(abs, values)) > 2.0 * math.pi:
            raise ArmError(
                f"{self.path}: {table}.rpy = {values!r} rad, more than a full turn; are these "
                "degrees? An arm's file has radians: multiply by 0.0174533"
            )
        if key == "xyz" and math.hypot(*values) > FAR[table]:
            raise ArmError(
                f"{self.path}: {table}.xyz = {values!r} m, farther than {FAR[table]:g} m; "
                "are these millimetres? An arm's file has metres: multiply by 0.001"
            )
        return np.array(values, dtype=float)

    def _number(self, what: str, value: Any) -> str:
        if not _is_number(value):
            raise ArmError(f"{self.path}: {what} = {value!r:.80}, it must be a number")
        return repr(float(value))


def read_arm_file(path: Path, robots: Path) -> ArmFile:
    """Read an arm's file; with ``like``, keys that it leaves out come from a registered arm.

    Args:
        path: the file.
        robots: the folder of the registered arms.

    Raises:
        ArmError: it is missing, is not TOML, or says something that is not allowed.
        UnknownName: a key, or the arm in ``like``, is not known.
    """
    entry = _toml(path)
    folder, like = path.parent, {}
    if "like" in entry:
        names = sorted(each.name for each in robots.iterdir() if (each / "robot.toml").is_file())
        if entry["like"] not in names:
            raise UnknownName("arm for like", f"{entry['like']}", names)
        if "urdf" in entry:
            raise ArmError(f"{path}: has both urdf and like; give one of them")
        folder = robots / entry["like"]
        like = _toml(folder / "robot.toml")
        entry = _merged(like, entry)
    if not isinstance(entry.get("urdf"), str):
        raise ArmError(
            f'{path}: has no urdf; add urdf = "my_robot.urdf", its path from this file, or '
            'like = "ur5", a registered arm that differs only in what the file says'
        )
    if not isinstance(entry.get("flange", {}).get("frame"), str):
        raise ArmError(
            f"{path}: has no [flange] with a frame; add the name of the URDF's link that carries "
            'the instrument: frame = "tool0"'
        )
    packages = entry.get("packages", [])
    if not isinstance(packages, list) or not all(isinstance(each, str) for each in packages):
        raise ArmError(f"{path}: packages = {packages!r:.80}, it must be a list of folders")
    found = tuple((path.parent / each).resolve() for each in packages)
    if missing := [each for each in found if not each.is_dir()]:
        raise ArmError(f"{path}: there is no folder {missing[0]}, which packages names")
    return ArmFile(path, entry, _resolve(folder, entry["urdf"], path), found, like)


def _toml(path: Path) -> dict[str, Any]:
    """An arm's file as a dictionary whose keys and tables are known."""
    try:
        if not path.is_file():
            raise ArmError(f"{path}: {absent(path)}; give the path of an arm's .toml")
        if (size := path.stat().st_size) > MOST_FILE:
            raise ArmError(f"{path} has {size} bytes, an arm's file {MOST_FILE} at most")
        entry = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError, RecursionError) as error:
        raise ArmError(f"{path} is not TOML: {error}") from error
    for table in TABLES:
        if not isinstance(entry.get(table, {}), dict):
            raise ArmError(
                f"{path}: {table} = {entry[table]!r:.80}, it must be a table: [{table}]"
            )
    for table, known in KEYS.items():
        for key in entry.get(table, {}) if table else entry:
            if key not in known:
                raise UnknownName(f"key in {path}{f' [{table}]' if table else ''}", key, known)
    return entry


def _merged(own: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """A registered arm's entry with what is given in its place; tables key by key."""
    entry = dict(own) | dict(given)
    for table in ("flange", "locked", "sources"):
        entry[table] = own.get(table, {}) | given.get(table, {})
    return entry


def _resolve(folder: Path, urdf: str, file: Path) -> Path:
    """Path of a URDF that a file names: beside it, or inside the example-robot-data wheel."""
    package, colon, inside = urdf.partition(":")
    if not colon or package != _EXAMPLE_ROBOT_DATA:
        return folder / urdf
    try:
        root = importlib.metadata.distribution(package).locate_file("")
    except importlib.metadata.PackageNotFoundError as error:
        raise ArmError(f"{file} needs the models of {package}: pip install {package}") from error
    return Path(str(root)) / "cmeel.prefix/share" / _EXAMPLE_ROBOT_DATA / "robots" / inside


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


OF_ALL_JOINTS = ("speed_near_limits", "srs_offsets")
"""Keys that mean nothing for an arm with other joints."""


SAME_AXIS = 0.01
"""Angle up to which two z axes count as the same [rad]."""


def entry_of(file: ArmFile, urdf: Urdf) -> dict[str, Any]:
    """What the file says; values that the registered arm has joint by joint are by joint name.

    A joint that the file locks has none, a rail is at the middle of its travel at home, and its
    limits of acceleration and jerk are assumed. Where the base or the mount is tilted, the shaft
    would point elsewhere at the registered arm's home: it is searched.

    Args:
        file: the arm's file.
        urdf: that it names.
    """
    entry = dict(file.entry)
    inherits = "home" in file.like and entry["home"] is file.like["home"]
    if inherits and (_tilted(file, "base") or _tilted(file, "flange")):
        del entry["home"]
    locked = entry.get("locked", {})
    if not file.like or (set(locked) == set(file.like.get("locked", {})) and "rail" not in entry):
        return entry
    joints = _joints(urdf, file.like)
    for key in ("home", *LIMITS):
        values = entry.get(key)
        if values is file.like.get(key) and isinstance(values, list):
            named = zip(joints, values, strict=True)
            entry[key] = {joint: value for joint, value in named if joint not in locked}
            if key == "home" and "rail" in entry:
                rail = entry["rail"]
                entry[key][RAIL_JOINT] = (rail["lower"] + rail["upper"]) / 2.0
    for key in OF_ALL_JOINTS:
        if entry.get(key) is file.like.get(key):
            entry.pop(key, None)
    return entry


def _tilted(file: ArmFile, table: str) -> bool:
    """Whether a placement in the file has another z axis than that of the registered arm."""
    like = dataclasses.replace(file, entry=file.like)
    turn = like.placement(table).rotation.T @ file.placement(table).rotation
    return bool(turn[2, 2] < np.cos(SAME_AXIS))


def _joints(urdf: Urdf, like: Any) -> list[str]:
    """Joints of a registered arm, from the base to its flange."""
    model: pin.Model = model_of(urdf)
    joint = find_frame(model, like["flange"]["frame"]).parentJoint
    names = [model.names[i] for i in list(model.supports[joint])[1:]]
    return [name for name in names if name not in like.get("locked", {})]
