"""A controller in a Python file of one's own, without a package."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from types import ModuleType

from rcmqp.controllers import CONTROLLERS, Controller
from rcmqp.controllers.given import LAW_FILE
from rcmqp.errors import OptionError, UnknownName
from rcmqp.world.plugins import module_of_file

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
    module = module_of_file(found["file"])
    kind = _controller(module, found["file"], found["name"])
    if CONTROLLERS.get(kind.name, kind) is not kind:
        raise OptionError(
            f"{found['file']}: {kind.__name__} is named {kind.name!r}, as a controller that is "
            "there already; give the class another name"
        )
    file = f"{Path(found['file']).name}:{kind.__name__}"
    kind.law_file = file if LAW_FILE.fullmatch(file) else ""
    CONTROLLERS[kind.name] = kind
    return f"{kind.name}{found['options'] or ''}"


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
