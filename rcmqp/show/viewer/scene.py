"""The scene of a run: the arm's links as Meshcat's commands, and what stands around it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
import umsgpack

from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.paths import Shows
from rcmqp.references.view import ViewCommand, view_of_tip, view_pose
from rcmqp.runs.run import Run
from rcmqp.show.labels import SPHERES
from rcmqp.show.viewer.meshcat_ import SetTransform, TreePath
from rcmqp.show.viewer.shapes import arm_parts
from rcmqp.world.arm import Arm
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Instrument, Vector3, vector3
from rcmqp.world.obstacles import Sphere


def kinematics(arm: Arm, q: Array) -> dict[str, Any]:
    """Kinematics for the page: the joints of the arm, and where the flange is.

    A joint at angle a moves its link to placement * exp(a (linear, angular)), seen from the link
    before; ``linear`` and ``angular`` (3,) are the joint's axis, one of them zero. The flange is
    on joint ``flange_joint``, counted from 1; joints beyond are those of the instrument's wrist.

    Args:
        arm: its effector at the flange.
        q: (nq,) any configuration: the flange's placement on the last link is found there.
    """
    model, angles = arm.model, arm.angles(q)
    joints, oMi = [], [pin.SE3.Identity()]
    for i in range(1, model.njoints):
        S = np.asarray(model.joints[i].createData().S).ravel()
        oMi.append(oMi[-1] * model.jointPlacements[i] * pin.exp6(angles[i - 1] * S))
        joints.append(
            {
                "name": model.names[i],
                "placement": _columns(model.jointPlacements[i].homogeneous),
                "linear": S[:3].tolist(),
                "angular": S[3:].tolist(),
            }
        )
    return {
        "joints": joints,
        "flange": _columns(oMi[arm.last_joint].actInv(arm.state(q).oMe).homogeneous),
        "flange_joint": arm.last_joint,
    }


def commands(arm: Arm) -> tuple[list[bytes], list[dict[str, Any]]]:
    """Meshcat's commands that build the arm at /run0, and the parts with paths and colours.

    Links are nested as the joints are: /run0/joint1/joint2/...
    """
    packed, about = [], []
    for k, part in enumerate(arm_parts(arm)):
        joints = [f"joint{i + 1}" for i in range(part.joint)]
        path = TreePath(("run0", *joints, f"part{k}"))
        packed.append({"type": "set_object", "object": part.data, "path": path.lower()})
        packed.append(SetTransform(part.placement, path).lower())
        about.append({"path": ["run0", *joints, f"part{k}"], "colour": part.colour})
    return [umsgpack.packb(_plain(command)) for command in packed], about


def surroundings(run: Run, insertion: Insertion) -> dict[str, Any]:
    """Instrument, trocar, limits, obstacles and targets of a run, in the world [m], [rad]."""
    scenario, trocar = run.scenario, run.scenario.trocar
    instrument = scenario.instrument
    return {
        "pivot": list(trocar.pivot),
        "axis": list(trocar.axis),
        "cone_half_angle": trocar.cone_half_angle,
        "depth_range": list(trocar.depth_range),
        "instrument": {
            "length": instrument.length,
            "radius": instrument.radius,
            "mount_offset": instrument.mount_offset,
            "mount": _columns(instrument.mount.placement.homogeneous),
            "field_of_view": instrument.camera.field_of_view,
            "angle": instrument.camera.angle,
            "roll": instrument.camera.roll,
            "wrist": _segments(instrument),
        },
        "obstacles": [
            {"centre": list(sphere.centre), "radius": sphere.radius}
            for sphere in scenario.obstacles
        ],
        "targets": targets(run, insertion).tolist(),
        "spheres": [
            {"centre": list(sphere.centre), "radius": sphere.radius, "colour": colour}
            for sphere, colour in zip(spheres(run, insertion), SPHERES, strict=False)
        ],
        "skeleton": insertion.arm.skeleton(run.q[0]).tolist(),
        "deepest": _deepest(run, insertion),
    }


def _segments(instrument: Instrument) -> list[float]:
    """From each joint of the wrist to the next, and from the last one to the tool [m]."""
    wrist = instrument.wrist
    return [] if wrist is None else [*(each.along for each in wrist.joints[1:]), wrist.tool]


def targets(run: Run, insertion: Insertion) -> Array:
    """Tips (m, 3) that the path has as targets, see Shows; they move with the trocar [m]."""
    path = run.scenario.path
    points = path.targets(insertion.tip_depth) if isinstance(path, Shows) else ()
    return _from_trocar(run, insertion, points)


def spheres(run: Run, insertion: Insertion) -> list[Sphere]:
    """Spheres that the path asks to be shown, see Shows; they move with the trocar [m]."""
    path = run.scenario.path
    asked = path.spheres if isinstance(path, Shows) else ()
    centres = _from_trocar(run, insertion, [sphere.centre for sphere in asked])
    return [
        Sphere(vector3("centre", centre), sphere.radius)
        for centre, sphere in zip(centres, asked, strict=True)
    ]


def camera_moves(places: Sequence[Vector3], insertion: Insertion) -> list[list[float]]:
    """Matrices (4, 4), column by column, that move the camera from its start to each place.

    They are in the world; the camera does not roll.

    Args:
        places: (m, 3) where the tip goes, seen from the trocar in the axes of x_d(0) [m].
        insertion: the instrument in the patient.
    """
    start = dq.to_se3(view_pose(insertion.x_rcm, ViewCommand()).x_d)
    asked = [view_of_tip(place, (0.0, 0.0, 0.0), insertion.tip_depth) for place in places]
    poses = [dq.to_se3(view_pose(insertion.x_rcm, view).x_d) for view in asked]
    return [_columns((pose * start.inverse()).homogeneous) for pose in poses]


def _from_trocar(run: Run, insertion: Insertion, points: Sequence[Vector3]) -> Array:
    """Points (m, 3) seen from the trocar in the axes of x_d(0), in the world [m]."""
    turned = np.array([insertion.from_start(point) for point in points]).reshape(-1, 3)
    return turned + run.scenario.trocar.pivot


def _deepest(run: Run, insertion: Insertion) -> float:
    """Largest distance of tips and spheres from the trocar [m]; missing tips do not count."""
    pivot = np.array(run.scenario.trocar.pivot)
    tips = np.concatenate([run.tip - run.pivot, run.tip_d - run.pivot])
    centres = [np.subtract(sphere.centre, pivot) for sphere in spheres(run, insertion)]
    return float(np.nanmax(np.linalg.norm(np.vstack([tips, *centres]), axis=1)))


def _columns(matrix: Array) -> list[float]:
    """A (4, 4) matrix as three.js takes it, column after column."""
    return [float(x) for x in matrix.T.ravel()]


def _plain(data: Any) -> Any:
    """Numpy's numbers as Python's, which msgpack knows."""
    if isinstance(data, dict):
        return {key: _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    return data.item() if isinstance(data, np.generic) else data
