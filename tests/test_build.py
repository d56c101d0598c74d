"""The build says what is missing, and nothing else is said to be."""

from __future__ import annotations

import runpy
import sys
import sysconfig
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import setuptools
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError, PlatformError

SETUP = Path(__file__).parents[1] / "setup.py"


def failing(monkeypatch: pytest.MonkeyPatch, error: Exception, **compiler: Any) -> object:
    """What a build raises whose compiler raises an error."""
    said: dict[str, Any] = {}
    monkeypatch.setattr(setuptools, "setup", said.update)
    monkeypatch.chdir(SETUP.parent)
    runpy.run_path(str(SETUP))

    def build(*_: object) -> None:
        raise error

    monkeypatch.setattr(build_ext, "build_extension", build)
    command = said["cmdclass"]["build_ext"](setuptools.Distribution())
    command.compiler = SimpleNamespace(**compiler)
    with pytest.raises((CompileError, PlatformError)) as raised:
        command.build_extension(said["ext_modules"][0])
    return raised.value


GCC = {"compiler_type": "unix", "compiler_so": [sys.executable, "-c"]}
NO_GCC = {"compiler_type": "unix", "compiler_so": ["no-such-compiler"]}
MSVC = {"compiler_type": "msvc"}


@pytest.mark.parametrize(
    ("compiler", "error"), [(NO_GCC, CompileError("x")), (MSVC, PlatformError("no vcvarsall"))]
)
def test_a_missing_compiler_is_named(
    monkeypatch: pytest.MonkeyPatch, compiler: dict[str, Any], error: Exception
) -> None:
    assert "a C compiler is missing" in str(failing(monkeypatch, error, **compiler))


@pytest.mark.parametrize("compiler", [GCC, MSVC])
def test_an_error_of_a_compiler_that_is_there_is_its_own(
    monkeypatch: pytest.MonkeyPatch, compiler: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "Python.h").touch()
    monkeypatch.setattr(sysconfig, "get_path", lambda _: str(tmp_path))
    error: Exception = CompileError("law.c: a slip")
    assert failing(monkeypatch, error, **compiler) is error
    (tmp_path / "Python.h").unlink()
    assert "Python.h is missing" in str(failing(monkeypatch, error, **compiler))
