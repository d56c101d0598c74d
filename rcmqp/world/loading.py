"""Arms by name out of the robots folder, from a file of one's own, or from any URDF."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import importlib.resources
import math
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rcmqp.errors import (
    ArmError,
    ArmWarning,
    JointLimitViolated,
    PluginError,
    RcmqpError,
    UnknownName,
)
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm, ModelSource, find_frame
from rcmqp.world.arm_file import LIMITS, ArmFile, entry_of, read_arm_file
from rcmqp.world.arm_limits import (
    GivenPosition,
    LimitValues,
    SpeedNearLimits,
    filled,
    per_joint,
    per_joint_position,
)
from rcmqp.world.home import home_of
from rcmqp.world.mimics import held_followers, without_mimics
from rcmqp.world.plugins import distribution, load, points
from rcmqp.world.questions import TURNS, check_given, home_question, questions
from rcmqp.world.urdf import (
    Urdf,
    assumed_speeds,
    equalities_of,
    limits_of,
    model_of,
    placed,
    read_urdf,
    soft_limits_of,
)
from rcmqp.world.urdf_checks import MOST_LENGTH

ARM_FILE = ".toml"
"""How the name of an arm's file ends."""

URDF_ENDINGS = (".urdf", ".xml", ".xacro", ".gz")

GROUP = "rcmqp.arms"
"""Of the entry points whose packages are arms."""


def arm_names() -> list[str]:
    """Names of the arms that load_arm() knows, sorted; those of plug-ins are among them."""
    return sorted(_own_names() | points(GROUP).keys())


def arm_title(name: str) -> str:
    """What people call the arm: the title in its file, or a file's name without ending."""
    folder = _folder(name)
    if folder is not None:
        return str(read_arm_file(folder / "robot.toml", _robots()).entry["title"])
    path = Path(name)
    if path.suffix.lower() == ARM_FILE:
        with contextlib.suppress(RcmqpError):
            if title := read_arm_file(path, _robots()).entry.get("title"):
                return str(title)
    return path.name.partition(".")[0] or name


def names_its_flange(name: str) -> bool:
    """Whether an arm is known by a name or by its own file, so that no flange goes with it."""
    return name in arm_names() or name.lower().endswith(ARM_FILE)


def new_arm(urdf: str) -> str:
    """The command that writes an arm's file for a URDF, with the flange to be filled in."""
    file, _, frame = urdf.rpartition(":")
    if not file.lower().endswith(URDF_ENDINGS):
        file, frame = urdf, "FRAME"
    return f"rcmqp new arm my_robot --set urdf={file} --set flange.frame={frame}"


def load_arm(
    name: str | os.PathLike[str],
    flange: str | None = None,
    *,
    home: ArrayLike | Mapping[str, float] | None = None,
    locked: Mapping[str, float] | None = None,
    position: GivenPosition | None = None,
    velocity: LimitValues | None = None,
    acceleration: LimitValues | None = None,
    jerk: LimitValues | None = None,
    speed_near_limits: SpeedNearLimits | None = None,
) -> Arm:
    """Load an arm by name, from an arm's file, or from a URDF.

    Joints that do not move the flange (grippers, other arms) are held where they are.

    Limits that are given take the place of the arm's own: one number for all joints, one for each
    (None keeps the joint's own), or numbers by joint name. The arm's own are those of its file,
    and else of the URDF. URDF 1.2 has acceleration, deceleration and jerk in <limit>; of the first
    two the smaller counts, for speeding up and for slowing down. Soft limits in a
    <safety_controller> narrow the position limits. An acceleration or jerk limit that is nowhere,
    or a speed limit that an MJCF does not have, is assumed, see Limited and ``arm.assumed``;
    math.inf says that there is none.

    What looks wrong, such as degrees in place of radians, is said by an ArmWarning; a home or a
    limit that was given, here or in an arm's file, is refused if it looks like degrees.

    Args:
        name: a name out of arm_names(); the path of an arm's file, which ends in .toml and has
            the format of robots/<name>/robot.toml; or the path of a URDF: .urdf, .urdf.gz, or
            .xacro where the package xacro is installed; or of an MJCF, .xml, where mujoco is.
        flange: only with a URDF: the frame that the instrument is mounted on, z outwards.
        home: joint angles (nv,) of the starting pose [rad], or by joint name, in place of the
            arm's own. A URDF has none: without it, a configuration far from limits and
            singularities is searched, the same each time.
        locked: only with a URDF: joints on the way to the flange to hold, with their position;
            joints that follow them are held too.
        position: position limits, a lower and an upper one [rad].
        velocity: speed limits [rad/s].
        acceleration: acceleration limits [rad/s^2].
        jerk: jerk limits [rad/s^3].
        speed_near_limits: speed limits that depend on the position.

    Raises:
        UnknownName: no arm or no joint has this name.
        FrameNotFound: the URDF has no such frame.
        ArmError: the file is missing, is not a URDF, or holds no fixed-base serial arm; or a home
            or a limit that was given looks like degrees.
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
    urdf, _, frame = str(name).rpartition(":")
    if urdf.lower().endswith(URDF_ENDINGS) and os.path.isfile(urdf):
        raise ArmError(f"{name}: give the flange apart: --arm {urdf} --flange {frame}")
    own_file = path.suffix.lower() == ARM_FILE
    if not own_file and (path.suffix.lower() in URDF_ENDINGS or path.parent != Path()):
        try:
            return _questioned(_load_urdf(path, flange, home, locked or {}, by_hand))
        except RcmqpError as error:
            raise error.of(path)  # noqa: B904  (it is the same one)
    folder = None if own_file else _folder(str(name))
    if not own_file and folder is None:
        raise UnknownName("arm", str(name), arm_names())
    if flange is not None or locked is not None:
        raise ArmError(
            f"flange and locked go with a URDF's path; {name} has its own in "
            f"{path.name if own_file else 'robot.toml'}"
        )
    if own_file:
        try:
            file = read_arm_file(path, _robots())
            arm = _load_file(file, str(name), home, by_hand, path.read_bytes())
            return _questioned(arm, mounted="rpy" in file.entry["flange"])
        except RcmqpError as error:
            raise error.of(path)  # noqa: B904  (it is the same one)
    assert folder is not None
    toml = folder / "robot.toml"
    made_of = None if str(name) in _own_names() else toml.read_bytes()
    return _load_file(read_arm_file(toml, _robots()), str(name), home, by_hand, made_of)


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


def _questioned(arm: Arm, *, mounted: bool = False) -> Arm:
    """The arm, and a warning for each thing that looks wrong with it; see questions()."""
    check_given(arm)
    for question in questions(arm, mounted=mounted):
        warnings.warn(question, ArmWarning, stacklevel=1)
    return arm


def _load_file(
    file: ArmFile,
    name: str,
    home: ArrayLike | Mapping[str, float] | None,
    by_hand: Mapping[str, Any],
    made_of: bytes | None = None,
) -> Arm:
    """The arm of an arm's file; ``made_of`` is the file where it counts for sha256.

    ``home`` takes the place of the file's.
    """
    urdf = read_urdf(file.urdf)
    entry = entry_of(file, urdf)
    if "base" in entry or "rail" in entry:
        urdf = placed(urdf, file.placement("base"), file.rail())
    sha256 = urdf.sha256
    if made_of is not None:
        sha256 = hashlib.sha256(sha256.encode() + made_of).hexdigest()
    locked = entry.get("locked", {})
    sources = {str(topic): str(text) for topic, text in entry.get("sources", {}).items()}
    about: dict[str, Any] = {
        key: entry[key] for key in ("title", "licence", "srs_offsets") if key in entry
    }
    if "speed_near_limits" in entry:
        about["speed_near_limits"] = _near_limits(entry["speed_near_limits"])
    return built(
        urdf,
        entry["flange"]["frame"],
        locked,
        name=name,
        home=entry.get("home") if home is None else home,
        own={limit: entry[limit] for limit in LIMITS if limit in entry},
        source=ModelSource(urdf.path, urdf.text, sha256, file.packages, {}, sources),
        flange_offset=file.placement("flange"),
        by_hand=by_hand,
        **about,
    )


def _near_limits(given: Any) -> SpeedNearLimits:
    known = [item.name for item in dataclasses.fields(SpeedNearLimits)]
    if not isinstance(given, Mapping) or sorted(given) != sorted(known):
        raise ArmError(
            f"speed_near_limits = {given!r:.80}, it must be a table of {', '.join(known)}"
        )
    return SpeedNearLimits(**given)


def _load_urdf(
    path: Path,
    flange: str | None,
    home: ArrayLike | Mapping[str, float] | None,
    locked: Mapping[str, float],
    by_hand: Mapping[str, Any],
) -> Arm:
    urdf = read_urdf(path)
    if flange is None:
        links = [link.attrib["name"] for link in urdf.root.iterfind("link")]
        raise ArmError(
            f"{path}: say which frame carries the instrument: flange=..., "
            f"or --flange on the command line (the last ones are {', '.join(links[-4:])}), or "
            f"write an arm's file: {new_arm(str(path))}"
        )
    return built(
        urdf,
        flange,
        locked,
        name=str(path),
        title=urdf.root.attrib["name"],
        home=home,
        own={},
        source=ModelSource(path, urdf.text, urdf.sha256, (), dict(locked)),
        by_hand=by_hand,
    )


def built(
    urdf: Urdf,
    flange: str,
    locked: Mapping[str, float],
    *,
    name: str,
    home: ArrayLike | Mapping[str, float] | None,
    own: Mapping[str, Any],
    source: ModelSource,
    **about: Any,
) -> Arm:
    """Hold the locked joints and those off the chain, check what is left, and make the Arm."""
    recipe = {
        "flange": flange,
        "locked": dict(locked),
        "home": _plain(home),
        "own": dict(own),
        "about": {key: _plain(value) for key, value in about.items() if key != "by_hand"},
    }
    asked = {held: _position(name, held, position) for held, position in locked.items()}
    followers = held_followers(urdf, flange, asked)
    locked = {**asked, **followers}
    given, urdf = urdf, without_mimics(urdf, flange, list(locked))
    model = model_of(urdf)
    joint = find_frame(model, flange).parentJoint
    if model.njoints == 1:
        raise ArmError(f"{name}: the URDF has no moving joints")
    for held in locked:
        if not model.existJointName(held):
            raise UnknownName("joint", held, list(model.names)[1:])
    for held, position in asked.items():
        _check_locked(model, name, held, position)
    chain = set(model.supports[joint])
    hold = [i for i in range(1, model.njoints) if i not in chain or model.names[i] in locked]
    q = pin.neutral(model)
    for i in hold:
        if model.names[i] in locked:
            _set_angle(q, model.joints[i], locked[model.names[i]])
    notes = _held(model, hold, locked)
    fixed = [
        f"{held} at {position:g}"
        for held, position in asked.items()
        if model.getJointId(held) in chain
    ]
    if fixed:
        notes.append(f"locked: {', '.join(fixed)}")
    if followers:
        notes.append(f"held, as they follow locked joints: {', '.join(followers)}")
    links = {link.attrib["name"] for link in urdf.root.iterfind("link")}
    for i in hold:  # each becomes a frame, and there a link may have its name
        if model.names[i] in links:
            model.names[i] = f"{model.names[i]} (joint)"
    model = pin.buildReducedModel(model, hold, q)
    _check(model, flange, name)
    _check_untied(model, urdf, name)
    notes += _set_position_and_speed(model, urdf, own)
    if urdf is not given:
        notes.append("a parallelogram is put into one joint; its bars are not drawn")
    joints = list(model.names)[1:]
    about = limits_of(urdf, joints) | _accelerations(own) | about
    if home is None:
        notes.append("home is not given, so it was searched")
    source = dataclasses.replace(source, notes=tuple(notes), text=urdf.text, recipe=recipe)
    home = _by_joint(home, joints, name)
    arm = Arm(model, flange, name=name, home=home, home_search=home_of, source=source, **about)
    _check_limits(arm)
    if home is not None:
        try:
            arm.check_limits(arm.home)
        except JointLimitViolated as error:
            if question := home_question(arm, error):
                raise ArmError(question) from error
            raise
    return arm


def _plain(value: Any) -> Any:
    """A value of built()'s arguments as JSON has it."""
    if isinstance(value, pin.SE3):
        return value.homogeneous.tolist()
    if isinstance(value, SpeedNearLimits):
        return dataclasses.asdict(value)
    return value if isinstance(value, str | Mapping | None) else np.asarray(value).tolist()


def _held(model: pin.Model, hold: Sequence[int], locked: Mapping[str, float]) -> list[str]:
    """A sentence on the joints that are held because they do not move the flange, if any."""
    off = [model.names[i] for i in hold if model.names[i] not in locked]
    return [f"held at zero, as they do not move the flange: {', '.join(off)}"] if off else []


def _set_position_and_speed(model: pin.Model, urdf: Urdf, own: Mapping[str, Any]) -> list[str]:
    """Put soft limits, and an arm's file's, into the model; a sentence where they are soft."""
    narrowed = []
    joints = list(model.names)[1:]
    none = np.full((len(joints), 2), np.nan)
    given = per_joint_position(own["position"], joints) if "position" in own else none
    speeds = per_joint("velocity", own["velocity"], joints) if "velocity" in own else none[:, 0]
    unknown = np.isin(joints, assumed_speeds(urdf))
    model.velocityLimit, _ = filled(speeds, np.where(unknown, np.nan, model.velocityLimit))
    lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    for i, name in enumerate(joints):
        joint = model.joints[i + 1]
        if joint.nq != 1:
            if not np.isnan(given[i, 0]):
                raise ArmError(
                    f"position of {name} is given, and the joint turns without end; make it "
                    "revolute in the URDF, or leave it out"
                )
            continue
        soft = soft_limits_of(urdf, name)
        at = joint.idx_q
        own_pair = max(lower[at], soft[0]), min(upper[at], soft[1])
        if own_pair != (lower[at], upper[at]) and np.isnan(given[i, 0]):
            narrowed.append(name)
        lower[at], upper[at] = own_pair if np.isnan(given[i, 0]) else given[i]
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    if not narrowed:
        return []
    return [f"position limits are the soft ones of <safety_controller>: {', '.join(narrowed)}"]


def _accelerations(own: Mapping[str, Any]) -> dict[str, Any]:
    """The acceleration and jerk limits of an arm's file."""
    return {limit: own[limit] for limit in ("acceleration", "jerk") if limit in own}


def _by_joint(
    home: ArrayLike | Mapping[str, float] | None, joints: list[str], name: str
) -> ArrayLike | None:
    """Home (nv,), if it was given by joint name as well."""
    if not isinstance(home, Mapping):
        return home
    for joint in home:
        if joint not in joints:
            raise UnknownName("joint", joint, joints)
    if missing := [joint for joint in joints if joint not in home]:
        raise ArmError(f"{name}: home does not say where {', '.join(missing)} is; add it")
    return [home[joint] for joint in joints]


def _position(name: str, held: str, position: Any) -> float:
    """Where a joint is to be held, as a number."""
    number = isinstance(position, int | float) and not isinstance(position, bool)
    if not number or not abs(position) < MOST_LENGTH:
        raise ArmError(
            f"{name}: {held} cannot be locked at {position!r:.80}; give a number of rad or m"
        )
    return float(position)


def _check_locked(model: pin.Model, name: str, held: str, position: float) -> None:
    """Refuse a locked position outside the joint's limits; without limits, beyond +-TURNS."""
    joint = model.joints[model.getJointId(held)]
    lower, upper, unit = -TURNS, TURNS, "rad"
    if joint.nq == 1:
        lower, upper = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
        unit = "m" if joint.shortname().startswith("JointModelP") else "rad"
    if lower <= position <= upper:
        return
    other, factor, most = "degrees", math.pi / 180.0, 2.0 * math.pi
    if unit == "m":
        other, factor, most = "millimetres", 0.001, 2.0
    fits = abs(position) > most and lower <= factor * position <= upper
    more = f"; are these {other}? Multiply by {factor:.6g}" if fits else ""
    allowed = f"its limits are {lower:g} and {upper:g} {unit}"
    if joint.nq != 1:
        allowed = "more than two turns from zero"
    raise ArmError(f"{name}: {held} cannot be locked at {position:g} {unit}, {allowed}{more}")


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


def _check_untied(model: pin.Model, urdf: Urdf, name: str) -> None:
    """Refuse joints between base and flange that an MJCF's <equality> ties to something."""
    tied = equalities_of(urdf)
    for joint in model.names[1:]:
        if joint in tied:
            raise ArmError(
                f"{name}: joint {joint!r} moves the flange, and is tied by the active "
                f"{tied[joint]} of <equality>; each joint between base and flange must move "
                "alone: hold it with locked, or take the <equality> out if the arm has none"
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
