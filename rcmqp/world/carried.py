"""The arm that a run's file carries, so that the run can be looked at and made again anywhere."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import json
import tomllib
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import Any, Self

import numpy as np
import pinocchio as pin

from rcmqp.errors import ArmError, ArmWarning, RcmqpError
from rcmqp.world.arm import Arm, ModelSource
from rcmqp.world.arm_limits import SpeedNearLimits
from rcmqp.world.geometry import mesh_files
from rcmqp.world.loading import ARM_FILE, arm_names, built, load_arm, names_its_flange
from rcmqp.world.urdf import urdf_of

_PARTS = {"name": str, "sha256": str, "urdf": str, "recipe": dict}
_RECIPE = {"flange": str, "locked": dict, "own": dict, "about": dict}
_ABOUT = {"title", "licence", "srs_offsets", "speed_near_limits", "flange_offset"}

MOST_NAME = 200
"""Letters of an arm's name in a file."""


@dataclass(frozen=True, slots=True)
class CarriedArm:
    """What load_arm() made an arm of, without the files; equal if name and sum of the files are.

    The file of a run says all of this, and a file can say anything: it is checked to be an arm,
    not to be the one that it is named after.

    Attributes:
        name: the arm's, or the name of its file, without folders.
        sha256: see Arm; of files that are elsewhere.
        urdf: the URDF that the model was made of: links, joints, materials, and the shapes of
            links. Meshes keep the names of their files; of those in a folder of one machine, only
            the file's own name is left.
        recipe: what built() was given besides.
        meshes: SHA-256 of the meshes that were there when the run was made, by their names.
        beside: folder in which the arm's own file is looked for; None for a registered arm.
    """

    name: str
    sha256: str
    urdf: str = field(compare=False, repr=False)
    recipe: Mapping[str, Any] = field(compare=False, repr=False)
    meshes: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    beside: Path | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of(cls, arm: Arm) -> Self | None:
        """What an arm was made of; None if it was made of no URDF."""
        if arm.source is None or not arm.source.recipe:
            return None
        name, text = own_name(arm.name), _without_folders(arm.source.text)
        beside = None if name in arm_names() else Path(arm.name).absolute().parent
        meshes = arm.source.meshes if arm.source.carried else mesh_sums(arm.source)
        return cls(name, arm.source.sha256, text, arm.source.recipe, meshes, beside)

    def to_json(self) -> str:
        """As a run's file keeps it, with a sum that shows damage."""
        data = {name: getattr(self, name) for name in (*_PARTS, "meshes")}
        return json.dumps({**data, "sum": _sum(data)})

    @classmethod
    def from_json(cls, text: str, beside: Path | None = None) -> Self:
        """The inverse of to_json().

        Raises:
            ValueError: a part is missing or of another kind, or the sum does not fit.
        """
        data = json.loads(text)
        for parts, inside in ((_PARTS, data), (_RECIPE, data.get("recipe", {}))):
            for part, kind in parts.items():
                if type(inside.get(part)) is not kind:
                    raise ValueError(f"{part} is missing, or is no {kind.__name__}")
        if own_name(data["name"]) != data["name"] or not 0 < len(data["name"]) <= MOST_NAME:
            raise ValueError(f"name = {data['name']!r:.50}, it must be an arm's or a file's")
        if unknown := data["recipe"]["about"].keys() - _ABOUT:
            raise ValueError(f"{sorted(unknown)[0]!r:.50} is none of {sorted(_ABOUT)}")
        _check_recipe(data["recipe"])
        meshes = data.get("meshes", {})  # earlier versions have none
        if not isinstance(meshes, dict) or any(type(each) is not str for each in meshes.values()):
            raise ValueError("meshes must be sums by name")
        if data.pop("sum", None) != _sum(data):
            raise ValueError("its numbers do not fit its sum")
        name, sha256, urdf, recipe = (data[part] for part in _PARTS)
        return cls(name, sha256, urdf, recipe, meshes, beside)

    def load(self, flange: str | None, limits: Mapping[str, Any]) -> Arm:
        """The arm: of its own file if that is here and the same, with its meshes; else of this.

        Args:
            flange: as load_arm() was given it.
            limits: by hand, in place of the arm's own.

        Raises:
            ArmError: what is carried is not an arm.
        """
        return self._here(flange, limits) or self._made(limits)

    def _here(self, flange: str | None, limits: Mapping[str, Any]) -> Arm | None:
        """The arm of its own file, None if that is not here or has changed."""
        if self.name in arm_names():
            tried = [self.name]
        else:
            folders = dict.fromkeys(filter(None, (self.beside, Path.cwd())))
            files = (folder / self.name for folder in folders)
            tried = [str(file) for file in files if file.is_file() and not _is_program(file)]
        for each in tried:
            with contextlib.suppress(RcmqpError), warnings.catch_warnings():
                warnings.simplefilter("ignore", ArmWarning)
                arm = load_arm(each, None if names_its_flange(each) else flange, **limits)
                if arm.sha256 == self.sha256:
                    arm.name = self.name
                    assert arm.source is not None
                    arm.source = dataclasses.replace(arm.source, meshes=self.meshes)
                    return arm
        return None

    def _made(self, limits: Mapping[str, Any]) -> Arm:
        path, about = Path(self.name), dict(self.recipe["about"])
        try:
            urdf = urdf_of(self.urdf.encode(), path)
            if self.name in arm_names():
                about["title"] = f"{about.get('title', self.name)}, as the run's file has it"
            if about.get("flange_offset") is not None:
                about["flange_offset"] = pin.SE3(np.array(about["flange_offset"], dtype=float))
            if about.get("speed_near_limits") is not None:
                about["speed_near_limits"] = SpeedNearLimits(**about["speed_near_limits"])
            return built(
                urdf,
                self.recipe["flange"],
                self.recipe["locked"],
                name=self.name,
                home=self.recipe.get("home"),
                own=self.recipe["own"],
                source=ModelSource(path, self.urdf, self.sha256, carried=True, meshes=self.meshes),
                by_hand=limits,
                **about,
            )
        except RcmqpError:
            raise
        except Exception as error:  # what a damaged text can make Python and Pinocchio raise
            raise ArmError(
                f"{self.name}, as the run's file carries it, is no arm: "
                f"{type(error).__name__}: {error!s:.200}"
            ) from error


def mesh_sums(source: ModelSource) -> dict[str, str]:
    """SHA-256 of an arm's meshes that are here, by their names as a run carries them."""
    return {_travelling(name): _sha256(path) for name, path in mesh_files(source).items()}


def changed_meshes(source: ModelSource) -> list[str]:
    """Names of the meshes whose content is not that of when the run was made."""
    if source.carried or not source.meshes:
        return []
    return [name for name, s in mesh_sums(source).items() if source.meshes.get(name, s) != s]


def _sha256(path: Path) -> str:
    stat = path.stat()
    return _sha256_of(path, stat.st_mtime_ns, stat.st_size)


@functools.lru_cache(maxsize=1000)
def _sha256_of(path: Path, *_: int) -> str:
    """SHA-256 of a file, computed again only if the file changes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _is_program(file: Path) -> bool:
    """Whether reading an arm's file would run a xacro, which may be a stranger's."""
    if file.suffix.lower() == ".xacro":
        return True
    if file.suffix.lower() != ARM_FILE:
        return False
    with contextlib.suppress(OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        urdf = tomllib.loads(file.read_text(encoding="utf-8")).get("urdf", "")
        return str(urdf).lower().endswith(".xacro")
    return True


def _check_recipe(recipe: Mapping[str, Any]) -> None:
    """Check the values of a recipe that built() does not check.

    Raises:
        ValueError: a value has the wrong type, or is not finite.
    """
    about, home = recipe["about"], recipe.get("home")
    for name in ("title", "licence"):
        if not isinstance(about.get(name, ""), str):
            raise ValueError(f"{name} = {about[name]!r:.50}, it must be a text")
    numbers = home.values() if isinstance(home, dict) else home
    for name, values in (("home", numbers), ("srs_offsets", about.get("srs_offsets"))):
        if values is not None and not np.isfinite(np.array([*values], dtype=float)).all():
            raise ValueError(f"{name} must be finite numbers")
    if about.get("flange_offset") is not None:
        offset = np.array(about["flange_offset"], dtype=float)
        turn = offset[:3, :3] if offset.shape == (4, 4) else np.zeros((3, 3))
        good = np.allclose(turn @ turn.T, np.eye(3), atol=1e-9) and np.linalg.det(turn) > 0.0
        if not (good and np.isfinite(offset).all()):
            raise ValueError("flange_offset must be a placement (4, 4)")


def _sum(data: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def own_name(name: str) -> str:
    """The name of an arm, or of its file without folders, whichever system made it."""
    return PureWindowsPath(name).name


def _without_folders(text: str) -> str:
    """A URDF of links, joints and materials; no file in it has a folder of somebody's machine."""
    root = ET.fromstring(text)
    for part in [part for part in root if part.tag not in ("link", "joint", "material")]:
        root.remove(part)
    for element in list(root.iter()):
        element.text = element.tail = None
        for texture in element.findall("texture"):
            element.remove(texture)
        if "filename" in element.attrib:
            element.set("filename", _travelling(element.attrib["filename"]))
    return ET.tostring(root, encoding="unicode")


def _travelling(mesh: str) -> str:
    """The name of a mesh as a run carries it: without the folder of one machine."""
    name = mesh.removeprefix("file://")
    return own_name(name) if PureWindowsPath(name).drive or PureWindowsPath(name).root else mesh
