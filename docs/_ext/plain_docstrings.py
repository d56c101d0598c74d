"""Docstrings are plain text with ``code`` in it; this makes reStructuredText of them.

What means something to reStructuredText and nothing to a reader of the source, |v| or K_, is
escaped, and an indented formula becomes a literal block.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

SECTIONS = ("Args:", "Attributes:", "Raises:", "Returns:", "Yields:")
_LITERAL = re.compile(r"(``.+?``)")
_SPECIAL = re.compile(r"[\\*|`]|_(?!\w)")


def setup(app: Sphinx) -> dict[str, Any]:
    """Before napoleon, which has priority 500."""
    app.connect("autodoc-process-docstring", process, priority=400)
    app.connect("autodoc-skip-member", skip)
    app.connect("doctree-read", no_links_elsewhere)
    return {"parallel_read_safe": True}


def process(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Change a docstring's lines in place."""
    lines[:] = as_rst(lines)


def skip(app: Sphinx, what: str, name: str, obj: Any, skipped: bool, options: Any) -> bool | None:
    """Leave out what Python writes of the fields of named tuples."""
    return True if (getattr(obj, "__doc__", "") or "").startswith("Alias for field") else None


def no_links_elsewhere(app: Sphinx, doctree: Any) -> None:
    """Take the links off types that this site does not describe, such as float.

    Sphinx searches all its names for each of them, which takes most of the time of a build.
    """
    from sphinx.addnodes import pending_xref, pending_xref_condition

    for link in list(doctree.findall(pending_xref)):
        if link["refdomain"] == "py" and not link["reftarget"].startswith("rcmqp"):
            ways = list(link.findall(pending_xref_condition))
            short = [way for way in ways if way["condition"] == "resolved"]  # without its module
            link.replace_self(short[0].children if short else link.children)


def as_rst(lines: list[str]) -> list[str]:
    """The lines of a docstring as reStructuredText."""
    made: list[str] = []
    in_section = literal = False
    for i, line in enumerate(lines):
        indented = line.startswith("    ")
        if not line.strip():
            made.append("")
            continue
        if not indented:
            in_section, literal = line.strip() in SECTIONS, False
        elif not in_section and not literal and (i == 0 or not lines[i - 1].strip()):
            if not "".join(made).endswith("::"):
                made += ["::", ""]
            literal = True
        made.append(line if literal else escaped(line))
    return made


def escaped(line: str) -> str:
    """A line in which only ``code`` is marked up."""
    parts = _LITERAL.split(line)
    return "".join(
        part if i % 2 else _SPECIAL.sub(r"\\\g<0>", part) for i, part in enumerate(parts)
    )
