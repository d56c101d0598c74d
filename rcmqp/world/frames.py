"""The two frames of an instrument: its shaft, by depth, and its tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rcmqp.maths.dualquaternion import Array


@dataclass(frozen=True, slots=True, eq=False)
class Shaft:
    """The shaft at one configuration.

    Attributes:
        oMe: placement of the effector in the world, z along the shaft.
        J_local: (6, nv) twist of the effector per joint velocity, in its own axes.
        v: (nv,) joint velocity [rad/s].
        tip: depth of the tip beyond the effector, where a wrist is straight [m].
    """

    oMe: pin.SE3
    J_local: Array
    v: Array
    tip: float

    def point(self, depth: float) -> Array:
        """The point (3,) ``depth`` [m] beyond the effector, along the shaft, in the world [m]."""
        return np.asarray(self.oMe.act(np.array([0.0, 0.0, depth])))

    def jacobian(self, depth: float) -> Array:
        """Jacobian (3, nv) of that point, in the world's axes [m]."""
        nu, omega = self.J_local[:3], self.J_local[3:]
        lever = pin.skew(np.array([0.0, 0.0, depth]))
        return np.asarray(self.oMe.rotation @ (nu - lever @ omega))

    def velocity(self, depth: float) -> Array:
        """Velocity (3,) of that point, in the world's axes [m/s]."""
        return np.asarray(self.jacobian(depth) @ self.v)


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """The tool at one configuration: the tip of a straight shaft, or what a wrist carries.

    Attributes:
        oMt: placement of the tool in the world, z out of it.
        J_local: (6, nv) twist of the tool per joint velocity, in its own axes.
    """

    oMt: pin.SE3
    J_local: Array
