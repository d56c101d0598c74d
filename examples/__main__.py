"""Run every example: ``python examples FOLDER`` writes a picture of each into the folder."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path


def main(folder: str = ".") -> None:
    """Run the numbered scripts beside this file, one after the other."""
    for script in sorted(Path(__file__).parent.glob("[0-9]*.py")):
        print(f"{script.name}:")
        runpy.run_path(str(script))["main"](str(Path(folder, f"{script.stem}.png")))


if __name__ == "__main__":
    main(*sys.argv[1:2])
