"""A controller in a Python file of one's own, without a package."""

from __future__ import annotations

import importlib.util
import inspect
import re
import sys
from pathlib import Path
from types import ModuleType

from rcmqp.controllers import CONTROLLERS, Controller
from rcmqp.errors import OptionError, UnknownName

SETTING = re.compile(r"(?P<file>.+\.py)(?::(?P<name>[A-Za-z_]\w*))?(?P<options>:.*=.*)?")
"""FILE.py, FILE.py:CLASS, and either with :OPTION=VALUE,... behind it."""


def known(setting: str) -> str:
    """The setting of a controller by its name in CONTROLLERS, where it names a file.

    ``my_law.py:MyLaw:gain=30`` becomes ``my_law:gain=30``: the file is run, and its class MyLaw is
    added to CONTROLLERS. Without a class, the file has to have a single controller.

    Args:
        setting: see settings.controller_of(); any other is left as it is.

    Raises:
        OptionError: the file is not there, cannot be run, or has no controller or several; or the
            class has the name of another controller.
        UnknownName: the file has no such class.
    """
    found = SETTING.fullmatch(setting)
    if found is None:
        return setting
    module = _module(Path(found["file"]))
    kind = _controller(module, found["file"], found["name"])
    if CONTROLLERS.get(kind.name, kind) is not kind:
        raise OptionError(
            f"{found['file']}: {kind.__name__} is named {kind.name!r}, as a controller that is "
            "there already; give the class another name"
        )
    CONTROLLERS[kind.name] = kind
    return f"{kind.name}{found['options'] or ''}"


def _module(file: Path) -> ModuleType:
    """The module of a file, run once in a process; workers get its classes with their work."""
    name = f"rcmqp_own_{file.resolve().stem}"
    before = sys.modules.get(name)
    if before is not None and before.__file__ == str(file.resolve()):
        return before
    spec = importlib.util.spec_from_file_location(name, file.resolve())
    if not file.is_file() or spec is None or spec.loader is None:
        raise OptionError(
            f"{file}: no such file; give a controller's name, or a file that has one"
        )
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look there for the names in annotations
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise OptionError(f"{file} cannot be run: {type(error).__name__}: {error}") from error
    import cloudpickle  # with which joblib sends the module's classes to its processes

    cloudpickle.register_pickle_by_value(module)
    return module


def _controller(module: ModuleType, file: str, name: str | None) -> type[Controller]:
    """The class with a name, or the only one, of the controllers that a module defines."""
    kinds = {
        each.__name__: each
        for each in vars(module).values()
        if isinstance(each, type)
        and issubclass(each, Controller)
        and each.__module__ == module.__name__
        and not inspect.isabstract(each)
    }
    if name is not None:
        if name not in kinds:
            raise UnknownName(f"controller in {file}", name, kinds)
        return kinds[name]
    if len(kinds) != 1:
        what = "none: write a dataclass derived from rcmqp.controllers.Controller, with _step()"
        if kinds:
            what = f"several: {', '.join(kinds)}; say which, {file}:{next(iter(kinds))}"
        raise OptionError(f"{file} has to have one controller, and has {what}")
    return next(iter(kinds.values()))
