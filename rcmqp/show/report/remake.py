"""How a report is made again: commands, seeds, versions."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from typing import Any

from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.references.operators import STEERED
from rcmqp.references.paths import PATHS, Foreign
from rcmqp.runs.loop_record import PATH as REAL_TIME
from rcmqp.runs.run import Run
from rcmqp.show.labels import versions_text
from rcmqp.show.report.groups import Group
from rcmqp.show.table import literal
from rcmqp.world.plugins import Registry, points

DIGITS = 12
"""How much of a digest is shown; the whole is in the CSV file."""


def run_command(run: Run, scenario: str, file: str) -> str:
    """The command that makes a simulated run again; a comment where none can.

    Args:
        run: to be made again.
        scenario: JSON file of its scenario, whose period and seed may be others.
        file: to write the run to.
    """
    path = run.scenario.path
    if isinstance(path, Foreign) and path.kind == REAL_TIME:
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
    made = [f"- {literal(f'{group.title}: {versions_text(group.runs)}')}" for group in groups]
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
            *made,
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
