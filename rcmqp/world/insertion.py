"""The instrument in the patient: arm, instrument, trocar and starting configuration."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rcmqp.errors import InsertionError, OptionError, TrocarOffShaft
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm import Arm, ArmState
from rcmqp.world.instrument import Instrument, Trocar, Vector3, vector3
from rcmqp.world.obstacles import Sphere
from rcmqp.world.wrist import with_wrist

SHAFT_TOLERANCE = 1e-6
"""How far the trocar may lie off the shaft's axis at the start [m]."""


class Insertion:
    """An arm whose effector is the point of the shaft that lies on the trocar at the start.

    Section III of the paper: that point, z along the shaft, is the end effector, and its
    placement at the start is x_d(0), which is also x_rcm of equation (7).

    Attributes:
        arm: the arm, its effector on the shaft; with the joints of the instrument's wrist, if any.
        bare: the arm that was given.
        instrument: the endoscope.
        trocar: the incision.
        angles_start: (nv,) joint angles at the start [rad].
        q_start: (nq,) the same as Pinocchio's configuration.
        tool_start: (8,) pose of the tool in the world at the start.
        x_rcm: (8,) x_d(0): at the pivot, turned as the shaft is at the start.
        tip_depth: how far the tip is beyond the trocar at the start [m].
        trocar_offset: how far the trocar is off the shaft's axis at the start [m]. The effector
            is the point of the shaft nearest to it, and x_rcm lies beside the effector by that
            much: going to x_rcm brings the shaft back.
        tolerance: how far the trocar may lie off the shaft's axis at the start [m].
        obstacles: what the instrument is to keep out of.
    """

    def __init__(
        self,
        arm: Arm,
        instrument: Instrument,
        trocar: Trocar,
        angles_start: ArrayLike,
        *,
        tolerance: float = SHAFT_TOLERANCE,
        obstacles: Sequence[Sphere] = (),
    ) -> None:
        """Put the instrument through the trocar.

        Args:
            arm: its flange carries the instrument.
            instrument: the endoscope.
            trocar: the incision.
            angles_start: (nv,) joint angles at the start [rad]; a wrist's may be left out, and it
                starts straight.
            tolerance: how far the trocar may lie off the shaft's axis [m].
            obstacles: what the instrument is to keep out of.

        Raises:
            JointLimitViolated: a joint starts outside its limits.
            TrocarOffShaft: the shaft passes the trocar at a distance.
            InsertionError: the trocar is not between the shaft's ends, the tip is outside the
                trocar's depth range, or the shaft outside its cone.
        """
        self.bare, arm = arm, with_wrist(arm, instrument)
        angles_start = np.asarray(angles_start, dtype=float)
        if arm.wrist is not None and angles_start.size == arm.nv - len(arm.wrist.joints):
            angles_start = np.concatenate([angles_start, np.zeros(len(arm.wrist.joints))])
        arm.check_limits(angles_start)
        mount = arm.with_effector(instrument.mount.placement)
        q_start = arm.configuration(angles_start)
        oMm = mount.state(q_start).oMe
        pivot = np.array(trocar.pivot)
        seen = oMm.actInv(pivot)
        self.tolerance, self.trocar_offset = tolerance, float(np.hypot(seen[0], seen[1]))
        if self.trocar_offset > tolerance:
            raise TrocarOffShaft(self.trocar_offset, tolerance)
        along = float(seen[2])
        _check_depth(instrument, trocar, along)
        _check_tilt(trocar, oMm.rotation[:, 2])
        self.arm = arm.with_effector(instrument.on_shaft(along), instrument.tip - along)
        self.instrument, self.trocar, self.obstacles = instrument, trocar, tuple(obstacles)
        self.tip_depth = instrument.tip - along
        tool = self.arm.state(q_start).tool.oMt
        self.tool_start = dq.from_se3(tool)
        aside = float(np.linalg.norm(oMm.actInv(tool.translation) - [0.0, 0.0, instrument.tip]))
        if aside > SHAFT_TOLERANCE:
            raise InsertionError(
                f"the tool starts {1e3 * aside:.1f} mm from where a straight wrist has it; give "
                "start angles with the wrist straight, or none for it"
            )
        self.angles_start, self.q_start = arm.angles(q_start), q_start
        self.x_rcm = dq.from_se3(pin.SE3(oMm.rotation, pivot))
        for array in (self.angles_start, self.q_start, self.x_rcm, self.tool_start):
            array.setflags(write=False)

    @classmethod
    def on_shaft(
        cls,
        arm: Arm,
        instrument: Instrument,
        angles_start: ArrayLike | None = None,
        *,
        depth: float = 0.1,
    ) -> Insertion:
        """Put the trocar where the shaft is: ``depth`` [m] before the tip, axis along the shaft.

        Without ``angles_start`` the arm starts at its home.
        """
        angles = arm.home if angles_start is None else angles_start
        whole = with_wrist(arm, instrument) if np.size(angles) != arm.nv else arm
        mount = whole.with_effector(instrument.mount.placement)
        oMm = mount.state(whole.configuration(angles)).oMe
        pivot = oMm.act(np.array([0.0, 0.0, instrument.tip - depth]))
        return cls(arm, instrument, Trocar(tuple(pivot), tuple(oMm.rotation[:, 2])), angles)

    def state(
        self, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None
    ) -> ArmState:
        """One kinematics pass at ``q`` (nq,), with ``v`` and ``a`` (nv,); see Arm.state()."""
        return self.arm.state(q, v, a)

    def check_reach(self, t: float, t_z: float) -> None:
        """Refuse a view at ``t`` [s] that is ``t_z`` [m] deeper than the start.

        Raises:
            InsertionError: it is deeper than the shaft is long.
        """
        depth = self.tip_depth + t_z
        length = self.instrument.tip - self.instrument.mount_offset
        if depth > length:
            raise InsertionError(
                f"at t = {t:.6g} s the view asks for the tip {1e3 * depth:.1f} mm inside, the "
                f"instrument is only {1e3 * length:.1f} mm long; make the path shallower or the "
                "shaft longer"
            )

    def check_camera_on_shaft(self, what: str) -> None:
        """Refuse an instrument whose camera, or tool, a wrist moves; ``what`` is for others.

        Raises:
            OptionError: it has a wrist.
        """
        if self.arm.wrist is not None:
            raise OptionError(
                f"{what} is for a camera that is fixed to the shaft; this instrument has a wrist"
            )

    def from_start(self, vector: Sequence[float]) -> Vector3:
        """A vector (3,) in the axes of x_d(0), in those of the world.

        z is along the shaft, into the patient; x and y are to the right and down in the image.
        """
        return vector3("vector", dq.rotate(dq.P(self.x_rcm), vector))

    def tip(self, x: ArrayLike) -> Array:
        """Tip (..., 3) in the world [m] for effector poses x (..., 8), of a straight wrist."""
        return dq.place(x, (0.0, 0.0, self.tip_depth))

    def depth(self, x: ArrayLike, pivot: ArrayLike) -> Array:
        """How far (...) that tip is beyond the pivot (..., 3) [m], along the shaft."""
        seen = dq.rotate(dq.quaternion_conj(dq.P(x)), np.asarray(pivot) - dq.translation(x))
        return np.asarray(self.tip_depth - seen[..., 2])


def rcm_error(x: ArrayLike, pivot: ArrayLike) -> Array:
    """Distance (...) from the pivot (..., 3) to the shaft's axis [m], for effectors x (..., 8)."""
    r_conj = dq.quaternion_conj(dq.P(x))
    seen = dq.rotate(r_conj, np.asarray(pivot) - dq.translation(x))
    return np.asarray(np.hypot(seen[..., 0], seen[..., 1]))


def tilt(x: ArrayLike, axis: ArrayLike) -> Array:
    """Angle (...) [rad] of the shaft from a unit vector (3,) in the world, effectors (..., 8)."""
    seen = dq.rotate(dq.quaternion_conj(dq.P(x)), axis)
    return np.asarray(np.arctan2(np.hypot(seen[..., 0], seen[..., 1]), seen[..., 2]))


def _check_depth(instrument: Instrument, trocar: Trocar, along: float) -> None:
    depth = instrument.tip - along
    low, high = trocar.depth_range
    if along < instrument.mount_offset:
        raise InsertionError(
            f"the tip would be {1e3 * depth:.1f} mm inside, the shaft is only "
            f"{1e3 * instrument.length:.1f} mm long; choose a smaller depth"
        )
    if not low <= depth <= high:
        raise InsertionError(
            f"the tip starts {1e3 * depth:.1f} mm beyond the trocar, its depth range is "
            f"[{1e3 * low:.1f}, {1e3 * high:.1f}] mm"
        )


def _check_tilt(trocar: Trocar, shaft: Array) -> None:
    angle = math.acos(min(1.0, max(-1.0, float(shaft @ np.array(trocar.axis)))))
    if angle > trocar.cone_half_angle:
        raise InsertionError(
            f"the shaft starts {math.degrees(angle):.1f} deg from the trocar's axis, its cone "
            f"allows {math.degrees(trocar.cone_half_angle):.1f} deg; turn the axis (it points "
            "into the patient) or widen the cone"
        )


def filled_in(
    cls: type, insertion: Insertion, options: Mapping[str, Any], **more: Any
) -> dict[str, Any]:
    """Options of a dataclass: those given, and those that the insertion or ``more`` has by name.

    Raises:
        OptionError: an option without a default is still missing.
    """
    known = more | {
        "arm": insertion.arm,
        "instrument": insertion.instrument,
        "trocar": insertion.trocar,
        "wrist": insertion.arm.wrist,
    }
    fields = [item for item in dataclasses.fields(cls) if item.init]
    found = {item.name: known[item.name] for item in fields if item.name in known}
    found.update(options)
    missing = [
        item.name
        for item in fields
        if item.name not in found and item.default is item.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise OptionError(f"{cls.__name__} needs {' and '.join(missing)}; give a value for each")
    return found
