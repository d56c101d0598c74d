"""How far the shaft may tilt in the trocar."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rcmqp import _kernel
from rcmqp.limits.base import Constraint, Damper
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState
from rcmqp.world.instrument import Trocar

CENTRE = 1e-6
"""Sine of the angle below which the shaft is on the cone's axis, and tilts in no direction."""


@dataclass(frozen=True, eq=False)
class TrocarCone(Damper):
    """Keep the angle between the shaft and the trocar's axis below the cone's half angle.

    The trocar's axis seen from the effector, n = R^T axis, moves by n' = [n]x omega; the angle
    theta between n and e_z has

        theta' = (n_y omega_x - n_x omega_y) / sin theta <= pace(cone_half_angle - theta).

    On the axis the direction of a tilt is not defined and the row is zero: the first cycle away
    from there is free. Opposite to it, every direction is a way back, and x is taken.

    Attributes:
        trocar: its axis and half angle; the axis stays as it is when the trocar moves.
    """

    name: ClassVar[str] = "trocar_cone"

    trocar: Trocar

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        """One row [rad/s]."""
        x, y, z = (float(c) for c in state.oMe.rotation.T @ np.array(self.trocar.axis))
        sine = math.hypot(x, y)
        if sine > CENTRE:
            by_omega = np.array([[y / sine, -x / sine]])
        else:
            by_omega = np.array([[0.0 if z > 0.0 else 1.0, 0.0]])
        room = self.trocar.cone_half_angle - math.atan2(sine, z)
        row = by_omega @ state.J_local[3:5]
        return Constraint.rows(row, [self.pace(room)], self.row_names)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the one row."""
        return ("trocar cone",)

    def program(self) -> tuple[float, ...]:
        """For compiled code."""
        half_angle, axis = self.trocar.cone_half_angle, self.trocar.axis
        return (_kernel.TROCAR_CONE, self.gain, self.deceleration, half_angle, *axis)
