"""Draw docs/starts.png: where ten public arms start, a scope in the trocar, found by the search.

python docs/starts.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
from PIL import Image

from rcmqp import load_scenario, make_controller, simulate
from rcmqp.show.viewer.capture import snapshot
from rcmqp.world.ease import ease_at

DOCS = Path(__file__).parent
SIZE = (480, 400)
CUT = slice(55, 376)
"""Rows of a picture between its legend and its last line."""

COLOURS = 32
"""Of the picture, so that it is small."""

sys.path.insert(0, str(DOCS.parent / "tests"))

from public_arms import PUBLIC_ARMS, write_public_arm  # noqa: E402


def main() -> None:
    """Find the starts, draw each, and put them on one sheet."""
    figure, places = plt.subplots(2, 5, figsize=(12.0, 3.8))
    with tempfile.TemporaryDirectory() as folder:
        for name, place in zip(PUBLIC_ARMS, places.flat, strict=True):
            path = write_public_arm(Path(folder), name)
            scenario = load_scenario("circle", str(path), flange="flange", duration=0.02)
            insertion = scenario.insertion()
            print(f"{name}: {ease_at(insertion)}")
            run = simulate(
                scenario, make_controller("hierarchical_qp", insertion, scenario.period)
            )
            file = Path(folder) / f"{name}.png"
            shot = snapshot([run], file, size=SIZE, direction=(1, -1, 0.4), zoom=0.9)
            place.imshow(plt.imread(shot)[CUT])
            place.set_title(name, fontsize=10)
            place.axis("off")
    figure.tight_layout(pad=0.3)
    sheet = DOCS / "starts.png"
    figure.savefig(sheet, dpi=100)
    with Image.open(sheet) as picture:
        picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(
            sheet, optimize=True
        )


if __name__ == "__main__":
    main()
