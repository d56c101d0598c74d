"""Print one version's part of CHANGELOG.md: ``python .github/release_notes.py 0.2.0``."""

from __future__ import annotations

import re
import sys
from pathlib import Path

CHANGELOG = Path(__file__).parents[1] / "CHANGELOG.md"


def notes(version: str) -> str:
    """What CHANGELOG.md says of a version, without its heading.

    Raises:
        ValueError: it says nothing of it.
    """
    text = CHANGELOG.read_text(encoding="utf-8")
    parts = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    for part in parts:
        title, _, body = part.partition("\n")
        if re.match(rf"\[?{re.escape(version)}\b", title):
            return body.strip()
    raise ValueError(f"CHANGELOG.md has no {version}; add it, or tag another version")


if __name__ == "__main__":
    print(notes(sys.argv[1]))
