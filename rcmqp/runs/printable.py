"""Text that a file or a user gave, made harmless for terminals."""

from __future__ import annotations

import unicodedata

MOST_LETTERS = 1000
"""Letters of an error message that are printed."""

_UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # control, format (bidi), surrogates, separators


def printable(text: str) -> str:
    r"""Write control characters as escapes; tabs and line ends stay as they are.

    A terminal runs escape sequences: a name with ``\x1b[2J`` in it would clear the screen.
    """
    return "".join(x if x in "\n\t" else _seen(x) for x in text)


def one_line(text: str) -> str:
    """Write every control character as an escape, line ends too: for names."""
    return "".join(map(_seen, text))


def shortened(text: str, most: int = MOST_LETTERS) -> str:
    """The text, or its beginning and end if it is longer than ``most`` letters."""
    if len(text) <= most:
        return text
    return f"{text[: most - 100]} [... {len(text) - most} letters ...] {text[-100:]}"


def _seen(x: str) -> str:
    if (x.isascii() and x.isprintable()) or unicodedata.category(x) not in _UNSEEN:
        return x
    return x.encode("unicode_escape").decode("ascii")
