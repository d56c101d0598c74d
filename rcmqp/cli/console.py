"""Print tables, JSON, warnings and progress on the terminal."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from rcmqp.runs.untrusted import one_line, printable
from rcmqp.show.table import Table

WIDTH = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 120


class PlainConsole(Console):
    """A console that runs no terminal escapes out of names and messages."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does; control characters in texts are written as escapes."""
        shown = [printable(each) if isinstance(each, str) else each for each in objects]
        super().print(*shown, **options)


out = PlainConsole(width=WIDTH, emoji=False)
err = PlainConsole(stderr=True, emoji=False)


@contextmanager
def bar(quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """Show a progress bar on stderr; yield a function of a title, cycles done and their total."""
    from rich.progress import Progress, TimeRemainingColumn  # only here, and slow to import

    columns = [*Progress.get_default_columns()[:-1], TimeRemainingColumn()]
    hidden = quiet or not err.is_terminal
    with Progress(*columns, console=err, transient=True, disable=hidden) as progress:
        tasks: dict[str, Any] = {}

        def advance(title: str, done: int, total: int) -> None:
            if title not in tasks:
                tasks[title] = progress.add_task(escape(one_line(title)), total=total)
            progress.advance(tasks[title], done)

        yield advance


def show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: Any = None,
    line: str | None = None,
) -> None:
    """Print a warning as a sentence; in place of warnings.showwarning()."""
    err.print(f"[yellow]warning:[/] {escape(one_line(str(message)))}", soft_wrap=True)


def print_json(data: Any) -> None:
    """Print one JSON object; numbers in it that are not finite become null."""
    print(json.dumps(_plain(data), indent=2, allow_nan=False))


def say(text: str) -> None:
    """Print a text as it is, however long its lines are."""
    out.print(text, markup=False, highlight=False, soft_wrap=True)


def print_written(path: Path, more: str = "") -> None:
    """Print that a file or folder is written; its name is printed as it is."""
    say(one_line(f"wrote {path}{more}"))


def print_note(text: str) -> None:
    """Print a note on stderr."""
    err.print(one_line(f"note: {text}"), markup=False, highlight=False, soft_wrap=True)


def print_tables(tables: Iterable[Table]) -> None:
    """Print the main tables, each below its title."""
    for table in tables:
        if table.main:
            if table.title:
                say(table.title)
            out.print(table)
            for note in table.notes:
                out.print(note, markup=False, highlight=False)


def _plain(value: Any) -> Any:
    """A value for JSON, with None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
