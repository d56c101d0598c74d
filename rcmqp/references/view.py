"""The view that the surgeon asks for, and the effector pose that shows it: equation (5)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import _kernel
from rcmqp.errors import InvalidCommand
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import ArmState, ToolAt


@dataclass(frozen=True, slots=True)
class ViewCommand:
    """A view, relative to the one at the start, and how fast it changes.

    The camera's image has x to the right and y down, and z looks into the patient. Turning
    left and right is then a rotation about y, up and down one about x.

    Attributes:
        alpha: left-right rotation [rad], about the camera's y; positive looks right.
        beta: up-down rotation [rad], about its x; positive looks up.
        gamma: rotation "around itself" [rad], about its z.
        t_z: in-out translation along the shaft [m]; positive goes in.
        alpha_dot, beta_dot, gamma_dot, t_z_dot: their rates [rad/s], [m/s].

    Raises:
        InvalidCommand: a value is not finite.
    """

    alpha: float = 0.0
    beta: float = 0.0
    gamma: float = 0.0
    t_z: float = 0.0
    alpha_dot: float = 0.0
    beta_dot: float = 0.0
    gamma_dot: float = 0.0
    t_z_dot: float = 0.0

    def __post_init__(self) -> None:
        total = self.alpha + self.beta + self.gamma + self.t_z
        total += self.alpha_dot + self.beta_dot + self.gamma_dot + self.t_z_dot
        if not math.isfinite(total) and not all(map(math.isfinite, astuple(self))):
            raise InvalidCommand(f"not finite: {self}; a view needs eight finite numbers")


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The desired effector pose, the trocar, and how both move.

    What the controller is told, made once a cycle and not checked here: a trocar that jumps by
    10 cm makes a reference that jumps along with it, and one that was not seen, NaN, makes one
    that is NaN. What to do then is the controller's to say.

    Attributes:
        x_d: (8,) unit dual quaternion.
        x_d_dot: (8,) its time derivative [1/s], as far as pivot_dot is known.
        pivot: (3,) the trocar in the world [m].
        pivot_dot: (3,) its velocity [m/s], as far as it is known.
    """

    x_d: Array
    x_d_dot: Array
    pivot: Array
    pivot_dot: Array


STILL: Array = np.zeros(3)
"""(3,): the velocity of a trocar at rest [m/s]."""
STILL.setflags(write=False)


@dataclass(frozen=True, slots=True, eq=False)
class Stamped:
    """A reference with the time at which it was made.

    Attributes:
        reference: what the controller is told.
        at: the time at which the reference was made, counted from the start of the loop [s].
    """

    reference: Reference
    at: float


def view_pose(x_rcm: ArrayLike, command: ViewCommand, pivot_dot: ArrayLike = STILL) -> Reference:
    """The effector pose of a view, equation (5), and its derivative.

        x_d = x_d(0) r_alpha r_beta r_gamma (1 + eps t_z / 2)

    Translation comes last, so the shaft passes through the trocar exactly. Read from left to
    right, each rotation is about the axes that the one before it has turned.

    Departures: section III-C writes r_x r_y r_z for r_alpha r_beta r_gamma. "Left-right" with
    respect to an image whose x axis points right is a rotation about y, "up-down" one about x:
    here r_alpha r_beta r_gamma = r_y r_x r_z.

    Args:
        x_rcm: (8,) x_d(0), the effector's pose at the start, moved along with the trocar.
        command: the view and its rates.
        pivot_dot: (3,) velocity of the trocar [m/s]; the reference moves with it.
    """
    reference = _kernel.view_pose(
        Reference,
        x_rcm,
        command.alpha,
        command.beta,
        command.gamma,
        command.t_z,
        command.alpha_dot,
        command.beta_dot,
        command.gamma_dot,
        command.t_z_dot,
        pivot_dot,
    )
    if reference is None:
        raise InvalidCommand(
            f"x_rcm has shape {np.shape(x_rcm)} and pivot_dot {np.shape(pivot_dot)}, they must be "
            "(8,) and (3,)"
        )
    return reference


def carried(x: Array, offset: Array) -> Array:
    """The pose x (8,) moved by ``offset`` (3,) [m] in the world's axes; x itself for zero."""
    return _kernel.carried(x, offset)


def view_of_tip(p: Iterable[float], p_dot: Iterable[float], tip_depth: float) -> ViewCommand:
    """The view, without roll, whose tip stands at ``p``; inverse of equation (5).

    Args:
        p: (3,) tip seen from the trocar, in the axes of x_d(0) [m]; p[2] > 0 is inside.
        p_dot: (3,) its velocity [m/s].
        tip_depth: how far the tip was inside at the start [m].

    Raises:
        InvalidCommand: p is not finite, or lies in the plane of the trocar or outside.
    """
    px, py, pz = map(float, p)
    vx, vy, vz = map(float, p_dot)
    if not pz > 0.0:
        raise InvalidCommand(f"tip at z = {pz} m from the trocar; it must be inside, z > 0")
    h = math.hypot(px, pz)
    d = math.hypot(h, py)
    h_dot = (px * vx + pz * vz) / h
    return ViewCommand(
        alpha=math.atan2(px, pz),
        beta=-math.atan2(py, h),
        t_z=d - tip_depth,
        alpha_dot=(pz * vx - px * vz) / h**2,
        beta_dot=(py * h_dot - h * vy) / d**2,
        t_z_dot=(h * h_dot + py * vy) / d,
    )


def view_of_pose(x_rcm: ArrayLike, x: ArrayLike) -> ViewCommand:
    """The view nearest to a pose: inverse of equation (5), at rest.

    Args:
        x_rcm: (8,) x_d(0), the effector's pose at the start.
        x: (8,) the effector's pose now, tilted by less than 90 degrees from it.
    """
    rcmMe = dq.to_se3(x_rcm).actInv(dq.to_se3(x))
    R, axis = rcmMe.rotation, rcmMe.rotation[:, 2]
    return ViewCommand(
        alpha=math.atan2(axis[0], axis[2]),
        beta=-math.asin(max(-1.0, min(1.0, axis[1]))),
        gamma=math.atan2(R[1, 0], R[1, 1]),
        t_z=float(rcmMe.translation @ axis),
    )


Cycle: TypeAlias = tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array, ToolAt]
"""Arrays of a state and a reference, in the order in which compiled code takes them."""


def cycle(state: ArmState, reference: Reference) -> Cycle:
    """The numbers of a state and a reference, for compiled code."""
    return (
        state.x,
        state.J_local,
        state.angles,
        state.v,
        state.a,
        reference.x_d,
        reference.x_d_dot,
        reference.pivot,
        reference.pivot_dot,
        state.tool_at,
    )
