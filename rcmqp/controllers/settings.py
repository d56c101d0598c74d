"""A controller with options, out of text: NAME or FILE.py[:CLASS], with :OPTION=VALUE,...."""

from __future__ import annotations

import inspect
import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from rcmqp.controllers import CONTROLLERS, Controller, check_is_dataclass, controller_options
from rcmqp.controllers.given import LAW_FILE
from rcmqp.errors import OptionError, UnknownName
from rcmqp.world.plugins import module_of_file

FILE_SETTING = re.compile(r"(?P<file>.+\.py)(?::(?P<name>[A-Za-z_]\w*))?(?P<options>:.*=.*)?")
"""FILE.py, FILE.py:CLASS, and either with :OPTION=VALUE,... behind it."""


def registered(setting: str) -> str:
    """Add the controller of a file to CONTROLLERS, and return the setting with its name there.

    ``my_law.py:MyLaw:gain=30`` becomes ``my_law:gain=30``: the file is run, and its class MyLaw is
    added to CONTROLLERS. Without a class, the file has to have a single controller.

    Args:
        setting: see controller_of(); without a file, it is returned as it is.

    Raises:
        OptionError: the file is not there, cannot be run, or has no controller or several; or the
            class has the name of another controller.
        UnknownName: the file has no such class.
    """
    match = FILE_SETTING.fullmatch(setting)
    if match is None:
        return setting
    module = module_of_file(match["file"])
    kind = _controller(module, match["file"], match["name"])
    if CONTROLLERS.get(kind.name, kind) is not kind:
        raise OptionError(
            f"{match['file']}: {kind.__name__} is named {kind.name!r}, as a controller that is "
            "there already; give the class another name"
        )
    file = f"{Path(match['file']).name}:{kind.__name__}"
    kind.law_file = file if LAW_FILE.fullmatch(file) else ""
    CONTROLLERS[kind.name] = kind
    return f"{kind.name}{match['options'] or ''}"


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


SWITCHES = {"feed_forward": "true", "velocity_limit": "scale", "velocity_limits": "true"}
"""Options that decide what a law is given, and the value that gives it; all are off by default."""


def controller_of(setting: str, more: Sequence[str] = ()) -> tuple[str, dict[str, Any]]:
    """Name and options of a controller out of its setting; hyphens in a name are underscores.

    Args:
        setting: NAME, or NAME:OPTION=VALUE,OPTION=VALUE.
        more: further OPTION=VALUE texts.

    Raises:
        UnknownName: the controller is not known, or does not have the option.
        OptionError: an option has no value, a value of the wrong kind, or comes twice.
    """
    name, _, options = setting.partition(":")
    name = name.replace("-", "_")
    return name, options_of(name, [*(options.split(",") if options else []), *more])


def every_setting(fixed: Sequence[str] = ()) -> list[str]:
    """Settings of all controllers, each with every combination of the SWITCHES that it has.

    Args:
        fixed: NAME=VALUE texts; an option in them is not a switch.
    """
    named = {text.partition("=")[0] for text in fixed}
    settings = []
    for name in CONTROLLERS:
        known = controller_options(name).keys() - named
        switches = [f"{option}={value}" for option, value in SWITCHES.items() if option in known]
        for count in range(len(switches) + 1):
            for chosen in itertools.combinations(switches, count):
                settings.append(f"{name}:{','.join(chosen)}" if chosen else name)
    return settings


def with_options(settings: Sequence[str], more: Sequence[str]) -> list[str]:
    """Add to each setting the NAME=VALUE texts that name an option of its controller.

    Raises:
        UnknownName: there is no such controller, or no controller has an option of that name.
    """
    known = [controller_options(controller_of(setting)[0]) for setting in settings]
    for text in more:
        name = text.partition("=")[0]
        if not any(name in options for options in known):
            laws = dict.fromkeys(controller_of(setting)[0] for setting in settings)
            for law in laws:
                check_is_dataclass(law, name)
            what = f"option of {', '.join(laws)}"
            raise UnknownName(what, name, {x for each in known for x in each})
    complete = []
    for setting, options in zip(settings, known, strict=True):
        name, _, given = setting.partition(":")
        own = [text for text in more if text.partition("=")[0] in options]
        every = ",".join(filter(None, [given, *own]))
        complete.append(f"{name}:{every}" if every else name)
    return complete


def options_of(controller: str, settings: Sequence[str]) -> dict[str, Any]:
    """Controller options out of NAME=VALUE texts, of the type that their defaults have.

    Raises:
        UnknownName, OptionError: see controller_of().
    """
    name = controller.replace("-", "_")
    if name not in CONTROLLERS:
        raise UnknownName("controller", name, CONTROLLERS)
    given = controller_options(name)  # an option without a default of its own is Python's
    defaults = {option: value for option, value in given.items() if value is not None}
    options: dict[str, Any] = {}
    for setting in settings:
        option, equals, text = setting.partition("=")
        if not equals:
            raise OptionError(f"{setting}: write NAME=VALUE, such as feed_forward=true")
        if option in given and option not in defaults:
            raise OptionError(f"{setting}: {option} of {name} can be given only from Python")
        if option not in defaults:
            check_is_dataclass(name, option)
            raise UnknownName(f"option of {name}", option, defaults)
        if option in options:
            raise OptionError(f"{setting}: {option} is given twice")
        options[option] = _value(option, text, type(defaults[option]))
    return options


def _value(option: str, text: str, kind: type) -> Any:
    if kind is bool:
        if text.lower() not in ("true", "false"):
            raise OptionError(f"{option}={text}: it must be true or false")
        return text.lower() == "true"
    try:
        return kind(text)
    except ValueError as error:
        raise OptionError(f"{option}={text}: it must be a number") from error
