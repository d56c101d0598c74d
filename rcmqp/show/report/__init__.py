"""Runs as a folder: index.html, tables, figures, viewers, and how to make it all again."""

from __future__ import annotations

import dataclasses
import html
import importlib.resources
import os
import re
import shlex
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template

from markdown_it import MarkdownIt
from matplotlib.figure import Figure

import rcmqp
from rcmqp.errors import RunFileError, ViewError
from rcmqp.files import check_writable, make_folder, unlike
from rcmqp.runs.run import Run
from rcmqp.runs.setup import run_command
from rcmqp.show import plots, tables
from rcmqp.show.labels import run_labels, versions_text
from rcmqp.show.plots import save_figure
from rcmqp.show.table import literal
from rcmqp.show.viewer.build import check_runs, framed, grouped, write_page
from rcmqp.show.viewer.capture import snapshot
from rcmqp.world.loading import arm_title


@dataclass(frozen=True)
class Picture:
    """A figure, the stem of its files, and what it shows."""

    stem: str
    caption: str
    figure: Figure

    @property
    def text(self) -> str:
        """Markdown that shows it."""
        stem, caption = self.stem, literal(self.caption)
        return f"![{caption}]({stem}.png)\n\n{caption} ([PDF]({stem}.pdf))\n\n"

    def write(self, folder: Path) -> None:
        """Draw it, as PNG and PDF."""
        save_figure(self.figure, folder / self.stem)


@dataclass(frozen=True)
class Screenshot:
    """The scene of a run at its end, the stem of its file, and what it shows."""

    stem: str
    caption: str
    run: Run

    @property
    def text(self) -> str:
        """Markdown that shows it."""
        caption = literal(self.caption)
        return f"![{caption}]({self.stem}.png)\n\n{caption}\n\n"

    def write(self, folder: Path) -> None:
        """Draw it, as PNG, in Chromium."""
        snapshot([self.run], folder / f"{self.stem}.png", time=float(self.run.time[-1]))


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Attributes:
        title: its heading.
        text: Markdown under it, such as a table.
        viewer: name of a viewer's file; none without it.
        pictures: come last.
    """

    title: str
    text: str = ""
    viewer: str = ""
    pictures: Sequence[Picture | Screenshot] = ()


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


def as_markdown(title: str, sections: Sequence[Section]) -> str:
    """The whole report; a viewer is a link."""
    texts = [
        _head(section) + "".join(each.text for each in section.pictures) for section in sections
    ]
    return f"# {literal(title)}\n\n{''.join(texts)}{_made_by()}\n"


def as_html(title: str, sections: Sequence[Section]) -> str:
    """The whole report as a page, which finds pictures and viewers beside it."""
    body = Template(_asset("index.html")).substitute(
        title=html.escape(title),
        sections="\n".join(_block(section) for section in sections),
        made_by=html.escape(_made_by()),
    )
    return framed(title, _asset("report.css"), body)


def _block(section: Section) -> str:
    frame = pictures = ""
    if section.viewer:
        frame = (
            f'<iframe src="{html.escape(section.viewer)}" loading="lazy" '
            f'title="{html.escape(section.title)}"></iframe>\n'
        )
    if section.pictures:
        shown = "".join(f"<div>{_render(each.text)}</div>\n" for each in section.pictures)
        pictures = f'<div class="pictures">\n{shown}</div>\n'
    return f"<section>\n{_render(_head(section))}{frame}{pictures}</section>"


def _head(section: Section) -> str:
    text = f"## {literal(section.title)}\n\n"
    if section.text:
        text += f"{section.text.strip()}\n\n"
    if section.viewer:
        text += f"[Play it in a page of its own]({section.viewer})\n\n"
    return text


def _render(text: str) -> str:
    return str(MarkdownIt("commonmark", {"html": False}).enable("table").render(text))


def _made_by() -> str:
    return f"Made by rcmqp {rcmqp.__version__}."


def _asset(name: str) -> str:
    return (importlib.resources.files("rcmqp.show.report") / "assets" / name).read_text("utf-8")


DIGITS = 12
"""How much of a digest is shown; the whole is in the CSV file."""

INDEX, TEXT, NUMBERS, LATEX = "index.html", "report.md", "report.csv", "report.tex"
"""Files that every report has."""

COLUMNS = 2
"""Runs of a group whose trajectories are drawn side by side, at most."""


def write_report(
    runs: Sequence[Run],
    out: str | os.PathLike[str],
    *,
    files: Sequence[str],
    title: str = "",
    opening: Sequence[Section] = (),
    command: str = "",
) -> list[Path]:
    """Write a report of runs, and return what was written, index.html first.

    Every file is made before the first takes its place, and index.html takes it last: what goes
    wrong before that leaves the folder as it was.

    Args:
        runs: at least one, of any scenarios and arms.
        out: folder, made if it is not there.
        files: names of the runs' files.
        title: of the report; the scenarios' names without it.
        opening: sections that come first, with the pictures of the report; without them each
            scenario and arm gets its trajectories and errors.
        command: that makes the report again; rcmqp report without it.

    Raises:
        ViewError: no run, or an arm that this machine does not have.
        RunFileError: the folder or a file in it cannot be written.
    """
    if not runs:
        raise ViewError("no run to report; give at least one")
    groups = groups_of(runs, files)
    for group in groups:
        check_runs(group.runs)
    folder = make_folder(out)
    names = [name for group in groups for name in group.files]
    rows = _rows(groups)
    sections = [
        *opening,
        *(
            Section(group.title, viewer=group.viewer, pictures=() if opening else pictures(group))
            for group in groups
        ),
        Section(
            "Numbers",
            f"{tables.as_markdown(rows)}\n"
            f"All columns: [CSV]({NUMBERS}); for a paper: [LaTeX]({LATEX})\n\n"
            f"{tables.columns_explained()}",
        ),
        Section(
            "How to make it again",
            remake_text(groups, command or shlex.join(["rcmqp", "report", *names, "--out", "."])),
        ),
    ]
    scenarios = dict.fromkeys(run.scenario.name for run in runs)
    count = f"{len(runs)} runs" if len(runs) > 1 else "a run"
    title = title or f"{', '.join(scenarios)}: {count}"
    try:
        with tempfile.TemporaryDirectory(prefix=".report-", dir=folder) as part:
            try:
                _make(Path(part), title, groups, sections)
            except RunFileError as error:
                raise RunFileError(folder / error.path.name, error.reason) from error
            return _move(Path(part), folder)
    except OSError as error:
        raise RunFileError(folder, f"could not be written: {error.strerror or error}") from error


def _make(part: Path, title: str, groups: Sequence[Group], sections: Sequence[Section]) -> None:
    """Write all files into a folder."""
    for group in groups:
        write_page(group.runs, part / group.viewer)
        scenario = group.runs[0].scenario.portable().to_json(carry=True)
        (part / group.scenario).write_text(scenario, encoding="utf-8")
    for section in sections:
        for picture in section.pictures:
            picture.write(part)
    (part / NUMBERS).write_text(tables.as_csv(_rows(groups)), encoding="utf-8")
    (part / LATEX).write_text(tables.as_latex(_rows(groups)), encoding="utf-8")
    (part / TEXT).write_text(as_markdown(title, sections), encoding="utf-8")
    (part / INDEX).write_text(as_html(title, sections), encoding="utf-8")


def _move(part: Path, folder: Path) -> list[Path]:
    """Move all files to the folder, index.html last; return their paths, index.html first."""
    names = sorted(file.name for file in part.iterdir() if file.name != INDEX)
    for name in (*names, INDEX):
        check_writable(folder / name)
    for name in (*names, INDEX):
        (part / name).replace(folder / name)
    return [folder / name for name in (INDEX, *names)]


def _rows(groups: Sequence[Group]) -> list[tables.Row]:
    """A row for each run; its controller with the options in which it differs from others."""
    return [
        dataclasses.replace(tables.row_of(run), controller=label, file=file)
        for group in groups
        for run, label, file in zip(group.runs, group.labels, group.files, strict=True)
    ]


def pictures(group: Group) -> list[Picture]:
    """Trajectories of a group's first runs, and the errors of all."""
    drawn = group.runs[:COLUMNS]
    return [
        Picture(
            f"trajectories_{group.stem}",
            "The arm at the start, and the tip's path from the trocar: "
            + ", ".join(group.labels[:COLUMNS]),
            plots.trajectory_figure(drawn, group.labels),
        ),
        Picture(
            f"errors_{group.stem}",
            "Tip and RCM error over time",
            plots.error_figure(group.runs, logarithmic=len(group.runs) > 1, labels=group.labels),
        ),
    ]


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
