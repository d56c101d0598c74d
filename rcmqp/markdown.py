"""Names and other text inside Markdown."""

from __future__ import annotations

import re


def literal(text: str) -> str:
    """Markdown, of one line, that is shown as the text is: it makes no link, picture or cell.

    An underscore after a letter begins nothing, and stays legible.
    """
    return re.sub(r"[\\`*\[\]<&|~#]|(?<![^\W_])_", r"\\\g<0>", " ".join(text.split()))
