"""What the surgeon asks of the camera, and the effector pose that shows it: equation (5)."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import ArrayLike

from rcmqp import dualquaternion as dq
from rcmqp.dualquaternion import Array
from rcmqp.errors import InvalidCommand


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
        """Refuse what is not a number."""
        if not all(map(math.isfinite, astuple(self))):
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
    sa, ca = math.sin(command.alpha / 2), math.cos(command.alpha / 2)
    sb, cb = math.sin(command.beta / 2), math.cos(command.beta / 2)
    sg, cg = math.sin(command.gamma / 2), math.cos(command.gamma / 2)
    w, x, y, z = ca * cb, ca * sb, sa * cb, -sa * sb  # r_alpha r_beta
    r = (w * cg - z * sg, x * cg + y * sg, y * cg - x * sg, z * cg + w * sg)
    h = command.t_z / 2
    local = np.array([*r, -h * r[3], h * r[2], -h * r[1], h * r[0]])  # r (1 + eps k t_z / 2)
    x_d = dq.H8_plus(x_rcm) @ local

    # Angular velocity in the effector's axes: alpha about y, seen after beta and gamma; beta
    # about x, seen after gamma; gamma about z.
    s, c = math.sin(command.beta), math.cos(command.beta)
    u, n = command.beta_dot, command.alpha_dot * c
    sin_g, cos_g = math.sin(command.gamma), math.cos(command.gamma)
    omega = (
        u * cos_g + n * sin_g,
        n * cos_g - u * sin_g,
        command.gamma_dot - s * command.alpha_dot,
    )
    nu = (omega[1] * command.t_z, -omega[0] * command.t_z, command.t_z_dot)
    pivot_dot = np.asarray(pivot_dot, dtype=float)
    return Reference(x_d, pose_rate(x_d, omega, nu, pivot_dot), dq.translation(x_rcm), pivot_dot)


def pose_rate(x: Array, omega: ArrayLike, nu: ArrayLike, drift: Array) -> Array:
    """Time derivative (8,) of a pose x (8,) that turns, moves and is carried along.

    Args:
        x: (8,) the pose.
        omega: (3,) angular velocity in its own axes [rad/s].
        nu: (3,) linear velocity in its own axes [m/s].
        drift: (3,) velocity in the world's axes [m/s] that comes on top.
    """
    x_dot = 0.5 * dq.mul(x, np.array([0.0, *np.asarray(omega), 0.0, *np.asarray(nu)]))
    x_dot[4:] += 0.5 * dq.quaternion_mul([0.0, *drift], dq.P(x))
    return x_dot


def carried(x: Array, offset: Array) -> Array:
    """The pose x (8,) moved by ``offset`` (3,) [m] in the world's axes; x itself for zero."""
    if not offset.any():
        return x
    moved = x.copy()
    moved[4:] += 0.5 * dq.quaternion_mul([0.0, *offset], dq.P(x))
    return moved


def view_of_tip(p: ArrayLike, p_dot: ArrayLike, tip_depth: float) -> ViewCommand:
    """The view, without roll, whose tip stands at ``p``; inverse of equation (5).

    Args:
        p: (3,) tip seen from the trocar, in the axes of x_d(0) [m]; p[2] > 0 is inside.
        p_dot: (3,) its velocity [m/s].
        tip_depth: how far the tip was inside at the start [m].

    Raises:
        InvalidCommand: p is not finite, or lies in the plane of the trocar or outside.
    """
    px, py, pz = (float(value) for value in np.asarray(p, dtype=float))
    vx, vy, vz = (float(value) for value in np.asarray(p_dot, dtype=float))
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
