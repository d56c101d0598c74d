"""Names that others add: entry points of distributions, and Python files of one's own.

Each group of entry points has the name of what it adds to: ``rcmqp.arms``, ``rcmqp.controllers``
and so on; docs/plugins.md has them all. Nothing is imported before its name is used, and every
process looks for itself, so that workers know what the process that started them knows.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib.metadata
import importlib.util
import os
import sys
import traceback
from collections.abc import Iterator, Mapping, MutableMapping
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar, cast

from rcmqp.errors import OptionError, PluginError
from rcmqp.files import absent

T = TypeVar("T")

Points = dict[str, tuple[importlib.metadata.EntryPoint, ...]]
"""Entry points by name; more than one for a name is a conflict."""


GROUPS = (
    "rcmqp.arms",
    "rcmqp.controllers",
    "rcmqp.motions",
    "rcmqp.paths",
    "rcmqp.plants",
    "rcmqp.scenarios",
    "rcmqp.steered",
)
"""Of entry points, one for each kind of thing that has names."""


def points(group: str) -> Points:
    """The entry points of a group; hyphens in their names become underscores."""
    return _points(group, tuple(sys.path))


@functools.cache
def _points(group: str, path: tuple[str, ...]) -> Points:
    """The entry points on ``path``, which is sys.path."""
    found: Points = {}
    for point in importlib.metadata.entry_points(group=group):
        name = point.name.replace("-", "_")
        found[name] = (*found.get(name, ()), point)
    return found


def distribution(group: str, name: str) -> str:
    """Name and version of the distribution that adds ``name`` to ``group``; of all that do."""
    return " and ".join(map(_whose, points(group)[name]))


def distributions_of(kind: type) -> list[str]:
    """Name and version of each distribution with an entry point into the class's package."""
    package = _package(kind.__module__)
    every = [point for group in GROUPS for same in points(group).values() for point in same]
    return sorted({_whose(point) for point in every if _package(point.module) == package})


def _whose(point: importlib.metadata.EntryPoint) -> str:
    return "unknown" if point.dist is None else f"{point.dist.name} {point.dist.version}"


def _package(module: str) -> str:
    return module.partition(".")[0]


def load(group: str, name: str) -> Any:
    """Load the object of an entry point.

    Raises:
        PluginError: it cannot be imported, or several distributions add the name.
        KeyError: no distribution adds the name.
    """
    point, *others = points(group)[name]
    whose = distribution(group, name)
    if others:
        raise PluginError(group, name, whose, "give it both; uninstall one of them")
    try:
        return point.load()
    except Exception as error:
        raise PluginError(
            group,
            name,
            whose,
            f"cannot be loaded from {point.value}: {type(error).__name__}: {error}; "
            "mend or uninstall it",
        ) from error


class Registry(MutableMapping[str, type[T]], Generic[T]):
    """Classes by name: those of rcmqp, those that a program adds, and those of plug-ins.

    A name of rcmqp or of the program hides a plug-in's. Names are listed without loading
    anything; a plug-in's class is imported when it is asked for.

    Attributes:
        group: of the entry points that add classes.
    """

    def __init__(self, group: str, classes: Mapping[str, type[T]], base: type = object) -> None:
        """With the classes of rcmqp; a plug-in's must be a dataclass derived from ``base``."""
        self.group = group
        self._classes, self._base = dict(classes), base

    def __getitem__(self, name: str) -> type[T]:
        """The class of this name.

        Raises:
            KeyError: there is none.
            PluginError: it is a plug-in's and cannot be used.
        """
        if name in self._classes:
            return self._classes[name]
        found: Any = load(self.group, name)
        if not (
            isinstance(found, type)
            and dataclasses.is_dataclass(found)
            and issubclass(found, self._base)
        ):
            derived = "" if self._base is object else f" derived from {self._base.__name__}"
            raise PluginError(
                self.group,
                name,
                distribution(self.group, name),
                f"gives {found!r:.80}, it must be a dataclass{derived}",
            )
        return cast(type[T], found)

    def __setitem__(self, name: str, value: type[T]) -> None:
        """Add a class, or put it in the place of another, in this process."""
        self._classes[name] = value

    def __delitem__(self, name: str) -> None:
        """Remove a class that is not a plug-in's."""
        del self._classes[name]

    def __contains__(self, name: object) -> bool:
        """Whether there is a class of this name, which may be unusable."""
        return name in self._classes or name in points(self.group)

    def __iter__(self) -> Iterator[str]:
        """The names, plug-ins last."""
        yield from self._classes
        yield from (name for name in points(self.group) if name not in self._classes)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def name_of(self, kind: type) -> str | None:
        """The name of a class, None if it is not in the registry.

        Of plug-ins, only those of the package that holds the class are loaded; those that cannot
        be loaded are passed over.
        """
        for name, each in self._classes.items():
            if each is kind:
                return name
        package = _package(kind.__module__)
        for name, (point, *_) in points(self.group).items():
            if _package(point.module) == package and self._is(name, kind):
                return name
        return None

    def _is(self, name: str, kind: type) -> bool:
        try:
            return self[name] is kind
        except PluginError:
            return False


_LOADED: dict[str, tuple[Path, int]] = {}
"""Files that module_of_file() has run, and when each was changed, by their module's name."""


def module_of_file(file: str | os.PathLike[str]) -> ModuleType:
    """Run a Python file and return its module; a file that has not changed is run once.

    Processes that joblib starts get the module's classes by value, as no path leads them to it.

    Raises:
        OptionError: there is no such file, or it raises an error.
    """
    path = Path(file).resolve()
    name = f"rcmqp_own_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise OptionError(f"{file}: {absent(file)}; give a name, or the path of a Python file")
    key = path, path.stat().st_mtime_ns
    if _LOADED.get(name) == key:
        return sys.modules[name]
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look there for the names in annotations
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # a script may end itself
        del sys.modules[name]
        _LOADED.pop(name, None)
        raise OptionError(cannot_run(str(file), error, path)) from error
    import cloudpickle  # with which joblib sends classes to its processes

    cloudpickle.register_pickle_by_value(module)
    _LOADED[name] = key
    return module


def cannot_run(name: str, error: BaseException, file: str | os.PathLike[str] | None) -> str:
    """Say that code in ``file`` raised an error, and in which line if the traceback has it."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if file is not None and frame.filename == str(file)
    ]
    if isinstance(error, SyntaxError) and error.filename == str(file):
        return f"{name}, line {error.lineno}: {type(error).__name__}: {error.msg}"
    what = f"{type(error).__name__}: {error}"
    return f"{name}, line {lines[-1]}: {what}" if lines else f"{name} cannot be run: {what}"


def place_of(error: Exception) -> str | None:
    """Where in a file of one's own an error was raised; None if it was not raised there."""
    files = {str(path) for path, _ in _LOADED.values()}
    own = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename in files]
    return f"{own[-1].filename}, line {own[-1].lineno}, in {own[-1].name}" if own else None
