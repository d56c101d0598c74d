"""The work that every package does: an endoscope in a Panda's trocar, its tip on a circle."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

import rcmqp
from rcmqp.maths.dualquaternion import Array, align_sign, from_se3, to_se3
from rcmqp.maths.smooth import step
from rcmqp.references.view import ViewCommand, view_of_tip
from rcmqp.world.insertion import rcm_error

ARM = "panda"
PERIOD = 1e-3  # [s]
DEPTH = 0.10  # of the tip at the start [m]
RADIUS = 0.02  # of the circle [m]
PLUNGE = 0.01  # the depth goes up and down by this [m]
TURN = 2.0  # time of a turn [s]
RAMP = 0.5  # how long it takes to get going [s]


@dataclass(frozen=True)
class Accuracy:
    """How far the joints that a package answered are from what was asked, start-up included.

    Attributes:
        tip_rms_mm: distance of the tip from where it should be.
        rcm_max_mm: distance of the trocar from the shaft's axis.
        speed_max, acceleration_max: largest joint speed and acceleration over their limits.
    """

    tip_rms_mm: float
    rcm_max_mm: float
    speed_max: float
    acceleration_max: float


class Workload:
    """What is asked in each of ``cycles`` cycles, and how well it was done.

    The input of rcmqp is the view at the cycle's start, with its rates; that of the others is
    the tip's position or pose at the cycle's end, which is what they bring the arm to.
    """

    def __init__(self, cycles: int) -> None:
        self.insertion = rcmqp.Insertion.on_shaft(
            rcmqp.load_arm(ARM), rcmqp.Instrument(), depth=DEPTH
        )
        self.cycles = cycles
        self.views = [_view(k * PERIOD) for k in range(cycles + 1)]
        self.tips = [self._tip(view) for view in self.views]

    def save(self, folder: Path) -> Path:
        """Write workload.npz, and the URDF that the others load, for processes to read."""
        urdf, insertion = folder / "panda.urdf", self.insertion
        arm = insertion.arm
        _write_urdf(urdf, insertion)
        path = folder / "workload.npz"
        np.savez(
            path,
            urdf=str(urdf),
            period=PERIOD,
            depth=DEPTH,
            q_start=insertion.q_start,
            views=np.array([astuple(view) for view in self.views]),
            tips=np.array([tip.homogeneous for tip in self.tips]),
            tips_dq=_continuous([from_se3(tip) for tip in self.tips]),
            pivot=np.array(insertion.trocar.pivot),
            lower=arm.lower,
            upper=arm.upper,
            velocity=arm.velocity,
            acceleration=arm.acceleration,
        )
        return path

    def accuracy(self, q: Array) -> Accuracy:
        """Of joint angles (cycles, nv), each taken after its cycle's step."""
        insertion, n = self.insertion, len(q)
        x = np.array([insertion.state(angles).x for angles in q])
        tips = np.array([tip.translation for tip in self.tips[1 : n + 1]])
        tip_error = np.linalg.norm(insertion.tip(x) - tips, axis=-1)
        v = np.diff(q, axis=0, prepend=insertion.q_start[None]) / PERIOD
        a = np.diff(v, axis=0, prepend=np.zeros((1, v.shape[1]))) / PERIOD
        return Accuracy(
            tip_rms_mm=1e3 * float(np.sqrt(np.mean(tip_error**2))),
            rcm_max_mm=1e3 * float(rcm_error(x, insertion.trocar.pivot).max()),
            speed_max=float(np.max(np.abs(v) / insertion.arm.velocity)),
            acceleration_max=float(np.max(np.abs(a) / insertion.arm.acceleration)),
        )

    def _pose(self, view: ViewCommand) -> Array:
        return rcmqp.view_pose(self.insertion.x_rcm, view).x_d

    def _tip(self, view: ViewCommand) -> pin.SE3:
        shaft = pin.SE3(np.eye(3), np.array([0.0, 0.0, self.insertion.tip_depth]))
        return to_se3(self._pose(view)) * shaft


def _view(t: float) -> ViewCommand:
    """The view at ``t`` [s]: a circle of the tip that gathers speed, and goes in and out."""
    share, rate = _phase(t)
    phase, phase_dot = 2.0 * math.pi * share, 2.0 * math.pi * rate
    sin, cos = math.sin(phase), math.cos(phase)
    p = np.array([RADIUS * (cos - 1.0), RADIUS * sin, DEPTH + PLUNGE * sin])
    p_dot = phase_dot * np.array([-RADIUS * sin, RADIUS * cos, PLUNGE * cos])
    return view_of_tip(p, p_dot, DEPTH)


def _phase(t: float) -> tuple[float, float]:
    """Turns made at ``t`` [s], and turns per second."""
    u = min(t / RAMP, 1.0)
    ramped = RAMP * u**4 * (2.5 - 3.0 * u + u**2)  # integral of step(u)
    return (ramped + max(t - RAMP, 0.0)) / TURN, step(u)[0] / TURN


def _continuous(poses: list[Array]) -> Array:
    """Poses (n, 8) with signs such that each is on the side of the one before."""
    found = poses[:1]
    for x in poses[1:]:
        found.append(align_sign(x, found[-1]))
    return np.array(found)


def _write_urdf(path: Path, insertion: rcmqp.Insertion) -> None:
    """The arm's URDF without meshes, fingers fixed, with links ``tip`` and ``trocar``."""
    arm = insertion.arm
    assert arm.urdf is not None
    root = ET.parse(arm.urdf).getroot()
    for link in root.iter("link"):
        for child in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(child)
    for joint in root.iter("joint"):
        if joint.get("type") not in ("fixed", None) and joint.get("name") not in arm.joints:
            joint.set("type", "fixed")
            for name in ("axis", "limit", "mimic", "dynamics", "safety_controller"):
                for child in joint.findall(name):
                    joint.remove(child)
    for joint in root.iter("joint"):  # placo would narrow the limits by these
        for child in joint.findall("safety_controller"):
            joint.remove(child)
    base = next(iter(root.iter("link"))).get("name", "")
    _add_link(root, "tip", arm.flange, [0.0, 0.0, insertion.instrument.tip])
    _add_link(root, "trocar", base, list(insertion.trocar.pivot))
    mujoco = ET.SubElement(root, "mujoco")  # read by MuJoCo alone
    ET.SubElement(mujoco, "compiler", fusestatic="false", boundmass="0.01", boundinertia="0.001")
    ET.ElementTree(root).write(path)


def _add_link(root: ET.Element, name: str, parent: str, xyz: list[float]) -> None:
    ET.SubElement(root, "link", name=name)
    joint = ET.SubElement(root, "joint", name=f"{name}_joint", type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=name)
    ET.SubElement(joint, "origin", xyz=" ".join(map(repr, map(float, xyz))), rpy="0 0 0")
