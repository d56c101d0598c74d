"""rcmqp doctor: what is installed, what is missing, and what to do about it."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import importlib.resources
import os
import platform
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import typer

import rcmqp
from rcmqp.cli import console
from rcmqp.cli.console import out
from rcmqp.cli.options import AsJson
from rcmqp.errors import OptionError, ToolMissing
from rcmqp.realtime.system import real_time_priority
from rcmqp.show.table import Table
from rcmqp.show.viewer.browser import chromium_path, ffmpeg_path

COMPILERS = ("cc", "gcc", "clang")
GRAPHICS = "/dev/dri"
"""Where Linux has its graphics cards, as renderD and a number."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked for.

    Attributes:
        what: it is.
        found: what is there; empty if nothing is.
        remedy: what to do if nothing is there or it does not do; empty if all is well.
        needed: rcmqp does not work without it; anything else is for a part of it.
    """

    what: str
    found: str
    remedy: str = ""
    needed: bool = False

    @property
    def state(self) -> str:
        """The finding in one word."""
        if not self.remedy:
            return "ok"
        return "missing" if self.needed else "optional"


def doctor(as_json: AsJson = False) -> None:
    """Look at what is installed, and say what to do about what is missing.

    What is optional is needed for pictures, videos, real-time runs or building from source only.
    The exit code is 1 if anything is missing that rcmqp needs.
    """
    findings = list(examine())
    if as_json:
        console.print_json([dataclasses.asdict(each) for each in findings])
    else:
        rows = [(each.what, each.state, each.found or "-", each.remedy) for each in findings]
        out.print(Table(("what", "", "found", "to do"), rows, words=4))
        out.print(
            "rcmqp loopback --minutes 1 --priority shows how punctual this machine is.",
            style="dim",
        )
    if any(each.state == "missing" for each in findings):
        raise typer.Exit(1)


def examine() -> Iterator[Finding]:
    """Look for everything, one thing after the other."""
    yield Finding("rcmqp", f"{rcmqp.__version__}, {importlib.resources.files('rcmqp')}")
    yield Finding("Python", f"{platform.python_version()}, {sys.executable}")
    yield Finding("system", f"{platform.platform()}, {os.cpu_count()} processors")
    yield from _packages()
    yield _compiler()
    yield _tool("Chromium, for pictures", chromium_path)
    yield _tool("ffmpeg, for videos", ffmpeg_path)
    yield _priority()
    yield _graphics()


def _packages() -> Iterator[Finding]:
    """Look for the packages that rcmqp needs, in versions that are new enough."""
    for requirement in importlib.metadata.requires("rcmqp") or []:
        if ";" in requirement:  # of an extra
            continue
        name, _, least = requirement.partition(">=")
        remedy = f"pip install '{requirement}'"
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            yield Finding(name, "", remedy, needed=True)
            continue
        old = _numbers(version) < _numbers(least)
        yield Finding(name, version, remedy if old else "", needed=True)


def _numbers(version: str) -> list[int]:
    """The first three numbers of a version, to compare versions with."""
    return [int(number) for number in re.findall(r"\d+", version.partition("+")[0])[:3]]


def _compiler() -> Finding:
    names = [os.environ.get("CC", ""), *COMPILERS]
    found = next((path for name in names if name and (path := shutil.which(name))), "")
    remedy = "apt-get install build-essential, or xcode-select --install on macOS"
    return Finding("C compiler, to build", found, "" if found else remedy)


def _tool(what: str, path: Callable[[], str]) -> Finding:
    """A program that the viewer uses."""
    try:
        return Finding(what, path())
    except ToolMissing as missing:
        return Finding(what, "", str(missing))


def _priority() -> Finding:
    """Whether this user may ask for real-time priority; it is asked for and given back."""
    what = "real-time priority"
    try:
        with real_time_priority():
            return Finding(what, "permitted")
    except OptionError as refused:
        return Finding(what, "", str(refused))


def _graphics() -> Finding:
    cards = sorted(str(card) for card in Path(GRAPHICS).glob("renderD*"))
    if sys.platform != "linux":
        return Finding("graphics card", "not looked for on this system")
    remedy = "pages work without one, at 2 or 3 frames a second"
    return Finding("graphics card, for pages", ", ".join(cards), "" if cards else remedy)
