"""MuJoCo's MJCF as a URDF: MuJoCo reads the file, what it compiles is written down.

Its size is checked before, with includes and replicates.
"""

from __future__ import annotations

import importlib
import math
import os
import warnings
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from rcmqp.errors import ArmError, ArmWarning
from rcmqp.maths.dualquaternion import Array
from rcmqp.world.arm_limits import SPEED, STROKE_SPEED
from rcmqp.world.urdf_checks import MOST_LINKS, check_xml

DRAWN = 3
"""Groups of geoms below this are drawn, as MuJoCo's viewer does."""

TYING = ("joint", "connect", "weld")
"""Elements of <equality> that take freedom from joints."""

COUNTED = ("body", "joint", "freejoint", "site")
"""Elements of <worldbody> that become links."""


def urdf_from_mjcf(path: Path) -> bytes:
    """The URDF of an MJCF: bodies and sites are links, and the joints have MuJoCo's zero.

    MuJoCo follows includes, defaults and angles of any kind. A body has a link for each of its
    joints, and its own one on the last. Position limits are the joints' ranges, efforts their
    force ranges. Speed limits are those of velocity actuators; of other joints SPEED is written,
    and marked as assumed. Joints that an active <equality> ties by a joint, connect or weld are
    marked, and loading refuses those that move the flange; equalities of tendons and flexes are
    not looked at, nor are those of other joints, which are held at zero. Meshes keep their files;
    one that is not there is left out.

    Raises:
        ArmError: MuJoCo is not installed, or refuses the file; the file has too many bodies,
            joints and sites; or a joint is of a kind that an arm does not have.
    """
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ModuleNotFoundError as error:
        raise ArmError(
            f"{path} is MuJoCo's MJCF, and the package mujoco is not installed: pip install "
            "'rcmqp[mjcf]'; or give the arm's URDF, which its maker has"
        ) from error
    check_size(path)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        _lighten(spec, path)
        compiled = spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise ArmError(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}") from error
    check_count(compiled.nbody + compiled.njnt + compiled.nsite, path)
    return _Writer(mujoco, spec, compiled, path).text()


def _lighten(spec: Any, path: Path) -> None:
    """Take out what has no part in the kinematics and may be missing: textures, lost meshes."""
    spec.compiler.fusestatic = False  # it would take the flange's body away
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-9
    files = {mesh.name: _mesh_file(spec, mesh) for mesh in spec.meshes}
    lost = {name: file for name, file in files.items() if not (path.parent / file).is_file()}
    if lost:
        names = ", ".join(lost.values())
        warnings.warn(f"{path} is drawn without {names}: no such mesh", ArmWarning, stacklevel=1)
    for geom in spec.geoms:
        geom.material = ""
    geoms = [geom for geom in spec.geoms if geom.meshname in lost or geom.hfieldname]
    meshes = [mesh for mesh in spec.meshes if mesh.name in lost]
    more = (*spec.pairs, *spec.materials, *spec.textures, *spec.skins, *spec.keys, *spec.hfields)
    for each in (*more, *geoms, *meshes):
        spec.delete(each)


def _mesh_file(spec: Any, mesh: Any) -> str:
    """The mesh's file from the folder of the MJCF."""
    return Path(spec.compiler.meshdir, mesh.file).as_posix()


class _Writer:
    """Writes a compiled model down as a URDF."""

    def __init__(self, mujoco: Any, spec: Any, model: Any, path: Path) -> None:
        self.mujoco, self.spec, self.model, self.path = mujoco, spec, model, path
        self.root = ET.Element("robot", name=spec.modelname or path.stem)
        self.links: dict[str, ET.Element] = {}
        self.tied = _tied(mujoco, model)

    def text(self) -> bytes:
        m = self.model
        names = [self._link(m.body(i).name or f"body{i}") for i in range(m.nbody)]
        for i in range(1, m.nbody):
            parent, place = names[m.body_parentid[i]], _placement(m.body_pos[i], m.body_quat[i])
            first, count = m.body_jntadr[i], m.body_jntnum[i]
            for j in range(first, first + count):
                parent, place = self._joint(j, parent, place)
            self._fixed(parent, names[i], place)
        for i in range(m.nsite):
            place = _placement(m.site_pos[i], m.site_quat[i])
            site = self._link(m.site(i).name or f"site{i}", " (site)")
            self._fixed(names[m.site_bodyid[i]], site, place)
        for i in range(m.ngeom):
            self._geom(i, names[m.geom_bodyid[i]])
        return ET.tostring(self.root)

    def _link(self, name: str, more: str = "") -> str:
        """A new link; ``more`` is added to a name that another link has."""
        while name in self.links:
            name += more or "_"
        self.links[name] = ET.SubElement(self.root, "link", name=name)
        return name

    def _joint(self, j: int, parent: str, place: pin.SE3) -> tuple[str, pin.SE3]:
        """Write a joint; the link that it moves, and where its body is seen from there."""
        m, kinds = self.model, self.mujoco.mjtJoint
        name, hinge = m.joint(j).name or f"joint{j}", m.jnt_type[j] == int(kinds.mjJNT_HINGE)
        if m.jnt_type[j] == int(kinds.mjJNT_FREE):  # of something that lies about, or of the base
            link = self._link(f"{name}_link")
            self._between(name, "floating", parent, link, place)
            return link, pin.SE3.Identity()
        if m.jnt_type[j] == int(kinds.mjJNT_BALL):
            raise ArmError(
                f"{self.path}: joint {name!r} is a ball joint; only arms of hinges and slides can "
                "be used: take the joint out, so that its body is fixed"
            )
        limited = bool(m.jnt_limited[j])
        if not (hinge or limited):
            raise ArmError(f"{self.path}: joint {name!r} slides without a range; give it one")
        anchor, axis = pin.SE3(np.eye(3), m.jnt_pos[j]), m.jnt_axis[j]
        zero = m.qpos0[m.jnt_qposadr[j]]  # where the bodies stand as the file has them
        back = pin.exp6(-zero * np.concatenate([0.0 * axis, axis] if hinge else [axis, 0 * axis]))
        kind = ("revolute" if limited else "continuous") if hinge else "prismatic"
        link = self._link(f"{name}_link")
        joint = self._between(name, kind, parent, link, place * anchor * back)
        if j in self.tied:
            joint.set("equality", self.tied[j])
        ET.SubElement(joint, "axis", xyz=_numbers(axis))
        speed, effort = self._actuated(j)
        assumed = SPEED if hinge else STROKE_SPEED
        known = {"effort": repr(effort), "velocity": repr(speed or assumed)}
        limit = ET.SubElement(joint, "limit", known)
        if limited:
            lower, upper = m.jnt_range[j].tolist()
            limit.attrib |= {"lower": repr(lower), "upper": repr(upper)}
        if not speed:
            limit.set("assumed", "velocity")
        return link, anchor.inverse()

    def _actuated(self, j: int) -> tuple[float, float]:
        """Speed and effort that a joint's actuators allow; 0 where they do not say it."""
        m, speed, effort = self.model, 0.0, 0.0
        for i in range(m.nu):
            of_joint = m.actuator_trntype[i] == int(self.mujoco.mjtTrn.mjTRN_JOINT)
            if not of_joint or m.actuator_trnid[i, 0] != j:
                continue
            gear, gain = abs(float(m.actuator_gear[i, 0])), float(m.actuator_gainprm[i, 0])
            if gear == 0.0:  # it moves nothing
                continue
            _, position, velocity = m.actuator_biasprm[i, :3]
            if m.actuator_ctrllimited[i] and position == 0.0 and velocity == -gain != 0.0:
                speed = float(np.abs(m.actuator_ctrlrange[i]).max()) / gear
            if m.actuator_forcelimited[i]:
                effort += gear * float(np.abs(m.actuator_forcerange[i]).max())
        if m.jnt_actfrclimited[j]:
            effort = float(np.abs(m.jnt_actfrcrange[j]).max())
        return speed, effort

    def _fixed(self, parent: str, child: str, place: pin.SE3) -> None:
        self._between(f"{child}_mount", "fixed", parent, child, place)

    def _between(
        self, name: str, kind: str, parent: str, child: str, place: pin.SE3
    ) -> ET.Element:
        """A joint from link to link, the child where its parent sees it."""
        joint = ET.SubElement(self.root, "joint", name=name, type=kind)
        _origin(joint, place)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        return joint

    def _geom(self, i: int, link: str) -> None:
        """Write a geom on its link, to be seen or to touch; planes and the like are left out."""
        m, kinds, kind = self.model, self.mujoco.mjtGeom, self.model.geom_type[i]
        place, size = _placement(m.geom_pos[i], m.geom_quat[i]), m.geom_size[i]
        shapes = []
        if kind == int(kinds.mjGEOM_SPHERE):
            shapes = [(place, "sphere", {"radius": repr(float(size[0]))})]
        elif kind == int(kinds.mjGEOM_BOX):
            shapes = [(place, "box", {"size": _numbers(2.0 * size)})]
        elif kind in (int(kinds.mjGEOM_CYLINDER), int(kinds.mjGEOM_CAPSULE)):
            radius, half = repr(float(size[0])), float(size[1])
            shapes = [(place, "cylinder", {"radius": radius, "length": repr(2.0 * half)})]
            if kind == int(kinds.mjGEOM_CAPSULE):
                ends = (pin.SE3(np.eye(3), np.array([0.0, 0.0, z])) for z in (-half, half))
                shapes += [(place * end, "sphere", {"radius": radius}) for end in ends]
        elif kind == int(kinds.mjGEOM_MESH):  # MuJoCo puts it at its centre of mass
            k = m.geom_dataid[i]
            own, mesh = _placement(m.mesh_pos[k], m.mesh_quat[k]), self.spec.mesh(m.mesh(k).name)
            file = {"filename": _mesh_file(self.spec, mesh), "scale": _numbers(mesh.scale)}
            shapes = [(place * own.inverse(), "mesh", file)]
        tags = ["visual"] if m.geom_group[i] < DRAWN else []
        tags += ["collision"] if m.geom_contype[i] or m.geom_conaffinity[i] else []
        for tag in tags:
            for at, name, attributes in shapes:
                shape = ET.SubElement(self.links[link], tag)
                _origin(shape, at)
                ET.SubElement(ET.SubElement(shape, "geometry"), name, attributes)


def _tied(mujoco: Any, m: Any) -> dict[int, str]:
    """The joints that active equalities take freedom from, and what ties each of them.

    An equality of joints ties its first one, which follows the second. A connect or weld ties all
    joints between its two bodies, unless one of the joints is free: then that body is carried.
    """
    tied: dict[int, str] = {}
    if m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY):
        return tied
    kinds = {int(getattr(mujoco.mjtEq, f"mjEQ_{each.upper()}")): each for each in TYING}
    for i in range(m.neq):
        kind, ends = kinds.get(int(m.eq_type[i])), [int(m.eq_obj1id[i]), int(m.eq_obj2id[i])]
        if kind is None or not m.eq_active0[i]:
            continue
        if m.eq_objtype[i] == int(mujoco.mjtObj.mjOBJ_SITE):
            ends = [int(m.site_bodyid[end]) for end in ends]
        joints = ends[:1] if kind == "joint" else _between_bodies(m, *ends)
        if kind == "joint" or int(mujoco.mjtJoint.mjJNT_FREE) not in m.jnt_type[joints]:
            label = f"<{kind}> {m.equality(i).name!r}" if m.equality(i).name else f"<{kind}>"
            tied |= dict.fromkeys(joints, label)
    return tied


def _between_bodies(m: Any, a: int, b: int) -> list[int]:
    """The joints that move body a and not b, or b and not a."""
    joints: list[int] = []
    while a != b:
        a, b = max(a, b), min(a, b)  # a parent has the smaller number
        first = int(m.body_jntadr[a])
        joints += range(first, first + int(m.body_jntnum[a]))
        a = int(m.body_parentid[a])
    return joints


def _origin(element: ET.Element, place: pin.SE3) -> None:
    rpy = pin.rpy.matrixToRpy(place.rotation)
    ET.SubElement(element, "origin", xyz=_numbers(place.translation), rpy=_numbers(rpy))


def _placement(pos: Array, quat: Array) -> pin.SE3:
    """Of a position [m] and a quaternion, w first."""
    return pin.XYZQUATToSE3(np.concatenate([pos, quat[1:], quat[:1]]))


def _numbers(values: Array) -> str:
    return " ".join(repr(float(x)) for x in values)


def check_size(path: Path) -> None:
    """Count what an MJCF is made of, with its included files, before MuJoCo multiplies it.

    Bodies, joints and sites count, and in a <replicate> or another element with a count whatever
    is repeated. A file that is not there is left for MuJoCo to say.

    Raises:
        ArmError: they are more than MOST_LINKS; or an included file is not XML that is read.
    """
    total, included = 0.0, {path.resolve()}
    rest = [(_root(path), path, 1.0, False)]
    while rest:
        element, file, times, in_world = rest.pop()
        times *= _count(element)
        in_world = in_world or element.tag == "worldbody"
        if in_world and (element.tag in COUNTED or times > 1.0):
            total += times
            check_count(total, path)
        if element.tag == "include":
            name = element.get("file", "")
            places = (folder / name for folder in (path.parent, file.parent))
            file = next((each for each in places if _there(each)), path).resolve()
            if file not in included:  # MuJoCo refuses to include a file twice
                included.add(file)
                rest.append((_root(file), file, times, in_world))
        rest += [(child, file, times, in_world) for child in element]


def check_count(total: float, path: Path) -> None:
    """Refuse more than MOST_LINKS bodies, joints and sites.

    Raises:
        ArmError: there are more.
    """
    if total > MOST_LINKS:
        raise ArmError(
            f"{path} has {total:.10g} or more bodies, joints, sites and replicated elements, at "
            f"most {MOST_LINKS} are read; take out what does not move the flange, or lower the "
            "count of its <replicate>"
        )


def _root(path: Path) -> ET.Element:
    raw = path.read_bytes()
    check_xml(raw, str(path))
    return ET.fromstring(raw)


def _there(path: Path) -> bool:
    """Whether a file is there and may be read; False where its name is too long, too."""
    try:
        return path.is_file() and os.access(path, os.R_OK)
    except OSError:
        return False


def _count(element: ET.Element) -> float:
    """How many times an element is there: the product of its counts, 1 without any."""
    try:
        return max(1.0, math.prod(map(float, element.get("count", "").split())))
    except ValueError:  # MuJoCo refuses it
        return 1.0
