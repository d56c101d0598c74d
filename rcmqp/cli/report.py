"""rcmqp report: runs as a page to publish."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rcmqp.cli import console
from rcmqp.cli.options import Files
from rcmqp.runs.run import Run


def report(
    files: Files,
    folder: Annotated[Path, typer.Option("--out", "-o", help="Folder for all files.")] = Path(
        "report"
    ),
) -> None:
    """Put runs into one report: tables, figures, viewers, and how to make it all again.

    For example,

      rcmqp report paper.h5 qp.h5 --out study

    The folder gets index.html, which works offline and from any place the folder is copied to;
    the same as Markdown, CSV and LaTeX (booktabs); figures as PNG and PDF; and for each scenario
    and arm a page to play its runs in and the scenario itself.
    """
    from rcmqp.show.report.build import write_report  # matplotlib takes long to import

    runs = [Run.load(file) for file in files]
    for path in write_report(runs, folder, files=[file.name for file in files]):
        console.print_written(path)
