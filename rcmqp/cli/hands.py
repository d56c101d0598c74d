"""rcmqp hands: recorded hands beside the operator model's."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rcmqp.cli.console import print_written, say
from rcmqp.cli.study import PRACTICE, Operators, Seed, learning_of


def hands(
    recordings: Annotated[
        list[Path],
        typer.Argument(metavar="RECORDING...", help="CSV files with the columns t, x, y, z."),
    ],
    scale: Annotated[
        float, typer.Option(help="Metres in the files' unit of length; 0.001 for mm.")
    ] = 1.0,
    operators: Operators = 20,
    seed: Seed = 0,
    practice: Annotated[float | None, PRACTICE] = None,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for all files.")] = Path(
        "hands"
    ),
) -> None:
    """Compare recorded hands or tools with the operator model's: spectra, smoothness.

    For example, rcmqp hands surgeon.csv --scale 0.001 --out hands. The table and the figure show
    speed spectra, SPARC and LDLJ; nothing of the model was fitted to them.
    """
    from rcmqp.experiments.study.hands import compare_hands  # SciPy and joblib take long to import

    comparison = compare_hands(
        recordings,
        folder,
        scale=scale,
        operators=operators,
        seed=seed,
        learning=learning_of(practice),
    )
    say(comparison.table)
    for path in comparison.files:
        print_written(path)
