"""A report's text: Markdown, and the same as a web page."""

from __future__ import annotations

import html
import importlib.resources
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template

from markdown_it import MarkdownIt
from matplotlib.figure import Figure

import rcmqp
from rcmqp.runs.run import Run
from rcmqp.show.plots import save_figure
from rcmqp.show.table import literal
from rcmqp.show.viewer.build import framed
from rcmqp.show.viewer.capture import snapshot


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
