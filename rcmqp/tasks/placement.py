"""Where the instrument is: tasks on its tip, depth, direction, roll, orientation, pose and RCM."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rcmqp._kernel import Block
from rcmqp.errors import OptionError
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.options import at_least, rule
from rcmqp.tasks.base import CompiledTask
from rcmqp.world.insertion import Insertion


@dataclass(frozen=True, eq=False)
class TipTask(CompiledTask):
    """Bring the tip to where the desired effector has it.

    With a the tip in the effector's axes, straight along the shaft, the tip is p + R a, so

        e = (p + R a) - (p_d + R_d a),
        de/dt = R (nu - [a]x omega) - R_d (nu_d + omega_d x a).

    A tool with a wrist is where the wrist has it, p_t with R_t and nu_t, and is asked to be there
    too: then e = p_t - (p_d + R_d a), and R_t nu_t stands in place of R (nu - [a]x omega).
    """

    name: ClassVar[str] = "tip"
    unit: ClassVar[str] = "m"

    @functools.cached_property
    def block(self) -> Block:
        """Error (3,) [m], in the world's axes."""
        return Block("tip")


@dataclass(frozen=True, eq=False)
class DepthTask(CompiledTask):
    """Bring the insertion depth to that of the desired effector.

    Both are measured along a shaft, its own each, from the trocar: depth = a_z - r_z with
    r = R^T (pivot - p), see RcmTask, and a as in TipTask, the same for both, which drops out:

        e = r_d,z - r_z,   de/dt = ([r_d]x omega_d - nu_d + R_d^T pivot_dot)_z
                                 - ([r]x omega - nu + R^T pivot_dot)_z.
    """

    name: ClassVar[str] = "depth"
    unit: ClassVar[str] = "m"

    @functools.cached_property
    def block(self) -> Block:
        """Error (1,) [m], positive when too deep."""
        return Block("depth")


@dataclass(frozen=True, eq=False)
class DirectionTask(CompiledTask):
    """Point the shaft as the desired effector points its own.

    The desired shaft axis z_d, seen from the effector, is u = R^T z_d; on target it is e_z. The
    error is u's first two coordinates, its norm the sine of the angle between the shafts:

        du/dt = [u]x omega + R^T R_d (omega_d x e_z).

    Two rows of rank 2, but where the angle is 90 degrees; beyond it the error shrinks again and
    is zero, unstably, at 180. No camera in a trocar turns that far.
    """

    name: ClassVar[str] = "direction"
    unit: ClassVar[str] = "rad"

    @functools.cached_property
    def block(self) -> Block:
        """Error (2,), no unit, in the effector's axes, x and y."""
        return Block("direction")


@dataclass(frozen=True, eq=False)
class RollTask(CompiledTask):
    """Take the twist about the shaft out of the rotation from the desired effector to the own.

    With s = r_d* r = [w, x, y, z], of the two signs the one with w >= 0, the twist (of the
    swing-twist split) is phi = 2 atan2(z, w), in [-pi, pi]: the short way. From
    s' = (1/2) (s omega - omega_d s),

        phi' = 2 (w z' - z w') / (w^2 + z^2)
             = omega_z + ((x z - w y) omega_x + (w x + y z) omega_y) / (w^2 + z^2)
             - omega_d,z - ((x z + w y) omega_d,x + (y z - w x) omega_d,y) / (w^2 + z^2).

    Where the shafts point apart, w = z = 0, no roll is defined and nothing is asked.
    """

    name: ClassVar[str] = "roll"
    unit: ClassVar[str] = "rad"

    @functools.cached_property
    def block(self) -> Block:
        """Error (1,) [rad]; positive when turned too far about the shaft's z."""
        return Block("roll")


UNIT = 1e-6
"""How far the orientation may be from a unit quaternion."""


def _unit_quaternion(name: str, value: ArrayLike) -> ArrayLike:
    r = np.array(value, dtype=float)
    if r.shape != (4,) or not abs(float(np.linalg.norm(r)) - 1.0) <= UNIT:
        raise OptionError(f"{name} = {value!r}, it must be a unit quaternion, w first")
    return value


@dataclass(frozen=True, eq=False)
class OrientationTask(CompiledTask):
    """Hold the tool's orientation in the world, whatever the shaft does.

    With r_t the tool's rotation, r_h the one to hold and s = r_t r_h* = (w, u), of the two signs
    the one with w >= 0,

        e = 2 u = 2 sin(phi / 2) n,   de/dt = (w I - [u]x) omega_t,

    n the axis and phi the angle that the tool is off by, omega_t its angular velocity, all in the
    world's axes. made_for() holds the orientation of the start.

    Attributes:
        orientation: (4,) unit quaternion, w first, from the tool's axes to the world's.

    Raises:
        OptionError: it is no unit quaternion.
    """

    name: ClassVar[str] = "orientation"
    unit: ClassVar[str] = "rad"

    orientation: ArrayLike = field(metadata=rule(_unit_quaternion))

    @classmethod
    def made_for(cls, insertion: Insertion, **options: Any) -> Self:
        """The orientation at the start, unless another is given."""
        options.setdefault("orientation", dq.P(insertion.tool_start))
        return cls(**options)

    @functools.cached_property
    def block(self) -> Block:
        """Error (3,) [rad], in the world's axes."""
        return Block("orientation", orientation=np.array(self.orientation, dtype=float))


@dataclass(frozen=True, eq=False)
class PoseTask(CompiledTask):
    """Bring the effector to x_d by the dual-quaternion error of equation (3).

        e = vec(1 - x* x_d),   de/dt = -N v - vec(x* x_d'),   N = H-(x_d) C8 J_dq

    8 rows of rank 6 at most. Of x_d and -x_d, one pose, the one on x's side is taken, with
    its derivative. At x_d' = 0 the least-squares v on a level of its own is the paper's law
    K N^+ e.

    The error is out of N's range in second order: 1 - cos(phi / 2) of it is left when the pose
    is phi [rad] off, so only the pose tells whether the task is done on the way.
    """

    name: ClassVar[str] = "pose"

    damping: float | None = field(default=0.005, kw_only=True)

    @functools.cached_property
    def block(self) -> Block:
        """Error (8,), no unit for the rotation and [m] for half the translation."""
        return Block("pose")


@dataclass(frozen=True, eq=False)
class RcmTask(CompiledTask):
    """Keep the shaft on the trocar.

    With (R, p) the effector's placement and (nu, omega) its twist in its own axes, the trocar
    seen from the effector is r = R^T (pivot - p). The shaft is the effector's z axis: its distance
    to the trocar is the norm of r's first two coordinates, the error.

    The error is counted in axes that go along with the shaft and do not spin about it: a spin
    changes no distance, but in axes that spin it would turn the error, and so give a joint that
    only rolls the shaft an entry of the size of the RCM error, and a strict hierarchy would spend
    that joint on it. With omega_s = (omega_x, omega_y, 0),

        dr/dt = [r]x omega_s - nu + R^T pivot_dot.

    Two rows of rank 2 (Azimian, Patel and Naish 2010, in spirit) leave depth and the three
    rotations about the trocar to other tasks.

    A joint velocity that is held for T takes the trocar along a curve, T^2/2 d^2r/dt^2 off the
    tangent: an error of T/(2 K) d^2r/dt^2 that stays. With ``period`` the second derivative is
    taken into account, as it is while the joints go on at state.v:

        d^2r/dt^2 = [dr/dt + R^T pivot_dot]x omega_s + [r]x omega_s' - nu',

    with (nu', omega') the twist's change by the joints' motion alone, see kinematic_hessian(), in
    the same axes: nu' + omega_z e_z x nu, and likewise for omega. What is left is of third order.

    Attributes:
        period: sampling period T [s]; 0 for the first order only.
    """

    name: ClassVar[str] = "rcm"
    unit: ClassVar[str] = "m"

    period: float = field(default=0.0, metadata=at_least(0.0, "s"))
    damping: float | None = field(default=0.0, kw_only=True)

    @functools.cached_property
    def block(self) -> Block:
        """Error (2,) [m], the trocar in the effector's axes, x and y."""
        return Block("rcm", period=self.period)
