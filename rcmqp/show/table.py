"""One table, written for the terminal, as Markdown, CSV, LaTeX and HTML."""

from __future__ import annotations

import csv
import html
import io
import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rcmqp.runs.untrusted import printable

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

_FORMULAS = ("=", "+", "-", "@", "\t", "\r")
"""How cells begin that a spreadsheet runs."""

_LATEX = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\char34{}",  # some languages of babel give " a meaning
    "`": r"\textasciigrave{}",
    "-": "{-}",  # two or three of them would make a dash
    "[": "{[}",  # after a line's end, LaTeX takes [ and * for the line end's own
    "]": "{]}",
    "*": "{*}",
    "\u00b1": r"\textpm{}",
    "\u00b5": r"\textmu{}",
    "\u2020": r"\textdagger{}",
    "\u2021": r"\textdaggerdbl{}",
}


@dataclass(frozen=True)
class Table:
    """A table of words and numbers.

    A cell is a text, or a value: CSV keeps a value at full precision, all else shows its text. A
    missing value, None or NaN, is shown as an empty cell.

    Attributes:
        heads: of the columns.
        rows: a cell for each column; where a row is short, empty cells fill it up.
        words: how many columns, the first ones, hold words; the others, numbers, stand to the
            right.
        title: what the table is about, and what all its rows share; may be empty.
        main: whether the terminal shows it too, and not only files.
        notes: sentences below it; CSV leaves them out.
    """

    heads: Sequence[str]
    rows: Sequence[Sequence[object]]
    words: int = 1
    title: str = ""
    main: bool = True
    notes: Sequence[str] = ()

    @property
    def texts(self) -> list[list[str]]:
        """The rows as texts, each as long as the heads."""
        return [
            [*map(_text, row), *[""] * (len(self.heads) - len(row))]
            for row in map(list, self.rows)
        ]

    def markdown(self) -> str:
        """The table in Markdown, between its title and its notes; ends with a line end."""
        rule = ["---"] * self.words + ["---:"] * (len(self.heads) - self.words)
        cells = [list(map(literal, row)) for row in (self.heads, *self.texts)]
        lines = [f"| {' | '.join(row)} |\n" for row in (cells[0], rule, *cells[1:])]
        title = f"{literal(self.title)}\n\n" if self.title else ""
        notes = [f"- {literal(note)}\n" for note in self.notes]
        return "".join([title, *lines, *(["\n", *notes] if notes else [])])

    def csv(self) -> str:
        """The heads and the rows, without the title.

        A spreadsheet runs cells of text that begin like a formula; an apostrophe stops it.
        """
        text = io.StringIO()
        writer = csv.writer(text)
        for row in (self.heads, *self.rows):
            filled = [*row, *[""] * (len(self.heads) - len(row))]
            writer.writerow([_no_formula(cell) for cell in filled])
        return text.getvalue()

    def latex(self) -> str:
        r"""A table environment; the document needs ``\usepackage{booktabs}``."""
        columns = "l" * self.words + "r" * (len(self.heads) - self.words)
        heads, *rows = [rf"{' & '.join(map(_latex, row))} \\" for row in (self.heads, *self.texts)]
        return "\n".join(
            [
                r"\begin{table}",
                *([rf"\caption{{{_latex(self.title)}}}"] if self.title else []),
                r"\centering",
                rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}",
                r"\toprule",
                heads,
                r"\midrule",
                *rows,
                r"\bottomrule",
                r"\end{tabular}",
                *(rf"\par\footnotesize {_latex(note)}" for note in self.notes),
                r"\end{table}",
                "",
            ]
        )

    def html(self, marks: Sequence[str] = ()) -> str:
        """The table as HTML.

        Args:
            marks: HTML to put before the text of each head but the first, such as a line's colour.
        """
        before = ["", *marks, *[""] * len(self.heads)]
        heads = "".join(
            f'<th><span class="mark">{mark}{html.escape(head)}</span></th>'
            if mark
            else f"<th>{html.escape(head)}</th>"
            for mark, head in zip(before, self.heads, strict=False)
        )
        lines = "".join(
            f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>"
            for row in self.texts
        )
        caption = f"<caption>{html.escape(self.title)}</caption>" if self.title else ""
        notes = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        head = f"<thead><tr>{heads}</tr></thead>"
        return f"<table>{caption}{head}<tbody>{lines}</tbody></table>{notes}"

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Lay the table out for rich's print(), without its title.

        The first column, of names, is never cut. Where a table of numbers is wider than the
        terminal, its columns are as narrow as their longest word.
        """
        from rich import box  # rich takes long to import
        from rich.markup import escape
        from rich.measure import Measurement
        from rich.table import Column, Table

        def made(rows: Iterable[Sequence[str]]) -> Table:
            heads, *others = ([escape(printable(text)) for text in row] for row in rows)
            narrow = Table(
                Column(heads[0], no_wrap=True),
                *(Column(head, overflow="fold") for head in heads[1:]),
                box=box.SIMPLE,
                pad_edge=False,
                collapse_padding=True,
            )
            for row in others:
                narrow.add_row(*row)
            return narrow

        table = made([self.heads, *self.texts])
        width = Measurement.get(console, options.update(max_width=10_000), table).maximum
        if width > options.max_width and self.words < len(self.heads):
            heads = [head.replace("-", "- ") for head in self.heads]
            columns = map(_narrow, zip(heads, *self.texts, strict=True))
            table = made(list(zip(*columns, strict=True)))
        yield table


def definitions(meanings: Mapping[str, str]) -> str:
    """A Markdown list that says what each column or row means."""
    return "".join(f"- **{literal(name)}**: {literal(text)}\n" for name, text in meanings.items())


def definitions_html(meanings: Mapping[str, str]) -> str:
    """The same list as HTML, closed until a reader opens it."""
    items = "".join(
        f"<dt>{html.escape(name)}</dt><dd>{html.escape(text)}</dd>"
        for name, text in meanings.items()
    )
    return f"<details><summary>What the rows mean</summary><dl>{items}</dl></details>"


def literal(text: str) -> str:
    """Markdown, of one line, that is shown as the text is: it makes no link, picture or cell.

    What can begin nothing stays legible: an underscore after a letter, a sign < before a number,
    brackets without an address after them.
    """
    escaped = re.sub(r"[\\`*&|~#]|<(?! \d)|(?<![^\W_])_", r"\\\g<0>", " ".join(text.split()))
    return re.sub(r"(?<![!\\\]])\[((?!\^)[\w /%^.,+-]*)\](?![(\[:])|[\[\]]", _bracket, escaped)


def _bracket(found: re.Match[str]) -> str:
    """Brackets around a unit or numbers as they are; any other escaped."""
    return found[0] if found[1] is not None else f"\\{found[0]}"


def _text(cell: object) -> str:
    """The text of a cell."""
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return ""
    return str(cell)


def _no_formula(cell: object) -> object:
    """A cell that no spreadsheet runs as a formula; numbers stay as they are."""
    if not isinstance(cell, str) or not cell.startswith(_FORMULAS):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def _latex(text: str) -> str:
    """A text of one line that LaTeX shows as it is."""
    return "".join(_LATEX.get(sign, sign) for sign in printable(" ".join(text.split())))


def _narrow(texts: Sequence[str]) -> list[str]:
    """Texts of a column in lines that break at spaces only, and are as short as that allows."""
    width = max((len(word) for text in texts for word in text.split()), default=1)
    return [textwrap.fill(text, width, break_on_hyphens=False) for text in texts]
