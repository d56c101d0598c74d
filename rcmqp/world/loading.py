"""Arms by name out of the robots folder, or from any URDF of a fixed-base serial arm."""

from __future__ import annotations

import importlib.metadata
import importlib.resources
import math
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rcmqp.errors import ArmError, PluginError, UnknownName
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm, find_frame
from rcmqp.world.arm_limits import Given, GivenPosition, SpeedNearLimits
from rcmqp.world.plugins import distribution, load, points
from rcmqp.world.urdf import limits_of, mimics_of, model_of

MOST_URDF = 64_000_000
"""Bytes of a URDF."""

_EXAMPLE_ROBOT_DATA = "example-robot-data"

GROUP = "rcmqp.arms"
"""Of the entry points whose packages are arms."""


def arm_names() -> list[str]:
    """Names of the arms that load_arm() knows, sorted; those of plug-ins are among them."""
    return sorted(_own_names() | points(GROUP).keys())


def arm_title(name: str) -> str:
    """What people call the arm: the title in its robot.toml, or a URDF's file name."""
    folder = _folder(name)
    return Path(name).stem if folder is None else str(_entry(folder)["title"])


def load_arm(
    name: str | os.PathLike[str],
    flange: str | None = None,
    *,
    home: ArrayLike | None = None,
    locked: Mapping[str, float] | None = None,
    position: GivenPosition | None = None,
    velocity: Given | None = None,
    acceleration: Given | None = None,
    jerk: Given | None = None,
    speed_near_limits: SpeedNearLimits | None = None,
) -> Arm:
    """Load an arm by name, or from a URDF.

    Joints that do not move the flange (grippers, other arms) are held where they are.

    Limits that are given take the place of the arm's own: one number for all joints, one for each
    (None keeps the joint's own), or numbers by joint name. The arm's own are those of the URDF and
    of robot.toml. URDF 1.2 has acceleration, deceleration and jerk in <limit>; of the first two
    the smaller counts, for speeding up and for slowing down. An acceleration or jerk limit that
    is nowhere is assumed, see Limited and ``arm.assumed``; math.inf says that there is none.

    Args:
        name: a name out of arm_names(), or the path of a URDF (it ends in .urdf).
        flange: only with a URDF: the frame that the instrument is mounted on, z outwards.
        home: only with a URDF: (nv,) joint angles of the starting pose [rad]; without it, a
            configuration far from limits and singularities is searched, the same each time.
        locked: only with a URDF: joints on the way to the flange to hold, with their position.
        position: position limits, a lower and an upper one [rad].
        velocity: speed limits [rad/s].
        acceleration: acceleration limits [rad/s^2].
        jerk: jerk limits [rad/s^3].
        speed_near_limits: speed limits that depend on the position.

    Raises:
        UnknownName: no arm or no joint has this name.
        FrameNotFound: the URDF has no such frame.
        ArmError: the file is missing, is no URDF, or holds no fixed-base serial arm.
        OptionError: a limit is not allowed.
        PluginError: the arm is a plug-in's, which cannot be used.
    """
    if not isinstance(name, str | os.PathLike):
        raise ArmError(f"{name!r} is no arm; give a name, one of {arm_names()}, or a URDF's path")
    limits = {
        "position": position,
        "velocity": velocity,
        "acceleration": acceleration,
        "jerk": jerk,
        "speed_near_limits": speed_near_limits,
    }
    by_hand = {limit: value for limit, value in limits.items() if value is not None}
    path = Path(name)
    if path.suffix.lower() in (".urdf", ".xml", ".xacro") or path.parent != Path():
        return _load_urdf(path, flange, home, locked or {}, by_hand)
    folder = _folder(str(name))
    if folder is None:
        raise UnknownName("arm", str(name), arm_names())
    if flange is not None or home is not None or locked is not None:
        raise ArmError(
            f"flange, home and locked go with a URDF's path; {name} has its own in robot.toml"
        )
    return _load_named(str(name), folder, by_hand)


def _robots() -> Path:
    return Path(str(importlib.resources.files("rcmqp.robots")))


def _own_names() -> set[str]:
    return {entry.name for entry in _robots().iterdir() if (entry / "robot.toml").is_file()}


def _folder(name: str) -> Path | None:
    """The folder of a named arm, None if no arm has the name.

    A plug-in's entry point is a package whose folder holds robot.toml.
    """
    if name in _own_names():
        return _robots() / name
    if name not in points(GROUP):
        return None
    package = load(GROUP, name)
    folders = [Path(folder) for folder in getattr(package, "__path__", ())]
    for folder in folders:
        if (folder / "robot.toml").is_file():
            return folder
    whose = distribution(GROUP, name)
    raise PluginError(
        GROUP, name, whose, f"gives {package!r:.120}, it must be a package with a robot.toml"
    )


def _entry(folder: Path) -> dict[str, Any]:
    file = folder / "robot.toml"
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise ArmError(f"{file} is not TOML: {error}") from error


def _load_named(name: str, folder: Path, by_hand: Mapping[str, Any]) -> Arm:
    entry = _entry(folder)
    urdf = _resolve(folder, entry["urdf"])
    frame = entry["flange"]
    offset = pin.SE3(
        pin.rpy.rpyToMatrix(np.array(frame.get("rpy", [0.0, 0.0, 0.0]))),
        np.array(frame.get("xyz", [0.0, 0.0, 0.0])),
    )
    keys = ("title", "licence", "home", "acceleration", "jerk", "srs_offsets")
    about = {key: entry[key] for key in keys if key in entry}
    if "speed_near_limits" in entry:
        about["speed_near_limits"] = SpeedNearLimits(**entry["speed_near_limits"])
    return _build(
        _model(urdf),
        frame["frame"],
        entry.get("locked", {}),
        name=name,
        urdf=urdf,
        flange_offset=offset,
        by_hand=by_hand,
        **about,
    )


def _resolve(folder: Path, urdf: str) -> Path:
    """Path of a robot.toml's URDF: beside it, or inside the example-robot-data wheel."""
    package, colon, inside = urdf.partition(":")
    if not colon:
        return folder / urdf
    try:
        root = importlib.metadata.distribution(package).locate_file("")
    except importlib.metadata.PackageNotFoundError as error:
        raise ArmError(
            f"{folder.name} needs the models of {package}: pip install {package}"
        ) from error
    return Path(str(root)) / "cmeel.prefix/share" / _EXAMPLE_ROBOT_DATA / "robots" / inside


def _load_urdf(
    path: Path,
    flange: str | None,
    home: ArrayLike | None,
    locked: Mapping[str, float],
    by_hand: Mapping[str, Any],
) -> Arm:
    model = _model(path)
    if flange is None:
        bodies = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
        raise ArmError(
            f"{path}: say which frame carries the instrument: flange=..., "
            f"or --flange on the command line (the last ones are {', '.join(bodies[-4:])})"
        )
    about = {"title": model.name, "urdf": path, "home": home, "by_hand": by_hand}
    arm = _build(model, flange, locked, name=str(path), **about)
    if home is None:
        arm.home = _comfortable(arm)
    return arm


def _model(path: Path) -> pin.Model:
    try:
        there, size = path.is_file(), path.stat().st_size if path.is_file() else 0
    except (OSError, ValueError):  # too long a name, or NUL in it
        there, size = False, 0
    if not there:
        raise ArmError(f"{path}: no such file; give the path of a URDF, or a name: {arm_names()}")
    if size > MOST_URDF:
        raise ArmError(f"{path} has {size} bytes, a URDF {MOST_URDF} at most")
    return model_of(path)


def _build(
    model: pin.Model, flange: str, locked: Mapping[str, float], *, name: str, **about: Any
) -> Arm:
    """Hold the locked joints and those off the chain, check what is left, and make the Arm."""
    joint = find_frame(model, flange).parentJoint
    if model.njoints == 1:
        raise ArmError(f"{name}: the URDF has no moving joints")
    for held, position in locked.items():
        if not model.existJointName(held):
            raise UnknownName("joint", held, list(model.names)[1:])
        if not math.isfinite(position):
            raise ArmError(f"{name}: {held} cannot be locked at {position}; give a number")
    chain = set(model.supports[joint])
    hold = [i for i in range(1, model.njoints) if i not in chain or model.names[i] in locked]
    q = pin.neutral(model)
    for i in hold:
        if model.names[i] in locked:
            _set_angle(q, model.joints[i], locked[model.names[i]])
    model = pin.buildReducedModel(model, hold, q)
    _check(model, flange, name)
    for mimic in mimics_of(about["urdf"]):
        if model.existJointName(mimic):
            raise ArmError(
                f"{name}: joint {mimic!r} mimics another one and moves the flange; hold it with "
                "locked, or take its <mimic> out of the URDF"
            )
    about = limits_of(about["urdf"], list(model.names)[1:]) | about
    arm = Arm(model, flange, name=name, **about)
    _check_limits(arm)
    if about.get("home") is not None:
        arm.check_limits(arm.home)
    return arm


def _set_angle(q: Array, joint: Any, angle: float) -> None:
    """Put one joint's coordinate into q (nq,); a continuous joint has cosine and sine there."""
    values = [angle] if joint.nq == 1 else [math.cos(angle), math.sin(angle)]
    q[joint.idx_q : joint.idx_q + joint.nq] = values


def _check(model: pin.Model, flange: str, name: str) -> None:
    if model.njoints == 1:
        raise ArmError(f"{name}: no joint moves the flange {flange!r}; name a frame further out")
    for joint, joint_name in zip(model.joints[1:], list(model.names)[1:], strict=True):
        if joint.nv != 1:
            raise ArmError(
                f"{name}: joint {joint_name!r} has {joint.nv} degrees of freedom "
                f"({joint.shortname()}); only a fixed-base arm of revolute, continuous and "
                "prismatic joints can be used: fix the base to the world"
            )


def _check_limits(arm: Arm) -> None:
    """Check position and speed limits, wherever they come from."""
    for i, joint in enumerate(arm.joints):
        lower, upper, velocity = arm.lower[i], arm.upper[i], arm.velocity[i]
        if not lower < upper:
            raise ArmError(
                f"{arm.name}: joint {joint!r} has lower limit {lower} not below upper {upper}"
            )
        if not 0.0 < velocity < math.inf:
            raise ArmError(
                f"{arm.name}: joint {joint!r} has velocity limit {velocity}; "
                "give it a positive, finite one in <limit velocity=...>"
            )


def _comfortable(arm: Arm, samples: int = 4000) -> Array:
    """The best of many random configurations: far from its limits, and quick in every direction.

    Quick: how fast a point in the middle of an instrument can move and turn (the units of metre
    and radian mixed) before the first joint is at its speed limit.
    """
    rng = np.random.default_rng(0)
    middle = arm.with_effector(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.2])))
    candidates = np.array([arm.random_angles(rng) for _ in range(samples)])
    J = np.array([middle.state(arm.configuration(angles)).J_local for angles in candidates])
    effort = np.linalg.norm(np.linalg.pinv(J), axis=-1) / np.minimum(arm.velocity, 10.0)
    margin = np.minimum(arm.limit_margin(candidates).min(axis=1), 0.35)
    home: Array = candidates[int(np.argmax(margin / effort.max(axis=1)))]
    home.setflags(write=False)
    return home
