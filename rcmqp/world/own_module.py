"""Python files of one's own, taken as modules without a package."""

from __future__ import annotations

import importlib.util
import os
import sys
import traceback
from pathlib import Path
from types import ModuleType

from rcmqp.errors import OptionError
from rcmqp.files import absent

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
        raise OptionError(f"{file} cannot be run: {type(error).__name__}: {error}") from error
    import cloudpickle  # with which joblib sends classes to its processes

    cloudpickle.register_pickle_by_value(module)
    _LOADED[name] = key
    return module


def place_of(error: Exception) -> str | None:
    """Where in a file of one's own an error was raised; None if it was not raised there."""
    files = {str(path) for path, _ in _LOADED.values()}
    own = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename in files]
    return f"{own[-1].filename}, line {own[-1].lineno}, in {own[-1].name}" if own else None
