"""Tables, and names and other text, in Markdown."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rcmqp.files import table


def literal(text: str) -> str:
    """Markdown, of one line, that is shown as the text is: it makes no link, picture or cell.

    An underscore after a letter begins nothing, and stays legible.
    """
    return re.sub(r"[\\`*\[\]<&|~#]|(?<![^\W_])_", r"\\\g<0>", " ".join(text.split()))


@dataclass(frozen=True)
class TitledTable:
    """A table of words and numbers, as texts.

    Attributes:
        title: what it is about, and what all its rows share.
        heads: of its columns.
        rows: a text for each column.
        left: how many columns, the first ones, are words.
        main: whether it is for the terminal too, not only for files.
    """

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: int
    main: bool = True

    @property
    def markdown(self) -> str:
        """The title as a paragraph, and the table."""
        rows = [[literal(cell) for cell in row] for row in self.rows]
        return f"{literal(self.title)}\n\n{table(self.heads, rows, self.left)}\n"
