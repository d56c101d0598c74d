"""Runs of a report, sorted into those that one viewer shows, and how each is made again."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.files import unlike
from rcmqp.references.operators import STEERED
from rcmqp.references.paths import PATHS, Foreign
from rcmqp.runs.loop_record import PATH as REAL_TIME
from rcmqp.runs.loop_record import TIMES
from rcmqp.runs.run import Run
from rcmqp.show.labels import run_labels, versions_text
from rcmqp.show.table import literal
from rcmqp.show.viewer.build import grouped
from rcmqp.world.loading import arm_title
from rcmqp.world.plugins import Registry, points


@dataclass(frozen=True)
class Group:
    """Runs of one scenario on one arm.

    Attributes:
        title: of scenario and arm.
        stem: of the group's files.
        runs: at least one.
        files: name of each run's file.
    """

    title: str
    stem: str
    runs: Sequence[Run]
    files: Sequence[str]

    @property
    def viewer(self) -> str:
        """Name of the viewer's file."""
        return f"view_{self.stem}.html"

    @property
    def scenario(self) -> str:
        """Name of the file that holds the scenario."""
        return f"scenario_{self.stem}.json"

    @property
    def labels(self) -> list[str]:
        """A label for each run."""
        return run_labels(self.runs)


def groups_of(runs: Sequence[Run], files: Sequence[str]) -> list[Group]:
    """Sort runs into groups; no two groups, and no two files, have the same name."""
    names = {id(run): name for run, name in zip(runs, _unique(files, ".h5"), strict=True)}
    groups = grouped(runs)
    scenarios = [group[0].scenario for group in groups]
    titles = _unique(f"{each.name} on {arm_title(each.arm)}" for each in scenarios)
    stems = _unique(
        re.sub(r"[^\w.-]+", "_", f"{each.name}_{Path(each.arm).stem}") for each in scenarios
    )
    return [
        Group(title, stem, group, [names[id(run)] for run in group])
        for title, stem, group in zip(titles, stems, groups, strict=True)
    ]


def _unique(names: Iterable[str], ending: str = "") -> list[str]:
    """The names; one that was there before gets a number, before a file's ending."""
    found: list[str] = []
    for name in names:
        known = ending if name.endswith(ending) else ""
        found.append(unlike(found, name.removesuffix(known), known))
    return found


DIGITS = 12
"""How much of a digest is shown; the whole is in the CSV file."""


def run_command(run: Run, scenario: str, file: str) -> str:
    """The command that makes a simulated run again; a comment if there is no such command.

    Args:
        run: to be made again.
        scenario: JSON file of its scenario, whose period and seed may be others.
        file: to write the run to.
    """
    path = run.scenario.path
    asked = isinstance(path, Foreign) and path.kind == REAL_TIME
    if asked or run.diagnostics.keys() >= TIMES.keys():
        return f"# {file}: recorded in real time, so no command makes it again"
    kind, law = CONTROLLERS.get(run.controller), run.controller
    if kind is None or not _is_installed(kind, CONTROLLERS):
        if not (law := run.given.file):
            return f"# {file}: its controller {run.controller!r} is not one of rcmqp's"
    if isinstance(path, Foreign) or not _is_installed(type(path), PATHS, STEERED):
        name = path.kind if isinstance(path, Foreign) else type(path).__name__
        return f"# {file}: its path {name!r} is not one of rcmqp's"
    defaults = {} if kind is None else controller_options(run.controller)
    changed = {name: x for name, x in run.options.items() if x != defaults.get(name)}
    if any(not isinstance(value, bool | int | float | str) for value in changed.values()):
        given = " and ".join(map(repr, changed))
        return f"# {file}: made in Python, its {given} were given there"
    words = ["rcmqp", "run", scenario, "--controller", law]
    words += ["--period", repr(run.period), "--seed", str(run.scenario.seed)]
    for name, value in changed.items():
        words += ["--set", f"{name}={value}"]
    command = shlex.join([*words, "--out", file])
    needs = law.rpartition(":")[0]
    return f"# needs {shlex.quote(needs)} in this folder\n{command}" if needs else command


def _is_installed(kind: type, *registries: Registry[Any]) -> bool:
    """Whether any process finds the class: it is of rcmqp, or a plug-in's."""
    return kind.__module__.startswith("rcmqp.") or any(
        registry.name_of(kind) in points(registry.group) for registry in registries
    )


def remake_text(groups: Sequence[Group], command: str) -> str:
    """Markdown that says how to make everything again.

    Args:
        groups: all runs.
        command: that makes the report, and its runs where it can.
    """
    runs = [pair for group in groups for pair in _commands(group)]
    lines = [f"- {literal(f'{group.title}: {versions_text(group.runs)}')}" for group in groups]
    return "\n".join(
        [
            "A command that reads files of runs, as `rcmqp report` does, needs them in this "
            "folder; the report itself does not put them there.",
            "",
            *_code([command]),
            "To make the files run by run, in this folder, use the commands below. With the same "
            "versions a run comes out with the same digest; `rcmqp show FILE --json` prints it:",
            "",
            *_code(runs),
            "The runs here were made with:",
            "",
            *lines,
        ]
    )


def _code(lines: Sequence[str]) -> list[str]:
    inside = max(map(len, re.findall("`*", "\n".join(lines))))
    fence = "`" * max(3, inside + 1)
    return [f"{fence}sh", *lines, fence, ""]


def _commands(group: Group) -> list[str]:
    lines = []
    for run, file in zip(group.runs, group.files, strict=True):
        command = run_command(run, group.scenario, file)
        lines += [f"# digest {run.digest[:DIGITS]}...", command]
    return lines
