"""A fixed-base serial arm: the only owner of a pin.Data."""

from __future__ import annotations

import copy
import functools
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.errors import FrameNotFound, InvalidCommand, OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm_limits import LimitValues, SpeedNearLimits
from rcmqp.world.frames import Shaft, Tool
from rcmqp.world.instrument import Wrist
from rcmqp.world.limited import Limited

_LOCAL = pin.ReferenceFrame.LOCAL
_jacobians, _placement = pin.computeJointJacobians, pin.updateFramePlacement
_frozen, _state = _kernel.frozen, _kernel.state
_jacobian, _xyzquat = pin.getFrameJacobian, pin.SE3ToXYZQUAT


@dataclass(frozen=True, slots=True, eq=False)
class ModelSource:
    """Where an arm's model comes from.

    Attributes:
        urdf: the file that the model was read from.
        text: the URDF that the model was made of, with the base where it stands.
        sha256: of the URDF's file; with an arm's file that is not rcmqp's, of that one as well.
        packages: folders in which the meshes of package:// are looked for.
        locked: joints on the way to the flange that are held because load_arm() was told so,
            with their positions.
        sources: where the numbers in the arm's file come from, by topic.
        notes: sentences on what was assumed or left out when the arm was loaded.
        recipe: what load_arm() made the arm with besides the URDF, in numbers and texts; see
            carried.CarriedArm.
        carried: whether the URDF came in a run's file; its meshes are not looked for.
        meshes: SHA-256 of the meshes by their names, as they were when a run was made; empty where
            the arm is not that of a run.
    """

    urdf: Path
    text: str
    sha256: str
    packages: tuple[Path, ...] = ()
    locked: Mapping[str, float] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    recipe: Mapping[str, Any] = field(default_factory=dict)
    carried: bool = False
    meshes: Mapping[str, str] = field(default_factory=dict)


ToolAt: TypeAlias = tuple[float] | tuple[float, Array, Array]
"""What is known of a tool, see ``ArmState.tool_at``."""


@dataclass(frozen=True, slots=True, eq=False)
class ArmState:
    """What one kinematics pass found at ``q``.

    The effector is the point of the arm that is controlled: the flange, or, with an instrument
    in a trocar, the point of the shaft that lay on the trocar at the start.

    Attributes:
        q: (nq,) configuration, Pinocchio's.
        angles: (nv,) joint coordinates [rad] or [m]; an angle where a joint is continuous.
        oMe: placement of the effector in the world, z along the shaft, into the patient.
        x: (8,) the same placement as a unit dual quaternion, x_eff of the paper.
        J_local: (6, nv) effector twist per joint velocity, linear [m] then angular [rad], in the
            effector frame.
        v: (nv,) joint velocity now [rad/s]; zero where none is given. In a control loop, the last
            command: the next one is kept within the acceleration limits of it.
        a: (nv,) joint acceleration now [rad/s^2]; zero where none is given. In a control loop, the
            last command minus the one before, over the period: limits on jerk count from it.
        tool_at: what ``tool`` is made of: how far the tip is beyond the effector, along the shaft
            [m], as with a straight wrist; and, with a wrist, the tool's pose (8,) in the world as
            a unit dual quaternion and its Jacobian (6, nv).
    """

    q: Array
    angles: Array
    oMe: pin.SE3
    x: Array
    J_local: Array
    v: Array
    a: Array
    tool_at: ToolAt

    @property
    def shaft(self) -> Shaft:
        """The shaft: its points by their depth beyond the effector."""
        return Shaft(self.oMe, self.J_local, self.v, self.tool_at[0])

    @property
    def tool(self) -> Tool:
        """The tool: the tip, in the shaft's axes, or what a wrist carries."""
        if len(self.tool_at) == 3:
            _, x, J_local = self.tool_at
            return Tool(dq.to_se3(x), J_local)
        eMt = pin.SE3(np.eye(3), np.array([0.0, 0.0, *self.tool_at]))
        return Tool(self.oMe * eMt, eMt.toActionMatrixInverse() @ self.J_local)

    @property
    def J_world_aligned(self) -> Array:
        """(6, nv) the effector's twist in axes parallel to the world's, linear then angular."""
        R = self.oMe.rotation
        return np.vstack([R @ self.J_local[:3], R @ self.J_local[3:]])

    @property
    def J_dq(self) -> Array:
        """(8, nv) J of equation (1): vec(x_eff)' = J_dq v.

        With the effector's twist (nu, omega) in its own frame, x' = (1/2) x (omega + eps nu).
        """
        H = dq.H8_plus(0.5 * self.x)
        return np.asarray(H[:, 1:4] @ self.J_local[3:] + H[:, 5:] @ self.J_local[:3])


class _Scratch(threading.local):
    """A pin.Data for each thread, so that none writes over what another one reads.

    Attributes:
        model: whose data it is.
        data: the thread's own.
    """

    def __init__(self, model: pin.Model) -> None:
        self.model, self.data = model, model.createData()

    def __reduce__(self) -> tuple[type[_Scratch], tuple[pin.Model]]:
        return _Scratch, (self.model,)


class Arm(Limited):
    """A Pinocchio model, its tool flange and its home.

    Made by load_arm(). Every joint has one degree of freedom and moves the flange; velocity
    index i is joint i of the chain. Any number of threads may use one.

    Attributes:
        name: the name it was loaded by.
        title: what people call it.
        licence: of the model file.
        model: Pinocchio's model.
        flange: name of the frame that the instrument is mounted on.
        jMflange: placement of the flange in the last joint's frame.
        lower, upper, velocity, acceleration, jerk, speed_near_limits: see Limited.
        middle: (nv,) middle of the position limits; 0 for continuous joints.
        wrist: of the instrument, whose joints are the arm's last ones, see with_wrist(); None
            for an arm alone.
        srs_offsets: (nv,) what to add to the joint angles so that they are those of a
            spherical-revolute-spherical arm that is straight at zero; None for other arms.
        source: the file that the model was read from, and what is known of it.
    """

    def __init__(
        self,
        model: pin.Model,
        flange: str,
        *,
        name: str,
        title: str | None = None,
        licence: str = "unknown",
        home: ArrayLike | None = None,
        home_search: Callable[[Arm], Array] | None = None,
        flange_offset: pin.SE3 | None = None,
        acceleration: LimitValues | None = None,
        jerk: LimitValues | None = None,
        speed_near_limits: SpeedNearLimits | None = None,
        by_hand: Mapping[str, Any] | None = None,
        srs_offsets: ArrayLike | None = None,
        source: ModelSource | None = None,
        wrist: Wrist | None = None,
    ) -> None:
        """Make an arm of a model.

        Args:
            model: fixed base, joints of one degree of freedom.
            flange: name of the frame that the instrument is mounted on.
            name: what it is called.
            title: what people call it; the name without it.
            licence: of the model file.
            home: (nv,) joint angles of the starting pose.
            home_search: finds them where they are first needed and not given; the middle of the
                limits without it.
            flange_offset: placement of the flange in its frame.
            acceleration: what is known of the limits, see LimitValues; of other joints, the speed
                limit over SPEED_TIME is assumed.
            jerk: likewise; the acceleration limit over ACCELERATION_TIME is assumed.
            speed_near_limits: speed limits that depend on the position.
            by_hand: limits by their name in ArmLimits, each of which takes the place of the arm's
                own.
            srs_offsets: see the attribute.
            source: the file that the model was read from.
            wrist: whose joints the model's last ones are.
        """
        frame = find_frame(model, flange)
        self.model, self.flange, self.name = model, flange, name
        self.title, self.licence, self.source = title or name, licence, source
        self.wrist = wrist
        offset = flange_offset or pin.SE3.Identity()
        self._joint: int = frame.parentJoint
        self.jMflange = frame.placement * offset
        self._put_effector(self.jMflange, 0.0)
        self._sizes: tuple[int, int] = (model.nq, model.nv)
        self._still = _vector("still", np.zeros(model.nv), model.nv)
        self._continuous = np.array([joint.nq == 2 for joint in model.joints[1:]])
        self._turning = np.flatnonzero(self._continuous)
        self._endless = bool(self._continuous.any())
        self._idx_q = np.array([joint.idx_q for joint in model.joints[1:]])
        own = {
            "lower": self._per_joint(model.lowerPositionLimit, -np.inf),
            "upper": self._per_joint(model.upperPositionLimit, np.inf),
            "velocity": _vector("velocity limits", model.velocityLimit, model.nv),
            "acceleration": acceleration,
            "jerk": jerk,
            "speed_near_limits": speed_near_limits,
        }
        self._set_limits(own, by_hand or {}, self._continuous)
        self.srs_offsets = (
            None if srs_offsets is None else _vector("srs_offsets", srs_offsets, model.nv)
        )
        limited = np.isfinite(self.lower) & np.isfinite(self.upper)
        middle = np.zeros(model.nv)
        middle[limited] = (self.lower[limited] + self.upper[limited]) / 2
        self.middle = _vector("middle", middle, model.nv)
        self._given_home = None if home is None else _vector("home", home, model.nv)
        self._home_search = home_search

    def __repr__(self) -> str:
        return f"Arm({self.name!r}, nv={self.nv}, flange={self.flange!r})"

    @property
    def nq(self) -> int:
        """Size of Pinocchio's configuration vector; larger than nv with continuous joints."""
        return int(self.model.nq)

    @property
    def last_joint(self) -> int:
        """Pinocchio's index of the joint that carries the flange."""
        return self._joint

    def with_effector(self, flangeMe: pin.SE3, depth: float = 0.0) -> Arm:
        """The same arm, with the effector at a fixed placement seen from the flange.

        The tip is ``depth`` [m] beyond the effector, along its z; a wrist's where it is straight.
        """
        arm = copy.copy(self)
        arm._put_effector(self.jMflange * flangeMe, float(depth))
        return arm

    def state(
        self, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None
    ) -> ArmState:
        """One kinematics pass at ``q`` (nq,), joints moving with ``v`` and ``a`` (nv,).

        A joint reading that is not finite is not an error here: the state carries it, placement
        and Jacobian are NaN as well, and a controller answers with the safe stop. So a loop on a
        real arm needs no other way out.

        Raises:
            InvalidCommand: q, v or a has the wrong size.
        """
        nq, nv = self._sizes
        here = _frozen(q, nq)
        if here is None:
            raise _wrong_size("configuration q", q, nq, self._hint(q))
        model, data, effector = self._kinematics, self._scratch.data, self._effector
        _jacobians(model, data, here)  # runs forward kinematics too
        oMe = _placement(model, data, effector)
        J_local = _jacobian(model, data, effector, _LOCAL)
        angles = self._frozen_angles(here) if self._endless else here
        tool: ToolAt = self._tip
        if self.wrist is not None:
            oMt = _placement(model, data, self._tool)
            J_t = _frozen(_jacobian(model, data, self._tool, _LOCAL), 6, nv)
            assert J_t is not None  # for mypy
            tool = *self._tip, _kernel.from_xyzquat(_xyzquat(oMt)), J_t
        made = _state(ArmState, here, angles, oMe, _xyzquat(oMe), J_local, v, a, self._still, tool)
        if made is None:
            if v is not None and np.shape(v) != (nv,):
                raise _wrong_size("joint velocity v", v, nv)
            assert a is not None  # for mypy
            raise _wrong_size("joint acceleration a", a, nv)
        return made

    def skeleton(self, q: ArrayLike) -> Array:
        """Points (nv + 2, 3) in the world [m]: the base, each joint, the effector."""
        oMe = self.state(q).oMe
        data = self._scratch.data
        joints = [data.oMi[i].translation for i in range(self.model.njoints)]
        return np.array([*joints, oMe.translation])

    def angles(self, q: ArrayLike) -> Array:
        """Joint coordinates (nv,) of a configuration (nq,): angles where joints are continuous."""
        q = np.asarray(q, dtype=float)
        angles: Array = q[self._idx_q]
        if self._turning.size:
            cosine, sine = q[self._idx_q[self._turning]], q[self._idx_q[self._turning] + 1]
            angles[self._turning] = np.arctan2(sine, cosine)
        return angles

    def configuration(self, angles: ArrayLike | Mapping[str, float]) -> Array:
        """Configuration (nq,) of joint coordinates (nv,); inverse of angles().

        The coordinates may also be given by the joints' names, in any order, as a robot reports
        them; other joints that it reports, such as a gripper's, are passed over.

        Raises:
            InvalidCommand: a joint is missing, a coordinate is not finite, or there are too many
                or too few.
        """
        if isinstance(angles, Mapping):
            angles = self._in_order(angles)
        angles = _checked(angles, self.nv, "joint angles")
        q = np.zeros(self.nq)
        q[self._idx_q] = np.where(self._continuous, np.cos(angles), angles)
        q[self._idx_q[self._turning] + 1] = np.sin(angles[self._turning])
        return q

    def integrate(self, q: Array, v: Array, dt: float) -> Array:
        """Configuration (nq,) reached from ``q`` at velocity ``v`` (nv,) after ``dt`` [s]."""
        if self._endless:
            return np.asarray(pin.integrate(self.model, q, dt * v))
        moved = _kernel.moved(q, v, dt, self._sizes[0])
        if moved is None:
            raise InvalidCommand(
                f"q and v have shapes {np.shape(q)} and {np.shape(v)}, they must be "
                f"({self.nq},) and ({self.nv},)"
            )
        return moved

    def check_limits(self, angles: ArrayLike) -> None:
        """Check joint angles (nv,).

        Raises:
            JointLimitViolated: the joint that is farthest outside its limits.
        """
        self._check_inside(_checked(angles, self.nv, "joint angles"))

    @functools.cached_property
    def home(self) -> Array:
        """(nv,) joint angles of the named starting pose [rad]."""
        if self._given_home is not None:
            return self._given_home
        search = self._home_search
        return _vector("home", self.middle if search is None else search(self), self.nv)

    @property
    def urdf(self) -> Path | None:
        """The file that the model was read from; None where it came from none."""
        return None if self.source is None else self.source.urdf

    @property
    def sha256(self) -> str:
        """Of what the model was read from; empty where it came from no file."""
        return "" if self.source is None else self.source.sha256

    @functools.cached_property
    def reach(self) -> float:
        """Largest distance from the first joint's origin to the flange [m], found by search."""
        rng = np.random.default_rng(0)
        flange = self.with_effector(pin.SE3.Identity())
        shoulder = np.array(self.model.jointPlacements[1].translation)
        starts = sorted(
            (self.random_angles(rng) for _ in range(500)),
            key=lambda angles: -_distance(flange, angles, shoulder),
        )
        return max(_climb(flange, angles, shoulder) for angles in starts[:8])

    def _hint(self, q: ArrayLike) -> str:
        """What to do about joint angles in place of a configuration; else empty."""
        if self.nq == self.nv or np.shape(q) != (self.nv,):
            return ""
        return "; arm.configuration(angles) makes one of joint angles, as some of them are endless"

    def _in_order(self, angles: Mapping[str, float]) -> Array:
        """Joint coordinates (nv,) out of those given by name."""
        if missing := [joint for joint in self.joints if joint not in angles]:
            raise InvalidCommand(
                f"joint angles without {', '.join(missing)}, but with {', '.join(angles)}; give "
                f"all of {', '.join(self.joints)}"
            )
        return np.array([angles[joint] for joint in self.joints], dtype=float)

    def _put_effector(self, jMe: pin.SE3, tip: float) -> None:
        """Put the effector at a placement seen from the flange's joint: a frame of its own.

        The straight tip is ``tip`` [m] beyond it; a wrist's tool is another frame.
        """
        self._kinematics, self._tip = self.model.copy(), (tip,)
        effector = pin.Frame("rcmqp_effector", self._joint, jMe, pin.FrameType.OP_FRAME)
        self._effector = self._kinematics.addFrame(effector)
        if self.wrist is not None:
            at = pin.SE3(np.eye(3), np.array([0.0, 0.0, self.wrist.tool]))
            last = self.model.njoints - 1
            tool = pin.Frame("rcmqp_tool", last, at, pin.FrameType.OP_FRAME)
            self._tool = self._kinematics.addFrame(tool)
        self._scratch = _Scratch(self._kinematics)

    def _frozen_angles(self, q: Array) -> Array:
        """Joint coordinates (nv,) of q (nq,), not to be written."""
        angles = self.angles(q)
        angles.setflags(write=False)
        return angles

    def _per_joint(self, limit: Array, unlimited: float) -> Array:
        values = np.where(self._continuous, unlimited, np.asarray(limit)[self._idx_q])
        return _vector("position limits", values, len(self._idx_q))


def find_frame(model: pin.Model, name: str) -> pin.Frame:
    """The frame of a model with this name; of several, the body.

    Raises:
        FrameNotFound: there is none.
    """
    found = [frame for frame in model.frames if frame.name == name]
    if not found:
        bodies = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
        raise FrameNotFound(name, bodies)
    return next((frame for frame in found if frame.type == pin.FrameType.BODY), found[0])


def _sized(values: ArrayLike, size: int, what: str) -> Array:
    """A copy (size,) of the values that cannot be written."""
    array = _frozen(values, size)
    if array is None:
        raise _wrong_size(what, values, size)
    return array


def _wrong_size(what: str, values: ArrayLike, size: int, hint: str = "") -> InvalidCommand:
    return InvalidCommand(f"{what} has shape {np.shape(values)}, it must be ({size},){hint}")


def _checked(values: ArrayLike, size: int, what: str) -> Array:
    """The same, all of them finite."""
    array = _sized(values, size, what)
    if not np.isfinite(array).all():
        raise InvalidCommand(f"{what} is not finite: {array}")
    return array


def _vector(what: str, values: ArrayLike | Sequence[float], size: int) -> Array:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise OptionError(f"{what} = {values!r:.80}, it must be {size} numbers") from error
    if array.shape != (size,):
        raise OptionError(f"{what} has shape {array.shape}, the arm has {size} joints")
    array.setflags(write=False)
    return array


def _distance(arm: Arm, angles: Array, point: Array) -> float:
    return float(np.linalg.norm(arm.state(arm.configuration(angles)).oMe.translation - point))


def _climb(arm: Arm, angles: Array, point: Array) -> float:
    """Largest distance [m] of the effector from a point, uphill from ``angles`` in the limits."""
    best, step = _distance(arm, angles, point), 0.5
    while step > 1e-6:
        state = arm.state(arm.configuration(angles))
        gradient = state.J_world_aligned[:3].T @ (state.oMe.translation - point)
        moved = angles + step * gradient / max(float(np.linalg.norm(gradient)), 1e-12)
        moved = np.clip(moved, arm.lower, arm.upper)
        distance = _distance(arm, moved, point)
        if distance > best + 1e-9:
            best, angles = distance, moved
        else:
            step /= 2
    return best
